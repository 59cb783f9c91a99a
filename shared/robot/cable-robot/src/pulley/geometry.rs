//! A cable to one position of the node.

use nalgebra::{Matrix3, Vector3};

/// Smallest distance at which a direction is defined, m.
pub(crate) const SMALLEST_M: f64 = 1e-9;

/// A cable from its anchor to the node at one position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CableGeometry {
    /// Length from the anchor, including the part on the wheel, m.
    pub length_m: f64,
    /// Derivative of the length with respect to the position: unit vector of the free cable toward the node.
    pub direction: Vector3<f64>,
    /// Length of the free cable, m.
    pub free_m: f64,
    /// How much faster the direction turns about the axis than in the plane: u_out / p - 1 / t, 1/m. 0 for an eye and
    /// for a planar robot.
    pub(crate) bend_per_m: f64,
    /// Unit vector across the plane of the wheel; zero for an eye.
    pub(crate) across: Vector3<f64>,
}

impl CableGeometry {
    /// A cable without a direction.
    pub(crate) const NONE: Self = {
        let not = Vector3::new(f64::NAN, f64::NAN, f64::NAN);
        Self { length_m: f64::NAN, direction: not, free_m: f64::NAN, bend_per_m: f64::NAN, across: not }
    };

    /// Second derivative of the length with respect to the position, 1/m; symmetric. For a planar robot the entry of y,
    /// which has no effect, is 1 / `free_m`.
    pub fn curvature(&self) -> Matrix3<f64> {
        let (u, a) = (&self.direction, &self.across);
        let as_from_an_eye = (Matrix3::identity() - u * u.transpose()) * (1.0 / self.free_m);
        if self.bend_per_m == 0.0 { as_from_an_eye } else { as_from_an_eye + a * a.transpose() * self.bend_per_m }
    }
}
