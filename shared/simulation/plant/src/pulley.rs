//! The last guide of a cable, from which it leaves for the node: an eye, or a wheel that swivels or is fixed.
//!
//! The plant has its own geometry, found by the angle at which the cable leaves the rim, so that an error in the
//! geometry of the control software does not appear on both sides.
//!
//! The cable comes up to the anchor A from below, along the swivel axis of the wheel, and lies on the rim from A to the
//! point where it leaves. With the angle a from A to that point, over the top of the wheel, the point is at
//! A + r (1 - cos a) outward + r sin a up, and the cable leaves it along the rim's tangent,
//! (sin a) outward + (cos a) up. The node is on this tangent: (outward - r) cos a = up sin a - r, both measured from A.
//!
//! A wheel that swivels turns its plane to the node. A wheel that is fixed keeps its plane; the flange bends the cable
//! towards a node beside the plane at the point where it leaves.

use libm::{acos, atan2, cos, sin};
use nalgebra::Vector3;

use crate::error::{PlantError, check};

/// Horizontal distances below this have no direction, m.
const SHORTEST_M: f64 = 1e-6;

/// Share of the radius within which a node is taken to be outside the rim: a collision is not modelled.
const CLEARANCE: f64 = 1e-6;

/// What the cable runs over.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Guide {
    /// A point.
    #[default]
    Eye,
    /// A wheel that turns about the vertical axis through the anchor.
    Swivel {
        /// Radius to the middle of the cable, m.
        radius_m: f64,
    },
    /// A wheel in a vertical plane through the anchor.
    Fixed {
        /// Radius to the middle of the cable, m.
        radius_m: f64,
        /// Direction of the wheel's centre from the anchor, from x towards y, rad.
        azimuth_rad: f64,
    },
}

/// The cable from its anchor to the node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Path {
    /// Length on the rim and free, m.
    pub length_m: f64,
    /// Unit vector of the free part, towards the node.
    pub direction: Vector3<f64>,
    /// Length of the free part, m.
    pub free_m: f64,
}

impl Guide {
    pub(crate) fn validate(&self) -> Result<(), PlantError> {
        match *self {
            Self::Eye => Ok(()),
            Self::Swivel { radius_m } => check("radius_m", radius_m, "zero to 1 m", |r| (0.0..=1.0).contains(&r)),
            Self::Fixed { radius_m, azimuth_rad } => {
                check("radius_m", radius_m, "zero to 1 m", |r| (0.0..=1.0).contains(&r))?;
                check("azimuth_rad", azimuth_rad, "-7 to 7 rad", |a| a.abs() <= 7.0)
            }
        }
    }

    /// The cable to a node at `leg`, relative to the anchor (m).
    pub fn path(&self, leg: Vector3<f64>) -> Path {
        match *self {
            Self::Swivel { radius_m } if radius_m > 0.0 => {
                let p = libm::sqrt(leg.x * leg.x + leg.y * leg.y);
                // On the axis the wheel keeps some direction.
                let outward =
                    if p > SHORTEST_M { Vector3::new(leg.x / p, leg.y / p, 0.0) } else { Vector3::new(1.0, 0.0, 0.0) };
                over_rim(leg, radius_m, outward)
            }
            Self::Fixed { radius_m, azimuth_rad } if radius_m > 0.0 => {
                over_rim(leg, radius_m, Vector3::new(cos(azimuth_rad), sin(azimuth_rad), 0.0))
            }
            _ => {
                let length_m = leg.norm().max(SHORTEST_M);
                Path { length_m, direction: leg / length_m, free_m: length_m }
            }
        }
    }
}

/// The path over a rim of radius `r` in the vertical plane of the unit vector `outward`.
fn over_rim(leg: Vector3<f64>, r: f64, outward: Vector3<f64>) -> Path {
    // With x = outward - r: x cos a - up sin a = -r, so cos(a + b) = -r / c for x = c cos b, up = c sin b.
    let (x, up) = (leg.dot(&outward) - r, leg.z);
    let c = libm::sqrt(x * x + up * up).max(r * (1.0 + CLEARANCE));
    // Of the two tangents, the one on which the cable leaves in the direction in which it runs. A node above the anchor
    // and behind the wheel would need less than none of the rim.
    let angle = (acos(-r / c) - atan2(up, x)).max(0.0);
    let touch = outward * (r * (1.0 - cos(angle))) + Vector3::new(0.0, 0.0, r * sin(angle));
    let free = leg - touch;
    let free_m = free.norm().max(SHORTEST_M);
    Path { length_m: r * angle + free_m, direction: free / free_m, free_m }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Length of the shortest cable that goes up from the anchor, around the wheel and to the node, found without the
    /// formula: a polygon of a million corners on the rim, left where the rest is shortest.
    fn by_integration(leg: Vector3<f64>, r: f64, outward: Vector3<f64>) -> f64 {
        const STEPS: u32 = 200_000;
        let step = 1.5 * core::f64::consts::PI / f64::from(STEPS);
        let at = |a: f64| outward * (r * (1.0 - a.cos())) + Vector3::new(0.0, 0.0, r * a.sin());
        let (mut wound, mut best, mut last) = (0.0, f64::INFINITY, at(0.0));
        for i in 1..=STEPS {
            let a = f64::from(i) * step;
            let here = at(a);
            wound += (here - last).norm();
            last = here;
            let tangent = outward * a.sin() + Vector3::new(0.0, 0.0, a.cos());
            let rest = leg - here;
            // The free part must not pass through the wheel: it leaves along the tangent or outside it.
            let center = outward * r;
            if rest.dot(&(here - center)) >= -1e-9 && rest.dot(&tangent) > 0.0 {
                best = f64::min(best, wound + rest.norm());
            }
        }
        best
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]
        #[test]
        fn a_swivelling_wheel_agrees_with_the_numerical_integration_of_its_rim(
            x in -8.0..8.0f64, y in -8.0..8.0f64, z in -6.0..-0.1f64, r in 0.005..0.2f64
        ) {
            let leg = Vector3::new(x, y, z);
            let p = (x * x + y * y).sqrt();
            prop_assume!(p > 2.5 * r);
            let path = Guide::Swivel { radius_m: r }.path(leg);
            let oracle = by_integration(leg, r, Vector3::new(x / p, y / p, 0.0));
            prop_assert!((path.length_m - oracle).abs() < 2e-6, "{} {oracle}", path.length_m);
        }

        #[test]
        fn the_length_changes_by_the_direction_of_the_free_part(
            x in -8.0..8.0f64, y in -8.0..8.0f64, z in -6.0..2.0f64, r in 0.0..0.2f64
        ) {
            let leg = Vector3::new(x, y, z);
            prop_assume!((x * x + y * y).sqrt() > 3.0 * r + 0.1);
            let guide = Guide::Swivel { radius_m: r };
            let path = guide.path(leg);
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = 1e-6;
                let slope = (guide.path(leg + step).length_m - guide.path(leg - step).length_m) / 2e-6;
                prop_assert!((slope - path.direction[axis]).abs() < 1e-6, "{slope} {}", path.direction);
            }
        }
    }

    #[test]
    fn below_the_outer_rim_the_cable_hangs_after_half_a_turn() {
        let path = Guide::Swivel { radius_m: 0.04 }.path(Vector3::new(0.08, 0.0, -2.0));
        assert!((path.length_m - (2.0 + 0.04 * core::f64::consts::PI)).abs() < 1e-12);
        assert!((path.direction + Vector3::z()).norm() < 1e-9);
    }

    #[test]
    fn a_fixed_wheel_is_a_swivelling_one_in_its_plane_and_longer_beside_it() {
        let fixed = Guide::Fixed { radius_m: 0.05, azimuth_rad: 0.0 };
        let swivel = Guide::Swivel { radius_m: 0.05 };
        let inside = Vector3::new(4.0, 0.0, -2.0);
        assert_eq!(fixed.path(inside), swivel.path(inside));
        let beside = Vector3::new(3.0, 2.0, -2.0);
        let (fixed, swivel) = (fixed.path(beside).length_m, swivel.path(beside).length_m);
        assert!(fixed > swivel + 0.001 && fixed < swivel + 0.05, "{fixed} {swivel}");
    }

    #[test]
    fn no_radius_is_an_eye() {
        let leg = Vector3::new(1.0, -2.0, -3.0);
        assert_eq!(Guide::Swivel { radius_m: 0.0 }.path(leg), Guide::Eye.path(leg));
        assert_eq!(Guide::Eye.path(leg).length_m, leg.norm());
    }
}
