//! Kinematics of a robot in the x-z plane with eyes: two directions, two to eight cables. Points have y = 0.
//!
//! [`crate::tension::general`] computes the tensions of such a robot, and [`crate::energy`] the cost of its moves.
//!
//! N lengths in m determine x and z in m (6)-(12); a failure is a [`KinematicsError`].

use nalgebra::{Vector2, Vector3};

use crate::MAX_CABLES;
use crate::kinematics::{Forward, KinematicsError, LONGEST_M, fits_worse};

/// Circles that miss each other by this share of the squared length count as touching: rounding.
const TOUCH_TOLERANCE: f64 = 1e-9;

/// Bound of the least-squares iteration, which needs about five steps.
const MAX_ITERATIONS: usize = 50;

/// Computes the position with these straight-line lengths: the intersection of two circles, least squares in length for
/// more than two cables. Of two mirror solutions, the one nearer to `near` if given, otherwise the lower one.
///
/// ```
/// use cable_robot::Vector3;
/// use cable_robot::planar::forward_kinematics;
/// let anchors = [Vector3::new(0.0, 0.0, 4.0), Vector3::new(6.0, 0.0, 4.0)];
/// let found = forward_kinematics(&anchors, &[5.0, 5.0], None)?;
/// assert!((found.position - Vector3::new(3.0, 0.0, 0.0)).norm() < 1e-12);
/// # Ok::<(), cable_robot::KinematicsError>(())
/// ```
pub fn forward_kinematics(
    anchors: &[Vector3<f64>],
    lengths_m: &[f64],
    near: Option<&Vector3<f64>>,
) -> Result<Forward, KinematicsError> {
    let n = anchors.len();
    if lengths_m.len() != n || !(2..=MAX_CABLES).contains(&n) {
        return Err(KinematicsError::WrongCount { given: lengths_m.len(), cables: n });
    }
    if let Some(i) = lengths_m.iter().position(|l| !(0.0..=LONGEST_M).contains(l)) {
        return Err(KinematicsError::InvalidArgument { what: "length", cable: i + 1, value: lengths_m[i] });
    }
    let mut flat = [Vector2::zeros(); MAX_CABLES];
    for (f, a) in flat.iter_mut().zip(anchors) {
        *f = Vector2::new(a.x, a.z);
    }
    let flat = &flat[..n];
    let hint = near.map(|p| Vector2::new(p.x, p.z));
    let lift = |p: Vector2<f64>| Vector3::new(p.x, 0.0, p.y);
    if n == 2 {
        let (points, height_squared) = intersect_circles(&flat[0], &flat[1], lengths_m[0], lengths_m[1])?;
        let longest = lengths_m[0].max(lengths_m[1]);
        if height_squared < -TOUCH_TOLERANCE * longest * longest {
            return Err(KinematicsError::Unreachable { shortfall_m: (-height_squared).sqrt() });
        }
        let (position, mirror) = choose(points, hint)?;
        return Ok(Forward { position: lift(position), mirror: Some(lift(mirror)), residual_rms_m: 0.0 });
    }
    let rms = |p: &Vector2<f64>| (squares(flat, lengths_m, p) / n as f64).sqrt();
    let starts = best_pair(flat, lengths_m).ok_or(KinematicsError::DegenerateGeometry)?;
    let found = starts.map(|start| descend(flat, lengths_m, start));
    let worse = |a: usize, b: usize| fits_worse(rms(&found[a]), rms(&found[b]), lengths_m);
    let position = match hint {
        None if worse(0, 1) => found[1],
        None if worse(1, 0) => found[0],
        _ => choose(found, hint)?.0,
    };
    Ok(Forward { position: lift(position), mirror: None, residual_rms_m: rms(&position) })
}

/// Returns the best intersection of all pairs of circles around anchors in the plane y = 0, and its mirror image.
pub(crate) fn starting_points(anchors: &[Vector3<f64>], lengths_m: &[f64]) -> Option<[Vector3<f64>; 2]> {
    let mut flat = [Vector2::zeros(); MAX_CABLES];
    for (f, a) in flat.iter_mut().zip(anchors) {
        *f = Vector2::new(a.x, a.z);
    }
    let n = anchors.len().min(lengths_m.len()).min(MAX_CABLES);
    Some(best_pair(&flat[..n], &lengths_m[..n])?.map(|p| Vector3::new(p.x, 0.0, p.y)))
}

/// Returns the best starting point of all pairs of circles, and its mirror image; None if no pair has distinct centres.
fn best_pair(flat: &[Vector2<f64>], lengths_m: &[f64]) -> Option<[Vector2<f64>; 2]> {
    let n = flat.len();
    let rms = |p: &Vector2<f64>| (squares(flat, lengths_m, p) / n as f64).sqrt();
    let mut starts: Option<(f64, [Vector2<f64>; 2])> = None;
    for i in 0..n {
        for j in i + 1..n {
            let Ok((points, _)) = intersect_circles(&flat[i], &flat[j], lengths_m[i], lengths_m[j]) else { continue };
            let least = rms(&points[0]).min(rms(&points[1]));
            if starts.as_ref().is_none_or(|(best, _)| least < *best) {
                starts = Some((least, points));
            }
        }
    }
    starts.map(|(_, points)| points)
}

/// Intersections of two circles, and the squared distance of these points from the line of centres; negative if the
/// circles do not intersect.
fn intersect_circles(
    a: &Vector2<f64>,
    b: &Vector2<f64>,
    ra: f64,
    rb: f64,
) -> Result<([Vector2<f64>; 2], f64), KinematicsError> {
    let d = b - a;
    let length = d.norm();
    if !(length >= 1e-3) {
        return Err(KinematicsError::DegenerateGeometry);
    }
    let along = d / length;
    let x = ((ra - rb) * (ra + rb) + length * length) / (2.0 * length);
    let height_squared = (ra - x) * (ra + x);
    let across = Vector2::new(-along.y, along.x) * height_squared.max(0.0).sqrt();
    let foot = a + along * x;
    Ok(([foot - across, foot + across], height_squared))
}

fn choose(
    [a, b]: [Vector2<f64>; 2],
    hint: Option<Vector2<f64>>,
) -> Result<(Vector2<f64>, Vector2<f64>), KinematicsError> {
    let first = match hint {
        Some(hint) => (a - hint).norm_squared() <= (b - hint).norm_squared(),
        None => {
            let apart = (a - b).norm();
            if apart > 1e-9 && (a.y - b.y).abs() < 1e-9 * apart.max(1.0) {
                return Err(KinematicsError::Ambiguous);
            }
            a.y <= b.y
        }
    };
    Ok(if first { (a, b) } else { (b, a) })
}

fn squares(anchors: &[Vector2<f64>], lengths: &[f64], x: &Vector2<f64>) -> f64 {
    anchors.iter().zip(lengths).map(|(a, l)| ((x - a).norm() - l) * ((x - a).norm() - l)).sum()
}

/// Levenberg-Marquardt on sum (|x - a_i| - L_i)² in two unknowns.
fn descend(anchors: &[Vector2<f64>], lengths: &[f64], start: Vector2<f64>) -> Vector2<f64> {
    let (mut x, mut cost, mut damping) = (start, squares(anchors, lengths, &start), 1e-12);
    for _ in 0..MAX_ITERATIONS {
        let (mut xx, mut xz, mut zz, mut g) = (damping, 0.0, damping, Vector2::zeros());
        for (a, l) in anchors.iter().zip(lengths) {
            let d = x - a;
            let length = d.norm();
            if length > 0.0 {
                let u = d / length;
                (xx, xz, zz) = (xx + u.x * u.x, xz + u.x * u.y, zz + u.y * u.y);
                g += u * (length - l);
            }
        }
        let det = xx * zz - xz * xz;
        let step = Vector2::new(zz * g.x - xz * g.y, xx * g.y - xz * g.x) / det;
        let next = x - step;
        let next_cost = squares(anchors, lengths, &next);
        let close = damping <= 1e-9 && step.norm() <= 1e-7 * (1.0 + x.norm());
        if step.norm().is_finite() && (next_cost <= cost || close) {
            let done = step.norm() <= 1e-14 * (1.0 + x.norm());
            (x, cost, damping) = (next, next_cost, (damping * 0.1).max(1e-12));
            if done {
                break;
            }
        } else {
            damping = (damping * 10.0).max(1e-9);
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn anchors(n: usize) -> Vec<Vector3<f64>> {
        [[0.0, 0.2], [12.0, 0.0], [11.8, 5.1], [0.1, 5.0], [6.0, 5.5]][..n]
            .iter()
            .map(|[x, z]| Vector3::new(*x, 0.0, *z))
            .collect()
    }

    proptest! {
        #[test]
        fn forward_undoes_inverse(n in 3usize..=5, x in 0.5..11.5f64, z in 0.3..4.8f64) {
            let (anchors, p) = (anchors(n), Vector3::new(x, 0.0, z));
            let lengths: Vec<f64> = anchors.iter().map(|a| (a - p).norm()).collect();
            let found = forward_kinematics(&anchors, &lengths, None).unwrap();
            prop_assert!((found.position - p).norm() < 1e-9 && found.residual_rms_m < 1e-9, "{found:?}");
        }

        #[test]
        fn two_cables_have_two_answers(x in 0.5..11.5f64, z in -3.0..0.05f64) {
            let (anchors, p) = (anchors(2), Vector3::new(x, 0.0, z - 0.2));
            let lengths: Vec<f64> = anchors.iter().map(|a| (a - p).norm()).collect();
            let found = forward_kinematics(&anchors, &lengths, None).unwrap();
            prop_assert!((found.position - p).norm() < 1e-6, "{found:?}");
            let above = forward_kinematics(&anchors, &lengths, Some(&Vector3::new(x, 0.0, 5.0))).unwrap();
            prop_assert!((above.position - found.mirror.unwrap()).norm() < 1e-12 && above.position.z > p.z);
        }

        #[test]
        fn no_position_near_by_fits_noisy_lengths_better(x in 2.0..10.0f64, z in 1.0..4.0f64, noise in [-0.02..0.02f64, -0.02..0.02, -0.02..0.02, -0.02..0.02]) {
            let (anchors, p) = (anchors(4), Vector3::new(x, 0.0, z));
            let lengths: Vec<f64> = anchors.iter().zip(noise).map(|(a, e)| (a - p).norm() + e).collect();
            let found = forward_kinematics(&anchors, &lengths, None).unwrap();
            let rms = |p: Vector3<f64>| (anchors.iter().zip(&lengths).map(|(a, l)| ((a - p).norm() - l).powi(2)).sum::<f64>() / 4.0).sqrt();
            for (dx, dz) in [(1e-4, 0.0), (-1e-4, 0.0), (0.0, 1e-4), (0.0, -1e-4)] {
                prop_assert!(rms(found.position + Vector3::new(dx, 0.0, dz)) >= found.residual_rms_m - 1e-12);
            }
        }
    }

    #[test]
    fn errors_are_those_of_space() {
        let a = anchors(2);
        assert_eq!(forward_kinematics(&a, &[1.0, 1.0], None).unwrap_err().kind(), "unreachable");
        assert_eq!(forward_kinematics(&a, &[9.0], None).unwrap_err().kind(), "invalid_argument");
        assert_eq!(forward_kinematics(&a, &[9.0, f64::NAN], None).unwrap_err().kind(), "invalid_argument");
        assert_eq!(forward_kinematics(&[a[0], a[0]], &[9.0, 9.0], None).unwrap_err().kind(), "degenerate_geometry");
        let mast = [Vector3::new(0.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 4.0)];
        assert_eq!(forward_kinematics(&mast, &[3.0, 3.0], None).unwrap_err(), KinematicsError::Ambiguous);
    }
}
