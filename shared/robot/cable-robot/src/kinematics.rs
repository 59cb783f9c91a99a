//! Lengths, positions and velocities: (6)-(14).
//!
//! Lengths are N numbers in m: straight-line distances from eyes, and with pulleys the lengths of [`crate::pulley`].
//! Positions are 3-vectors in m. J of (14) is N x 3; its rows are unit vectors of the free cables toward the node, from
//! the anchors or from the touching points, so that cable velocities are J times the node velocity. B is J⁻¹, or the
//! pseudo-inverse for more than three cables; the structure matrix Λ = -Jᵀ is 3 x N. Unreachable or ambiguous lengths,
//! a singular pose and anchors on one line are a [`KinematicsError`].

mod matrices;
mod newton;
mod pulleys;
mod solution;
mod trilateration;

pub use matrices::{Jacobian, NodeJacobian, StructureMatrix};
pub use solution::{Forward, KinematicsError, LONGEST_M};
pub(crate) use trilateration::{COLLINEAR_TOLERANCE, Frame, fits_worse};
pub use trilateration::{Pair, trilaterate};

use nalgebra::{Matrix3, Vector3};

use crate::pulley::Tangents;
use crate::{Anchors, CableVec, linalg, planar};
use trilateration::{best_pair, choose, residuals};

/// Spheres that miss each other by this share of the squared length count as touching: rounding of lengths measured
/// with the node in the plane of the anchors.
const TOUCH_TOLERANCE: f64 = 1e-9;

/// Bound of the least-squares iteration, which needs about five steps.
const MAX_ITERATIONS: usize = 50;

/// Computes the lengths from the anchors to a position, m (6): straight lines from eyes, and for pulleys the part on
/// the wheel in addition. NaN for a node inside a wheel; [`lengths_at`] is the same with an error.
pub fn inverse_kinematics(anchors: &Anchors, position: &Vector3<f64>) -> CableVec {
    if let Some(pairs) = anchors.pairs_of_pulleys() {
        let lengths_m = pairs.map(|pair| Tangents::of(&pair, position).lengths_m());
        return CableVec::from_pairs(anchors.len(), lengths_m);
    }
    CableVec::from_fn(anchors.len(), |i| match anchors.radii_m()[i] {
        0.0 => (position - anchors[i]).norm(),
        _ => anchors.pulley(i).length_m(position),
    })
}

/// Like [`inverse_kinematics`], and rejects positions inside a wheel or on the axis of a pulley, m.
pub fn lengths_at(anchors: &Anchors, position: &Vector3<f64>) -> Result<CableVec, KinematicsError> {
    check_pulleys(anchors, position)?;
    Ok(inverse_kinematics(anchors, position))
}

/// Rejects positions at which the cable over a pulley has no direction; eyes are not checked.
pub(crate) fn check_pulleys(anchors: &Anchors, position: &Vector3<f64>) -> Result<(), KinematicsError> {
    if !anchors.have_pulleys() {
        return Ok(());
    }
    for (i, pulley) in anchors.pulleys().enumerate().filter(|(_, pulley)| pulley.radius_m != 0.0) {
        pulley.direction(position).map_err(|why| KinematicsError::without_direction(why, i, &pulley, position))?;
    }
    Ok(())
}

/// Computes the position with these lengths: closed form for eyes and as many cables as directions, least squares in
/// length for more or with pulleys. The search starts at `near` if that position is certainly the nearest solution,
/// otherwise at the intersections of spheres around eyes.
///
/// Of two mirror solutions, the one nearer to `near` if given, otherwise the lower one. With more than three cables the
/// mirror solutions do not fit equally well; the lower one is chosen unless the upper one fits clearly better.
///
/// ```
/// use cable_robot::Anchors;
/// use cable_robot::Vector3;
/// use cable_robot::kinematics::*;
/// let anchors = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.1], [8.0, 8.0, 3.2], [0.0, 9.0, 3.3]])?;
/// let p = Vector3::new(4.0, 4.5, 1.0);
/// let found = forward_kinematics(&anchors, &inverse_kinematics(&anchors, &p), None)?;
/// assert!((found.position - p).norm() < 1e-9 && found.residual_rms_m < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn forward_kinematics(
    anchors: &Anchors,
    lengths_m: &[f64],
    near: Option<&Vector3<f64>>,
) -> Result<Forward, KinematicsError> {
    if anchors.is_planar() && !anchors.have_pulleys() {
        return planar::forward_kinematics(anchors, lengths_m, near);
    }
    if lengths_m.len() != anchors.len() {
        return Err(KinematicsError::WrongCount { given: lengths_m.len(), cables: anchors.len() });
    }
    if let Some(i) = lengths_m.iter().position(|l| !(0.0..=LONGEST_M).contains(l)) {
        return Err(KinematicsError::InvalidArgument { what: "length", cable: i + 1, value: lengths_m[i] });
    }
    if anchors.len() == 3 && !anchors.have_pulleys() {
        let frame = anchors.frame().ok_or(KinematicsError::DegenerateGeometry)?;
        let pair = frame.intersect([lengths_m[0], lengths_m[1], lengths_m[2]]);
        let tolerance = TOUCH_TOLERANCE * lengths_m.iter().fold(0.0, |m: f64, l| m.max(l * l));
        if pair.height_squared < -tolerance {
            return Err(KinematicsError::Unreachable { shortfall_m: (-pair.height_squared).sqrt() });
        }
        let (position, mirror) = choose(pair.points, near)?;
        return Ok(Forward { position, mirror: Some(mirror), residual_rms_m: 0.0 });
    }
    if let Some(found) = near.filter(|_| !anchors.is_planar()).and_then(|near| newton::near(anchors, lengths_m, near)) {
        let residual_rms_m = if anchors.len() == 3 { 0.0 } else { (found.cost / anchors.len() as f64).sqrt() };
        return Ok(Forward { position: found.position, mirror: None, residual_rms_m });
    }
    if anchors.have_pulleys() {
        return pulleys::forward_kinematics(anchors, lengths_m, near);
    }
    least_squares(anchors, lengths_m, near, |start| {
        let quick = newton::near(anchors, lengths_m, &start);
        quick.map_or_else(|| descend(anchors, lengths_m, start), |found| found.position)
    })
}

/// Computes the other position with these lengths, on the other side of the plane of the anchors from `position`, for
/// as many cables as directions; None if there is none. For eyes it is the mirror image, which [`forward_kinematics`]
/// also returns; with pulleys it is not, and costs an iteration of its own.
pub fn mirror_position(anchors: &Anchors, lengths_m: &[f64], position: &Vector3<f64>) -> Option<Vector3<f64>> {
    if anchors.have_pulleys() {
        return pulleys::mirror(anchors, lengths_m, position);
    }
    forward_kinematics(anchors, lengths_m, Some(position)).ok()?.mirror
}

/// Least squares in length, found by `search` from the best triple of cables and from its mirror image.
fn least_squares(
    anchors: &Anchors,
    l: &[f64],
    near: Option<&Vector3<f64>>,
    search: impl Fn(Vector3<f64>) -> Vector3<f64>,
) -> Result<Forward, KinematicsError> {
    let n = anchors.len();
    let starts = best_pair(anchors, l).ok_or(KinematicsError::DegenerateGeometry)?;
    let found = starts.map(search);
    let rms = found.map(|p| (residuals(anchors, l, &p) / n as f64).sqrt());
    let fits_worse = |a: f64, b: f64| fits_worse(a, b, l);
    let position = match near {
        Some(_) => choose(found, near)?.0,
        None if fits_worse(rms[0], rms[1]) => found[1],
        None if fits_worse(rms[1], rms[0]) => found[0],
        None => choose(found, None)?.0,
    };
    let residual_rms_m = (residuals(anchors, l, &position) / n as f64).sqrt();
    Ok(Forward { position, mirror: None, residual_rms_m })
}

/// Levenberg-Marquardt on sum (|x - a_i| - L_i)² in three unknowns.
fn descend(anchors: &Anchors, lengths: &[f64], start: Vector3<f64>) -> Vector3<f64> {
    let mut x = start;
    let mut cost = residuals(anchors, lengths, &x);
    let mut damping = 1e-12;
    for _ in 0..MAX_ITERATIONS {
        let mut normal = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        for (a, l) in anchors.iter().zip(lengths) {
            let d = x - a;
            let length = d.norm();
            if length > 0.0 {
                let u = d / length;
                normal += linalg::outer(&u, &u);
                gradient += u * (length - l);
            }
        }
        let damped = normal + Matrix3::identity() * damping;
        let Some(step) = linalg::solve_spd(&damped, &gradient) else {
            damping = (damping * 10.0).max(1e-9);
            continue;
        };
        let next = x - step;
        let next_cost = residuals(anchors, lengths, &next);
        // Near the minimum, rounding hides the decrease of the cost: accept undamped steps.
        let close = damping <= 1e-9 && step.norm() <= 1e-7 * (1.0 + x.norm());
        if next_cost <= cost || close {
            let done = step.norm() <= 1e-14 * (1.0 + x.norm());
            (x, cost) = (next, next_cost);
            damping = (damping * 0.1).max(1e-12);
            if done {
                break;
            }
        } else {
            if step.norm() <= 1e-12 * (1.0 + x.norm()) {
                break;
            }
            damping = (damping * 10.0).max(1e-6);
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn random_anchors(n: usize) -> impl Strategy<Value = Anchors> {
        proptest::collection::vec([-6.0..6.0f64, -6.0..6.0f64, 2.5..4.0f64], n).prop_filter_map(
            "spread",
            |mut points| {
                // Corners of a polygon with random offsets, so that no three are collinear.
                let n = points.len() as f64;
                for (i, p) in points.iter_mut().enumerate() {
                    let angle = 2.0 * std::f64::consts::PI * i as f64 / n;
                    p[0] = 6.0 * libm::cos(angle) + 0.2 * p[0];
                    p[1] = 6.0 * libm::sin(angle) + 0.2 * p[1];
                }
                Anchors::new(&points).ok()
            },
        )
    }

    fn inside() -> impl Strategy<Value = Vector3<f64>> {
        [-2.0..2.0f64, -2.0..2.0f64, -1.0..2.0f64].prop_map(Vector3::from)
    }

    /// The form of the paper, (7)-(12), in its frame: anchor 1 at the origin, anchor 2 on the x axis.
    fn paper_form(a2: [f64; 2], a3: [f64; 3], l: [f64; 3]) -> Vector3<f64> {
        let ([x2, z2], [x3, y3, z3], [l1, l2, l3]) = (a2, a3, l);
        let alpha = -z2 / x2;
        let beta = (z2 * z2 + x2 * x2 + l1 * l1 - l2 * l2) / (2.0 * x2);
        let lambda = -(alpha * x3 + z3) / y3;
        let gamma = (l1 * l1 - l3 * l3 + x3 * x3 + y3 * y3 + z3 * z3 - 2.0 * beta * x3) / (2.0 * y3);
        let a = alpha * alpha + lambda * lambda + 1.0;
        let b = 2.0 * (alpha * beta + gamma * lambda);
        let c = beta * beta + gamma * gamma - l1 * l1;
        let z = (-b - (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
        Vector3::new(alpha * z + beta, lambda * z + gamma, z)
    }

    proptest! {
        #[test]
        fn forward_undoes_inverse_for_any_count(n in 3usize..=8, seed in inside(), anchors in (3usize..=8).prop_flat_map(random_anchors)) {
            let _ = n;
            let l = inverse_kinematics(&anchors, &seed);
            let found = forward_kinematics(&anchors, &l, None).unwrap();
            prop_assert!((found.position - seed).norm() < 1e-8, "{found:?} {seed:?}");
            prop_assert!(found.residual_rms_m < 1e-9);
        }

        #[test]
        fn closed_form_agrees_with_the_papers(anchors in random_anchors(3), p in inside()) {
            // Transform to the paper's frame: shift anchor 1 to the origin and rotate anchor 2 to y = 0.
            let (a, l) = (&anchors, inverse_kinematics(&anchors, &p));
            let (d2, d3, dp) = (a[1] - a[0], a[2] - a[0], p - a[0]);
            let r = (d2.x * d2.x + d2.y * d2.y).sqrt();
            let (c, s) = (d2.x / r, d2.y / r);
            let turn = |v: Vector3<f64>| Vector3::new(c * v.x + s * v.y, c * v.y - s * v.x, v.z);
            let t3 = turn(d3);
            let paper = paper_form([r, d2.z], [t3.x, t3.y, t3.z], [l[0], l[1], l[2]]);
            prop_assert!((paper - turn(dp)).norm() < 1e-8);
            let ours = forward_kinematics(&anchors, &l, None).unwrap().position;
            prop_assert!((turn(ours - a[0]) - paper).norm() < 1e-8);
        }

        #[test]
        fn jacobian_is_the_derivative_of_the_lengths(anchors in (3usize..=8).prop_flat_map(random_anchors), p in inside()) {
            let j = Jacobian::at(&anchors, &p).unwrap();
            let h = 1e-5;
            for k in 0..3 {
                let mut d = Vector3::zeros();
                d[k] = h;
                let (up, down) = (inverse_kinematics(&anchors, &(p + d)), inverse_kinematics(&anchors, &(p - d)));
                for i in 0..anchors.len() {
                    prop_assert!(((up[i] - down[i]) / (2.0 * h) - j[i][k]).abs() < 1e-8);
                }
            }
        }

        #[test]
        fn node_jacobian_undoes_the_jacobian(anchors in (3usize..=8).prop_flat_map(random_anchors), p in inside(), v in inside()) {
            let j = Jacobian::at(&anchors, &p).unwrap();
            let b = j.node_jacobian().unwrap();
            prop_assert!((b.node_velocity(&j.cable_velocity(&v)) - v).norm() < 1e-9);
        }

        #[test]
        fn noisy_lengths_end_at_a_stationary_point(anchors in random_anchors(4), p in inside(), noise in proptest::collection::vec(-0.02..0.02f64, 4)) {
            let l = inverse_kinematics(&anchors, &p).zip_map(&noise, |l, e| l + e);
            let found = forward_kinematics(&anchors, &l, None).unwrap();
            let j = Jacobian::at(&anchors, &found.position).unwrap();
            let at = inverse_kinematics(&anchors, &found.position);
            let gradient = (0..4).fold(Vector3::zeros(), |g, i| g + j[i] * (at[i] - l[i]));
            prop_assert!(gradient.norm() < 1e-9, "{gradient:?}");
            prop_assert!(found.residual_rms_m <= 0.02);
        }
    }

    fn anchors3() -> Anchors {
        Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.2], [4.0, 8.0, 2.9]]).unwrap()
    }

    #[test]
    fn mirror_and_hint_pick_the_branch() {
        let a = anchors3();
        let p = Vector3::new(4.0, 3.0, 1.0);
        let l = inverse_kinematics(&a, &p);
        let lower = forward_kinematics(&a, &l, None).unwrap();
        let mirror = lower.mirror.unwrap();
        assert!(mirror.z > 3.0);
        let upper = forward_kinematics(&a, &l, Some(&mirror)).unwrap();
        assert!((upper.position - mirror).norm() < 1e-12);
        assert!((upper.mirror.unwrap() - p).norm() < 1e-9);
    }

    #[test]
    fn coplanar_four_anchors_give_the_lower_of_two_images() {
        let a = Anchors::new(&[[0.0, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 10.0, 6.0], [0.0, 10.0, 6.0]]).unwrap();
        let p = Vector3::new(3.0, 4.0, 2.0);
        let l = inverse_kinematics(&a, &p);
        assert!((forward_kinematics(&a, &l, None).unwrap().position - p).norm() < 1e-9);
        let above = Vector3::new(3.0, 4.0, 9.0);
        assert!((forward_kinematics(&a, &l, Some(&above)).unwrap().position.z - 10.0).abs() < 1e-9);
    }

    #[test]
    fn noise_does_not_throw_the_node_above_nearly_coplanar_anchors() {
        let a = Anchors::new(&[[0.0, 0.0, 6.0], [10.0, 0.0, 6.004], [10.0, 10.0, 6.0], [0.0, 10.0, 6.004]]).unwrap();
        let p = Vector3::new(3.0, 4.0, 2.0);
        for code in 0..81 {
            let noise = [code % 3, code / 3 % 3, code / 9 % 3, code / 27].map(|c| 5e-3 * (f64::from(c) - 1.0));
            let l = inverse_kinematics(&a, &p).zip_map(&noise, |l, e| l + e);
            let found = forward_kinematics(&a, &l, None).unwrap();
            assert!((found.position - p).norm() < 0.03, "{found:?}");
        }
    }

    #[test]
    fn a_vertical_anchor_plane_is_ambiguous_without_a_hint() {
        let a = Anchors::new(&[[0.0, 0.0, 1.0], [9.0, 0.0, 3.2], [4.0, 0.0, 5.0]]).unwrap();
        let p = Vector3::new(4.0, 3.0, 1.0);
        let l = inverse_kinematics(&a, &p);
        assert_eq!(forward_kinematics(&a, &l, None), Err(KinematicsError::Ambiguous));
        let found = forward_kinematics(&a, &l, Some(&Vector3::new(4.0, 2.0, 1.0))).unwrap();
        assert!((found.position - p).norm() < 1e-9);
    }

    #[test]
    fn anchors_one_above_the_other_are_no_obstacle() {
        // Horizontally collinear, which the form in the paper cannot solve.
        let a = Anchors::new(&[[0.0, 0.0, 3.0], [0.0, 0.0, 5.0], [4.0, 1.0, 4.0]]).unwrap();
        let p = Vector3::new(2.0, 3.0, 1.0);
        let l = inverse_kinematics(&a, &p);
        assert!((forward_kinematics(&a, &l, Some(&p)).unwrap().position - p).norm() < 1e-9);
    }

    #[test]
    fn errors_are_typed_and_say_what_to_do() {
        let a = anchors3();
        let cases: [(&[f64], &str); 4] = [
            (&[1.0, 1.0, 1.0], "unreachable"),
            (&[5.0, f64::NAN, 5.0], "invalid_argument"),
            (&[5.0, -5.0, 5.0], "invalid_argument"),
            (&[5.0, 5.0], "invalid_argument"),
        ];
        for (l, kind) in cases {
            assert_eq!(forward_kinematics(&a, l, None).unwrap_err().kind(), kind);
        }
        let line = Anchors::new(&[[0.0, 0.0, 3.0], [4.0, 0.0, 3.0], [9.0, 0.0, 3.0]]).unwrap();
        assert_eq!(forward_kinematics(&line, &[5.0, 5.0, 6.0], None).unwrap_err(), KinematicsError::DegenerateGeometry);
        let in_plane = Vector3::new(3.0, 3.0, 3.0);
        let flat = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [4.0, 8.0, 3.0]]).unwrap();
        assert_eq!(NodeJacobian::at(&flat, &in_plane).unwrap_err().kind(), "singular");
        assert_eq!(Jacobian::at(&flat, &flat[1]).unwrap_err().kind(), "singular");
    }

    #[test]
    fn a_position_in_the_anchor_plane_is_still_found() {
        let a = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [4.0, 8.0, 3.0]]).unwrap();
        let p = Vector3::new(3.7, 2.9, 3.0);
        let l = inverse_kinematics(&a, &p);
        let found = forward_kinematics(&a, &l, None).unwrap().position;
        assert!((found - p).norm() < 1e-3, "the error is the square root of the rounding of the lengths: {found:?}");
    }
}
