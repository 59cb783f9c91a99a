//! The sagging path of (25)-(26), parametrised by its horizontal fraction u from 0 to 1. A vertical move has no sag:
//! its path is the straight line for every µ.
//!
//! Positions in m, tangents dX/du in m, µ in 1/m. An invalid µ or end is an [`EnergyError`].

use nalgebra::Vector3;

use super::EnergyError;
use crate::path::{Parabola, Path, SHORTEST_M};

/// Point of a path and its derivative with respect to the horizontal fraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FractionPoint {
    /// Position, m.
    pub position: Vector3<f64>,
    /// dX/du, m.
    pub tangent: Vector3<f64>,
}

/// True if start and end have the same x and y, so that the path is a vertical line.
pub fn is_vertical(path: &Parabola) -> bool {
    path.extent() < SHORTEST_M
}

/// Rejects coordinates that are not finite and moves of zero length.
pub fn check(path: &Parabola) -> Result<(), EnergyError> {
    let values = path.from.iter().chain(path.to.iter()).chain([&path.mu_per_m]);
    if let Some(value) = values.into_iter().find(|v| !(v.abs() <= crate::kinematics::LONGEST_M)) {
        let (what, accepted) = ("a coordinate or mu_per_m", "finite numbers up to 1e5");
        return Err(EnergyError::InvalidArgument { what, value: *value, accepted });
    }
    if (path.to - path.from).norm() < SHORTEST_M {
        return Err(EnergyError::NoDistance);
    }
    Ok(())
}

/// Returns the point at a horizontal fraction.
///
/// ```
/// use cable_robot::Vector3;
/// use cable_robot::energy::parabola;
/// use cable_robot::path::Parabola;
/// let path = Parabola { from: Vector3::new(0.0, 0.0, 2.0), to: Vector3::new(4.0, 3.0, 2.0), mu_per_m: 0.1 };
/// let middle = parabola::at_fraction(&path, 0.5);
/// assert!((middle.position.z - (2.0 - 0.1 * 2.5 * 2.5)).abs() < 1e-12 && middle.tangent.z.abs() < 1e-12);
/// ```
pub fn at_fraction(path: &Parabola, u: f64) -> FractionPoint {
    let d = path.to - path.from;
    if is_vertical(path) {
        return FractionPoint { position: path.from + d * u, tangent: d };
    }
    let xf = path.extent();
    // ẑ = µ x̂² + ζ x̂ with ζ = zf / xf - µ xf (26), so that ẑ = zf u - µ xf² u (1 - u).
    let sag = path.mu_per_m * xf * xf;
    let position = path.from + Vector3::new(d.x * u, d.y * u, d.z * u - sag * u * (1.0 - u));
    FractionPoint { position, tangent: Vector3::new(d.x, d.y, d.z - sag * (1.0 - 2.0 * u)) }
}

/// Arc length, m.
pub fn length_m(path: &Parabola) -> f64 {
    if is_vertical(path) { (path.to - path.from).norm() } else { Path::Parabola(*path).length() }
}

/// Lowest height of the path, m.
pub fn lowest_m(path: &Parabola) -> f64 {
    if is_vertical(path) { path.from.z.min(path.to.z) } else { path.lowest_m() }
}

/// Largest µ, 1/m, with which the path stays at or above the ground: ((√hA + √hB) / xf)² with the heights of its ends
/// above the ground. None for a vertical path, which has no such limit.
///
/// ```
/// use cable_robot::Vector3;
/// use cable_robot::energy::parabola;
/// let (from, to) = (Vector3::new(0.0, 0.0, 1.0), Vector3::new(4.0, 0.0, 1.0));
/// assert_eq!(parabola::mu_limit(&from, &to, 0.0)?, Some(0.25));
/// # Ok::<(), cable_robot::energy::EnergyError>(())
/// ```
pub fn mu_limit(from: &Vector3<f64>, to: &Vector3<f64>, ground_m: f64) -> Result<Option<f64>, EnergyError> {
    let line = Parabola { from: *from, to: *to, mu_per_m: 0.0 };
    check(&line)?;
    if !(ground_m.abs() <= crate::kinematics::LONGEST_M) {
        let (what, accepted) = ("ground_m", "a finite height up to 1e5 m");
        return Err(EnergyError::InvalidArgument { what, value: ground_m, accepted });
    }
    let (a, b) = (from.z - ground_m, to.z - ground_m);
    if a.min(b) < 0.0 {
        return Err(EnergyError::BelowGround { height_m: from.z.min(to.z), ground_m });
    }
    let root = (a.sqrt() + b.sqrt()) / line.extent();
    Ok((!is_vertical(&line)).then_some(root * root))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parabolas() -> impl Strategy<Value = Parabola> {
        ([-5.0..5.0f64, -5.0..5.0, 0.0..4.0], [-5.0..5.0f64, -5.0..5.0, 0.0..4.0], 0.0..2.0f64)
            .prop_map(|(a, b, mu_per_m)| Parabola { from: Vector3::from(a), to: Vector3::from(b), mu_per_m })
            .prop_filter("apart", |p| p.extent() > 0.1)
    }

    proptest! {
        #[test]
        fn it_is_the_parabola_of_25_and_26(p in parabolas(), u in 0.0..1.0f64) {
            let xf = p.extent();
            let x = u * xf;
            let point = at_fraction(&p, u);
            let z = p.from.z + p.mu_per_m * x * x + p.zeta() * x;
            prop_assert!((point.position.z - z).abs() < 1e-9 && (point.position - p.from).xy().norm() - x < 1e-9);
            let h = 1e-6;
            let difference = (at_fraction(&p, u + h).position - at_fraction(&p, u - h).position) / (2.0 * h);
            prop_assert!((difference - point.tangent).norm() < 1e-6);
        }

        #[test]
        fn length_is_that_of_a_fine_polyline(p in parabolas()) {
            let n = 20_000;
            let points = (0..=n).map(|i| at_fraction(&p, f64::from(i) / f64::from(n)).position);
            let (_, length) = points.fold((p.from, 0.0), |(before, sum), at| (at, sum + (at - before).norm()));
            prop_assert!((length_m(&p) - length).abs() < 1e-6 * length);
        }

        #[test]
        fn the_deepest_parabola_touches_the_ground(p in parabolas(), ground in -2.0..0.0f64) {
            let mu = mu_limit(&p.from, &p.to, ground).unwrap().unwrap();
            let lowest = |mu_per_m: f64| lowest_m(&Parabola { mu_per_m, ..p });
            prop_assert!((lowest(mu) - ground).abs() < 1e-9 * (1.0 + mu * p.extent() * p.extent()));
            prop_assert!(lowest(0.99 * mu) >= ground && lowest(1.01 * mu) < ground);
            let sampled = (0..=2000).map(|i| at_fraction(&Parabola { mu_per_m: mu, ..p }, f64::from(i) / 2000.0).position.z);
            prop_assert!(sampled.fold(f64::INFINITY, f64::min) > ground - 1e-9);
        }
    }

    #[test]
    fn a_vertical_move_is_a_line_whatever_mu() {
        let p = Parabola { from: Vector3::new(1.0, 2.0, 0.5), to: Vector3::new(1.0, 2.0, 2.5), mu_per_m: 3.0 };
        assert_eq!(at_fraction(&p, 0.25).position, Vector3::new(1.0, 2.0, 1.0));
        assert_eq!((length_m(&p), lowest_m(&p)), (2.0, 0.5));
        assert_eq!(mu_limit(&p.from, &p.to, 0.0), Ok(None));
    }

    #[test]
    fn flat_parabolas_have_the_length_of_the_line() {
        for mu_per_m in [0.0, 1e-300, 1e-12, 1e-9] {
            let p = Parabola { from: Vector3::zeros(), to: Vector3::new(3.0, 0.0, 4.0), mu_per_m };
            assert!((length_m(&p) - 5.0).abs() < 1e-8, "{mu_per_m}");
        }
    }

    #[test]
    fn moves_below_the_ground_or_to_nowhere_are_refused() {
        let (a, b) = (Vector3::new(0.0, 0.0, 0.5), Vector3::new(1.0, 0.0, 0.5));
        assert_eq!(mu_limit(&a, &b, 0.6).unwrap_err().kind(), "invalid_argument");
        assert_eq!(mu_limit(&a, &a, 0.0).unwrap_err().kind(), "degenerate_geometry");
        assert_eq!(mu_limit(&a, &b, f64::NAN).unwrap_err().kind(), "invalid_argument");
        assert_eq!(mu_limit(&Vector3::zeros(), &Vector3::new(2.0, 0.0, 0.0), 0.0), Ok(Some(0.0)));
    }
}
