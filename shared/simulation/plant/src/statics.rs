//! Tensions that hold the node at rest.

use nalgebra::{Matrix3, Vector3};

use crate::MAX_CABLES;

/// Computes the least-norm tensions within `limits_n` whose sum along the unit vectors `pulls` (node to
/// anchor) is `wrench_n`.
///
/// The optimum has the form `T = clamp(Aᵀ λ)`; `λ` has three components for any number of cables and results from
/// Newton's method on the convex dual. Three cables that are not in one plane have a unique solution. `None` if no
/// tensions within the limits give the wrench. Unused entries of the result are zero.
pub fn hanging_tensions_n(
    pulls: &[Vector3<f64>],
    wrench_n: Vector3<f64>,
    limits_n: [f64; 2],
) -> Option<[f64; MAX_CABLES]> {
    let tensions = |lambda: Vector3<f64>| {
        let mut out = [0.0; MAX_CABLES];
        for (tension, pull) in out.iter_mut().zip(pulls) {
            *tension = pull.dot(&lambda).clamp(limits_n[0], limits_n[1]);
        }
        out
    };
    let residual = |lambda: Vector3<f64>| {
        let held: Vector3<f64> = pulls.iter().zip(tensions(lambda)).map(|(pull, tension)| pull * tension).sum();
        held - wrench_n
    };
    // The dual function, whose gradient is the residual; only for the line search.
    let dual = |lambda: Vector3<f64>| {
        let cables: f64 = pulls
            .iter()
            .map(|pull| {
                let x = pull.dot(&lambda);
                let t = x.clamp(limits_n[0], limits_n[1]);
                t * x - 0.5 * t * t
            })
            .sum();
        cables - wrench_n.dot(&lambda)
    };
    let tolerance_n = 1e-10 * (1.0 + wrench_n.norm());
    let middle = 0.5 * (limits_n[0] + limits_n[1].min(limits_n[0] + 10.0 * (1.0 + wrench_n.norm())));
    let sum: Vector3<f64> = pulls.iter().sum();
    let mut lambda = if sum.norm() > 1e-9 { sum * (middle / sum.norm()) } else { Vector3::zeros() };
    for _ in 0..200 {
        let force = residual(lambda);
        if force.norm() < tolerance_n {
            return Some(tensions(lambda));
        }
        let mut curvature = Matrix3::identity() * 1e-12;
        for pull in pulls {
            let x = pull.dot(&lambda);
            // A cable at its limit keeps a small curvature; otherwise Newton's step would be unbounded.
            let weight = if x > limits_n[0] && x < limits_n[1] { 1.0 } else { 1e-6 };
            curvature += pull * pull.transpose() * weight;
        }
        let direction = -curvature.try_inverse()? * force;
        let (start, slope) = (dual(lambda), force.dot(&direction));
        let mut step = 1.0;
        while dual(lambda + direction * step) > start + 1e-4 * step * slope && step > 1e-12 {
            step *= 0.5;
        }
        lambda += direction * step;
    }
    (residual(lambda).norm() < 1e-6 * (1.0 + wrench_n.norm())).then(|| tensions(lambda))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pulls(anchors: &[[f64; 3]], node: [f64; 3]) -> Vec<Vector3<f64>> {
        anchors.iter().map(|a| (Vector3::from(*a) - Vector3::from(node)).normalize()).collect()
    }

    const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 6.0], [10.0, 0.0, 6.2], [10.0, 10.0, 5.9], [0.0, 10.0, 6.1]];

    proptest! {
        #[test]
        fn four_cables_agree_with_a_scan_of_the_null_space(x in 1.0..9.0f64, y in 1.0..9.0f64, z in 0.5..4.0f64) {
            let pulls = pulls(&SQUARE, [x, y, z]);
            let wrench = Vector3::new(0.0, 0.0, 20.0);
            let limits = [1.0, 150.0];
            let found = hanging_tensions_n(&pulls, wrench, limits);
            // Independent solution: vary the last tension, solve the other three, keep the best.
            let a = Matrix3::from_columns(&[pulls[0], pulls[1], pulls[2]]).try_inverse().unwrap();
            let best = (0..=14_900)
                .filter_map(|i| {
                    let last = 1.0 + 0.01 * f64::from(i);
                    let rest = a * (wrench - pulls[3] * last);
                    let inside = rest.iter().all(|t| (limits[0]..=limits[1]).contains(t));
                    inside.then(|| rest.norm_squared() + last * last)
                })
                .fold(f64::INFINITY, f64::min);
            if let Some(t) = found {
                let held: Vector3<f64> = pulls.iter().zip(t).map(|(p, t)| p * t).sum();
                prop_assert!((held - wrench).norm() < 1e-5);
                let norm: f64 = t.iter().map(|t| t * t).sum();
                prop_assert!(norm <= best + 1e-4 * best, "{norm} {best}");
            } else {
                prop_assert!(best.is_infinite(), "missed a solution of norm {best}");
            }
        }
    }

    #[test]
    fn three_cables_have_one_solution_and_none_outside() {
        let inside = pulls(&SQUARE[..3], [6.0, 4.0, 2.0]);
        let wrench = Vector3::new(0.0, 0.0, 12.0);
        let t = hanging_tensions_n(&inside, wrench, [0.0, 500.0]).unwrap();
        let direct = Matrix3::from_columns(&[inside[0], inside[1], inside[2]]).try_inverse().unwrap() * wrench;
        for i in 0..3 {
            assert!((t[i] - direct[i]).abs() < 1e-8);
        }
        let outside = pulls(&SQUARE[..3], [1.0, 9.0, 2.0]);
        assert_eq!(hanging_tensions_n(&outside, wrench, [0.0, 500.0]), None);
    }

    #[test]
    fn one_cable_holds_a_node_directly_below_it() {
        let t = hanging_tensions_n(&[Vector3::z()], Vector3::new(0.0, 0.0, 7.0), [0.0, 100.0]).unwrap();
        assert!((t[0] - 7.0).abs() < 1e-9);
    }
}
