//! The baseline of the paper: anchors from points with known positions, for example from GPS.
//!
//! Points are 3-vectors and lengths one per point, all in m; the anchor is the upper intersection. Points on one line
//! and spheres that do not intersect are a [`CalibrationError`].

use nalgebra::{Matrix3, Vector3};

use super::error::{CalibrationError, degenerate, invalid, undetermined};
use super::{Ambiguity, Undetermined};
use cable_robot::kinematics::{KinematicsError, LONGEST_M, trilaterate};

/// Bound of the refinement, which needs about five steps.
const MAX_ITERATIONS: usize = 100;

/// Spheres that miss each other by this share of the squared longest length count as touching: rounding.
const TOUCH_SHARE: f64 = 1e-9;

/// An anchor computed from points, with the terms of its covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct GpsAnchor {
    /// The anchor, m.
    pub anchor_m: Vector3<f64>,
    /// Measured minus modelled length, one per point, m.
    pub residuals_m: Vec<f64>,
    /// Derivatives dX/dL_j of the anchor with respect to every length.
    pub by_length: Vec<Vector3<f64>>,
    /// Unit vector from every point to the anchor.
    pub directions: Vec<Vector3<f64>>,
}

/// Computes the upper one of the two positions with these distances from three points, m.
///
/// # Errors
/// `invalid_argument`; `degenerate_geometry` for points on one line; `unreachable` if the spheres do not intersect;
/// `ambiguous` for points in a vertical plane, for which both solutions have the same height.
///
/// ```
/// use calibration::gps_anchor;
/// let found = gps_anchor(&[[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 3.0, 0.0]], &[5.0, 5.0, 5.0])?;
/// assert!((found[2] - 4.0).abs() < 1e-12 && found[0].abs() < 1e-12);
/// # Ok::<(), calibration::CalibrationError>(())
/// ```
pub fn gps_anchor(points_m: &[[f64; 3]; 3], lengths_m: &[f64; 3]) -> Result<[f64; 3], CalibrationError> {
    check(points_m, lengths_m)?;
    upper_intersection(points_m.map(Vector3::from), *lengths_m, false).map(Into::into)
}

fn check(points: &[[f64; 3]], lengths: &[f64]) -> Result<(), CalibrationError> {
    if points.len() != lengths.len() {
        return invalid(format!("{} lengths are given for {} points; give one per point", lengths.len(), points.len()));
    }
    for (j, (p, l)) in points.iter().zip(lengths).enumerate() {
        if !p.iter().all(|v| v.is_finite() && v.abs() <= LONGEST_M) {
            return invalid(format!(
                "point {} is at {p:?}; give finite coordinates in metres, of a local frame",
                j + 1
            ));
        }
        if !(0.0..=LONGEST_M).contains(l) {
            return invalid(format!("the length at point {} is {l}; give a finite length in metres", j + 1));
        }
    }
    Ok(())
}

/// The upper intersection of three spheres; with `lenient`, spheres that miss each other give the point between them.
fn upper_intersection(p: [Vector3<f64>; 3], l: [f64; 3], lenient: bool) -> Result<Vector3<f64>, CalibrationError> {
    let pair = match trilaterate(p, l) {
        Ok(pair) => pair,
        Err(KinematicsError::DegenerateGeometry) => {
            return degenerate(
                "the three points lie on one line, so lengths to them determine no anchor; move one sideways",
            );
        }
        Err(other) => return invalid(other.to_string()),
    };
    let longest = l.iter().fold(0.0, |m: f64, v| m.max(v * v));
    if pair.height_squared < -TOUCH_SHARE * longest && !lenient {
        return Err(CalibrationError::Unreachable(format!(
            "no anchor has these distances from the points: they are {:.4} m too short to meet; measure them again",
            (-pair.height_squared).sqrt()
        )));
    }
    let [a, b] = pair.points;
    let apart = (a - b).norm();
    if apart > 1e-9 && (a.z - b.z).abs() < 1e-9 * apart.max(1.0) {
        return Err(CalibrationError::Ambiguous(Ambiguity::VerticalPlane));
    }
    Ok(if a.z >= b.z { a } else { b })
}

/// Computes the anchor whose distances from three or more known points fit best; of two equal fits, the upper one.
///
/// # Errors
/// Like [`gps_anchor`], and `rank_deficient` for fewer than three points.
pub fn gps_anchor_least_squares(points_m: &[[f64; 3]], lengths_m: &[f64]) -> Result<GpsAnchor, CalibrationError> {
    check(points_m, lengths_m)?;
    if points_m.len() < 3 {
        return undetermined(Undetermined::FewKnownPoints { points: points_m.len() });
    }
    let points: Vec<Vector3<f64>> = points_m.iter().map(|p| Vector3::from(*p)).collect();
    let [i, j, k] = widest_triple(&points);
    let exact = points.len() == 3;
    let start =
        upper_intersection([points[i], points[j], points[k]], [lengths_m[i], lengths_m[j], lengths_m[k]], !exact)?;
    let anchor = if exact { start } else { descend(&points, lengths_m, start) };
    let mut normal = Matrix3::zeros();
    let mut directions = Vec::with_capacity(points.len());
    let mut residuals_m = Vec::with_capacity(points.len());
    for (p, l) in points.iter().zip(lengths_m) {
        let d = (anchor - p).norm();
        let u = (anchor - p) / d.max(1e-12);
        normal += u * u.transpose();
        directions.push(u);
        residuals_m.push(l - d);
    }
    let Some(inverse) = normal.cholesky().map(|c| c.inverse()) else {
        return undetermined(Undetermined::InAPlane);
    };
    let by_length = directions.iter().map(|u| inverse * u).collect();
    Ok(GpsAnchor { anchor_m: anchor, residuals_m, by_length, directions })
}

/// Selects three points of a large triangle: the farthest from the first, the farthest from that, and the farthest from
/// the line through both.
fn widest_triple(p: &[Vector3<f64>]) -> [usize; 3] {
    let farthest = |from: &Vector3<f64>| {
        (0..p.len()).max_by(|a, b| (p[*a] - from).norm_squared().total_cmp(&(p[*b] - from).norm_squared())).unwrap_or(0)
    };
    let i = farthest(&p[0]);
    let j = farthest(&p[i]);
    let line = p[j] - p[i];
    let off = |k: &usize| line.cross(&(p[*k] - p[i])).norm_squared();
    let k = (0..p.len()).filter(|k| *k != i && *k != j).max_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0);
    [i, j, k]
}

/// Levenberg-Marquardt on sum (|a - p_j| - L_j)².
fn descend(points: &[Vector3<f64>], lengths: &[f64], start: Vector3<f64>) -> Vector3<f64> {
    let cost = |a: &Vector3<f64>| points.iter().zip(lengths).map(|(p, l)| ((a - p).norm() - l).powi(2)).sum::<f64>();
    let (mut a, mut best, mut damping) = (start, cost(&start), 1e-6);
    for _ in 0..MAX_ITERATIONS {
        let (mut normal, mut gradient) = (Matrix3::identity() * damping, Vector3::zeros());
        for (p, l) in points.iter().zip(lengths) {
            let d = (a - p).norm().max(1e-12);
            let u = (a - p) / d;
            normal += u * u.transpose();
            gradient += u * (d - l);
        }
        let Some(cholesky) = normal.cholesky() else {
            damping *= 10.0;
            continue;
        };
        let step = cholesky.solve(&gradient);
        let next = a - step;
        let next_cost = cost(&next);
        if next_cost <= best || step.norm() < 1e-9 {
            (a, best) = (next, next_cost);
            damping = (damping * 0.1).max(1e-14);
        } else {
            damping *= 10.0;
        }
        if step.norm() < 1e-13 * (1.0 + a.norm()) {
            break;
        }
    }
    a
}
