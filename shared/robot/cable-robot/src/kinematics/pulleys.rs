//! Positions from lengths of cables over pulleys: least squares from the intersections of spheres around eyes.
//!
//! A pulley of radius r adds to the straight length between 0.57 r (node at the height of the anchor) and about 3 r
//! (node below it), so the starting points are within a few radii, and two or three evaluations suffice. For three
//! cables whose two positions are far apart, only the chosen one is computed.

use nalgebra::{Matrix3, Vector3};

use super::newton::{Found, newton};
use super::solution::{Forward, KinematicsError};
use super::trilateration::{best_pair, choose, fits_worse};
use crate::{Anchors, CableVec, linalg, planar};

/// Residuals below this share of the longest cable count as zero: spheres that touch miss each other by rounding.
const EXACT: f64 = 1e-9;

/// A position whose residual is below this share of the longest cable has no better mirror image.
const EXACT_FIT: f64 = 1e-7;

/// Positions closer than this are one position, m: both starting points led to it.
const SAME_M: f64 = 1e-3;

/// Bound of the iteration. It needs many steps only where the lengths have no solution, and in the plane of the
/// anchors.
const MAX_ITERATIONS: usize = 60;

/// Largest gradient of a stationary point, m: steps of this size do not matter.
const STATIONARY_M: f64 = 1e-8;

/// Offset of a starting point without directions, on the axis of a pulley or inside its wheel, m.
const ASIDE_M: [f64; 3] = [0.011, 0.013, -0.017];

/// Computes the position with these lengths for anchors with pulleys, as [`super::forward_kinematics`] states, which
/// has checked the lengths.
pub(super) fn forward_kinematics(
    anchors: &Anchors,
    lengths_m: &[f64],
    near: Option<&Vector3<f64>>,
) -> Result<Forward, KinematicsError> {
    let n = anchors.len();
    let starts = starting_points(anchors, lengths_m).ok_or(KinematicsError::DegenerateGeometry)?;
    let (first, second) = choose(starts, near)?;
    if n == 3
        && !anchors.is_planar()
        && are_apart(anchors, [&first, &second], near)
        && let Some(Found { position, .. }) = newton(anchors, lengths_m, &first)
    {
        return Ok(Forward { position, mirror: None, residual_rms_m: 0.0 });
    }
    if n == anchors.dimensions() {
        return exact(anchors, lengths_m, [first, second], near);
    }
    let rms = |fit: &Fit| (fit.cost / n as f64).sqrt();
    let longest = lengths_m.iter().fold(0.0, |m: f64, l| m.max(*l));
    let mut fit = refine(anchors, lengths_m, first);
    // Near the plane of the anchors the lower starting point may lead to the upper position. Without a hint, a position
    // that fits exactly is the right one.
    if !fit.stationary || near.is_some() || rms(&fit) > EXACT_FIT * longest {
        let mut other = refine(anchors, lengths_m, second);
        if (other.position - fit.position).norm() < SAME_M {
            let height = anchors.iter().map(|a| a.z).sum::<f64>() / n as f64;
            let mirror = Vector3::new(fit.position.x, fit.position.y, 2.0 * height - fit.position.z);
            other = refine(anchors, lengths_m, mirror);
        }
        let better = match near {
            _ if !fit.stationary => true,
            Some(near) => (other.position - near).norm_squared() < (fit.position - near).norm_squared(),
            None if fits_worse(rms(&fit), rms(&other), lengths_m) => true,
            None if fits_worse(rms(&other), rms(&fit), lengths_m) => false,
            None => other.position.z < fit.position.z,
        };
        if other.stationary && better {
            fit = other;
        }
    }
    if !fit.stationary {
        return Err(KinematicsError::NotConverged { residual_m: rms(&fit) });
    }
    Ok(Forward { position: fit.position, mirror: None, residual_rms_m: rms(&fit) })
}

/// Computes the position with these lengths near a position that is not that of the node, on the other side of the
/// plane of the anchors; None if there is none, for a wrong number of lengths, and for more cables than directions.
pub(super) fn mirror(anchors: &Anchors, lengths_m: &[f64], position: &Vector3<f64>) -> Option<Vector3<f64>> {
    let n = anchors.len();
    if lengths_m.len() != n || n != anchors.dimensions() {
        return None;
    }
    let (_, other) = choose(starting_points(anchors, lengths_m)?, Some(position)).ok()?;
    let fit = refine(anchors, lengths_m, other);
    let longest = lengths_m.iter().fold(0.0, |m: f64, l| m.max(*l));
    let fits = (fit.cost / n as f64).sqrt() <= EXACT * longest;
    (fits && (fit.position - position).norm() > SAME_M).then_some(fit.position)
}

/// The two positions of straight cables that are shorter by a radius; None if the anchors lie on one line.
fn starting_points(anchors: &Anchors, lengths_m: &[f64]) -> Option<[Vector3<f64>; 2]> {
    let straight = CableVec::from_fn(anchors.len(), |i| (lengths_m[i] - anchors.radii_m()[i]).max(0.0));
    if anchors.is_planar() {
        return planar::starting_points(anchors, &straight);
    }
    match *straight {
        [a, b, c] => anchors.frame().map(|frame| frame.intersect([a, b, c]).points),
        _ => best_pair(anchors, &straight),
    }
}

/// True if each starting point can only lead to its own position, and the choice between the positions is that between
/// the starting points: they are apart by many radii, in the direction that decides.
fn are_apart(anchors: &Anchors, [first, second]: [&Vector3<f64>; 2], near: Option<&Vector3<f64>>) -> bool {
    let largest_m = anchors.radii_m().iter().fold(0.0, |m: f64, r| m.max(*r));
    let apart_m = (second - first).norm();
    let decides_m = match near {
        // Twice the distance of the hint from the plane between the two.
        Some(near) => ((near - second).norm_squared() - (near - first).norm_squared()) / apart_m,
        None => second.z - first.z,
    };
    // A starting point is off by three radii per cable; in a flat pyramid of cables by several times that.
    apart_m > 40.0 * largest_m && decides_m > 40.0 * largest_m
}

/// The positions of as many cables as directions from two starting points.
fn exact(
    anchors: &Anchors,
    lengths_m: &[f64],
    starts: [Vector3<f64>; 2],
    near: Option<&Vector3<f64>>,
) -> Result<Forward, KinematicsError> {
    let rms = |fit: &Fit| (fit.cost / anchors.len() as f64).sqrt();
    let longest = lengths_m.iter().fold(0.0, |m: f64, l| m.max(*l));
    let fits = starts.map(|start| refine(anchors, lengths_m, start));
    let (position, mirror) = match fits.each_ref().map(|fit| rms(fit) <= EXACT * longest) {
        [true, true] => {
            let (position, mirror) = choose([fits[0].position, fits[1].position], near)?;
            (position, Some(mirror))
        }
        [true, false] => (fits[0].position, None),
        [false, true] => (fits[1].position, None),
        [false, false] => {
            let residual_m = rms(&fits[0]).min(rms(&fits[1]));
            return Err(if residual_m.is_finite() && residual_m > 1e3 * EXACT * longest {
                KinematicsError::Unreachable { shortfall_m: residual_m }
            } else {
                KinematicsError::NotConverged { residual_m }
            });
        }
    };
    Ok(Forward { position, mirror, residual_rms_m: 0.0 })
}

/// Result of the iteration.
struct Fit {
    position: Vector3<f64>,
    /// Sum of the squared differences of the lengths, m²; infinite without directions.
    cost: f64,
    stationary: bool,
}

/// Differences of the lengths at a position, with their normal equations.
struct Normal {
    cost: f64,
    gradient: Vector3<f64>,
    matrix: Matrix3<f64>,
}

impl Normal {
    /// None where a cable has no direction.
    fn at(anchors: &Anchors, lengths_m: &[f64], x: &Vector3<f64>) -> Option<Self> {
        let mut normal = Self { cost: 0.0, gradient: Vector3::zeros(), matrix: Matrix3::zeros() };
        for (pulley, length_m) in anchors.pulleys().zip(lengths_m) {
            let cable = pulley.cable_to(x).ok()?;
            let u = cable.direction;
            let off_m = cable.length_m - length_m;
            normal.cost += off_m * off_m;
            normal.gradient += u * off_m;
            normal.matrix += linalg::outer(&u, &u);
        }
        if anchors.is_planar() {
            // The gradient has y = 0, so this keeps the node in the plane.
            normal.matrix[(1, 1)] += 1.0;
        }
        Some(normal)
    }
}

/// Levenberg-Marquardt on the sum of the squared differences of the lengths.
fn refine(anchors: &Anchors, lengths_m: &[f64], start: Vector3<f64>) -> Fit {
    let mut x = start;
    let mut now = Normal::at(anchors, lengths_m, &x);
    if now.is_none() {
        let [dx, dy, dz] = ASIDE_M;
        x += Vector3::new(dx, if anchors.is_planar() { 0.0 } else { dy }, dz);
        now = Normal::at(anchors, lengths_m, &x);
    }
    let Some(mut now) = now else { return Fit { position: x, cost: f64::INFINITY, stationary: false } };
    let mut damping = 1e-12;
    for _ in 0..MAX_ITERATIONS {
        let damped = now.matrix + Matrix3::identity() * damping;
        let Some(step) = linalg::solve_spd(&damped, &now.gradient) else {
            damping = (damping * 10.0).max(1e-9);
            continue;
        };
        let (next, size) = (x - step, step.norm() / (1.0 + x.norm()));
        // Near the minimum, rounding hides the decrease of the cost: accept undamped steps.
        let close = damping <= 1e-9 && size <= 1e-7;
        match Normal::at(anchors, lengths_m, &next).filter(|there| there.cost <= now.cost || close) {
            Some(there) => {
                // The next undamped step would be smaller by its own size per length, or by the residual per length.
                let done = size <= if damping <= 1e-12 { 1e-9 } else { 1e-14 };
                (x, now) = (next, there);
                damping = (damping * 0.1).max(1e-12);
                if done {
                    break;
                }
            }
            None if size <= 1e-12 => break,
            None => damping = (damping * 10.0).max(1e-6),
        }
    }
    Fit { position: x, cost: now.cost, stationary: now.gradient.norm() <= STATIONARY_M }
}
