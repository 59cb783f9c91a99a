//! The way of one cable from its anchor to the node: length, direction and curvature.
//!
//! From an *eye* (radius 0) the cable runs straight from the anchor A to the node. A *swivelling pulley* turns about
//! the vertical axis through A. The cable enters from below along this axis, runs over the wheel, and leaves on a
//! tangent.
//! For a node at the horizontal distance p and the height z above A (negative below), in the vertical plane through the
//! axis and the node, with coordinates (outward, up) from A:
//!
//! * the wheel's centre is (r, 0), at the distance c = √((p - r)² + z²) from the node; c > r, or no tangent exists;
//! * the free cable has the length t = √(c² - r²) = √(p (p - 2 r) + z²);
//! * the cable wraps the angle θ = π - atan2(z, p - r) - acos(r / c) and has the length t + r θ;
//! * its unit vector u from the touching point to the node is (r z + t (p - r), t z - r (p - r)) / c², so
//!   θ = atan2(u_out, u_up).
//!
//! The wrapped part and the free part exchange cable without change of length at the touching point, so dL/dX = u. The
//! touching point moves with the node, u turns by n·dX / t in the plane (n = (-u_up, u_out), from the wheel's centre to
//! the touching point) and by 1 / p about the axis: the second derivative of L is n nᵀ / t + (u_out / p) a aᵀ with the
//! horizontal unit vector a across the plane, which is (1 - u uᵀ) / t + (u_out / p - 1 / t) a aᵀ.
//! It is positive semidefinite, and L convex, where the node is farther from
//! the axis than the touching point (u_out >= 0); below the wheel that is p >= about 2 r.
//!
//! At p = 0 the direction outward is undefined: the pulley may turn to any side, L has a kink, and the pose is
//! singular.
//! A planar robot has the wheel in the plane y = 0, with outward to +x or -x.
//!
//! Positions and lengths in m. [`NoDirection`] states why a position has no direction.

mod geometry;
mod tangents;

use nalgebra::Vector3;

use geometry::SMALLEST_M;

pub use geometry::CableGeometry;
pub(crate) use tangents::{Both, PairOfCables, Tangents};

/// Why a cable has no direction at a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoDirection {
    /// The node is at the anchor, or its position is not finite.
    AtAnchor,
    /// The node is inside the wheel or on its rim, in the wheel's plane.
    InsidePulley,
    /// The node is on the swivel axis (p = 0), where the pulley may turn to any side.
    OnAxis,
}

/// Where a cable leaves for the node: an eye or a swivelling pulley.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulley {
    /// The anchor: the eye, or the point where the cable enters the wheel, m.
    pub anchor: Vector3<f64>,
    /// Radius of the wheel to the middle of the cable, m; 0 for an eye.
    pub radius_m: f64,
    /// Whether the wheel and the node stay in the plane y = 0.
    pub planar: bool,
}

impl Pulley {
    /// A pulley whose node moves in space.
    pub fn new(anchor: Vector3<f64>, radius_m: f64) -> Self {
        Self { anchor, radius_m, planar: false }
    }

    /// Computes the length to a position, m. It is the straight distance for an eye. On the axis of a pulley it is
    /// defined; inside the wheel it is NaN.
    pub fn length_m(&self, position: &Vector3<f64>) -> f64 {
        if self.radius_m == 0.0 {
            return (position - self.anchor).norm();
        }
        self.tangent(position).lengths_m()[0]
    }

    /// Computes length, direction and curvature at a position.
    ///
    /// ```
    /// use cable_robot::{Vector3, pulley::{Pulley, NoDirection}};
    /// let pulley = Pulley::new(Vector3::new(0.0, 0.0, 3.0), 0.04);
    /// // Below the outer rim the cable hangs straight down, after half a turn around the wheel.
    /// let below = pulley.cable_to(&Vector3::new(0.08, 0.0, 1.0)).unwrap();
    /// assert!((below.length_m - (2.0 + 0.04 * std::f64::consts::PI)).abs() < 1e-12);
    /// assert!((below.direction + Vector3::z()).norm() < 1e-12);
    /// assert_eq!(pulley.cable_to(&Vector3::new(0.05, 0.0, 3.0)).unwrap_err(), NoDirection::InsidePulley);
    /// assert_eq!(pulley.cable_to(&Vector3::new(0.0, 0.0, 1.0)).unwrap_err(), NoDirection::OnAxis);
    /// ```
    pub fn cable_to(&self, position: &Vector3<f64>) -> Result<CableGeometry, NoDirection> {
        if self.radius_m == 0.0 {
            return self.straight(position);
        }
        self.cable_over_wheel(position)
    }

    #[inline(never)]
    fn cable_over_wheel(&self, position: &Vector3<f64>) -> Result<CableGeometry, NoDirection> {
        Ok(self.checked(position)?.cables()[0])
    }

    /// Computes the direction alone, which needs no trigonometric function.
    pub fn direction(&self, position: &Vector3<f64>) -> Result<Vector3<f64>, NoDirection> {
        if self.radius_m == 0.0 {
            return self.straight(position).map(|cable| cable.direction);
        }
        Ok(self.checked(position)?.directions()[0])
    }

    /// Computes the direction and the length of the free cable, m, which need no trigonometric function.
    pub(crate) fn free_cable(&self, position: &Vector3<f64>) -> Result<(Vector3<f64>, f64), NoDirection> {
        if self.radius_m == 0.0 {
            return self.straight(position).map(|cable| (cable.direction, cable.free_m));
        }
        let tangent = self.checked(position)?;
        Ok((tangent.directions()[0], tangent.free_m()[0]))
    }

    /// The cable to a position, with the direction zero at an eye, and [`CableGeometry::NONE`] where a pulley has none.
    #[inline(always)]
    pub(crate) fn cable_at(&self, position: &Vector3<f64>) -> CableGeometry {
        if self.radius_m != 0.0 {
            return self.cable_over_wheel(position).unwrap_or(CableGeometry::NONE);
        }
        let d = position - self.anchor;
        let length_m = d.norm();
        let direction = if length_m > 0.0 { d / length_m } else { Vector3::zeros() };
        CableGeometry { length_m, direction, free_m: length_m, bend_per_m: 0.0, across: Vector3::zeros() }
    }

    /// The cable of an eye.
    fn straight(&self, position: &Vector3<f64>) -> Result<CableGeometry, NoDirection> {
        let d = position - self.anchor;
        let length_m = d.norm();
        // Also false for NaN.
        if !(length_m >= SMALLEST_M && length_m.is_finite()) {
            return Err(NoDirection::AtAnchor);
        }
        let (direction, across) = (d / length_m, Vector3::zeros());
        Ok(CableGeometry { length_m, direction, free_m: length_m, bend_per_m: 0.0, across })
    }

    #[inline]
    fn tangent(&self, position: &Vector3<f64>) -> Tangents {
        let Self { anchor, radius_m, planar } = *self;
        Tangents::of(&PairOfCables { anchors: &[anchor; 2], radii_m: &[radius_m; 2], planar }, position)
    }

    /// The tangent if it has a direction.
    fn checked(&self, position: &Vector3<f64>) -> Result<Tangents, NoDirection> {
        let tangent = self.tangent(position);
        if tangent.have_directions() {
            return Ok(tangent);
        }
        Err(if !(position - self.anchor).iter().all(|d| d.is_finite()) {
            NoDirection::AtAnchor
        } else if !(tangent.free_m()[0] >= SMALLEST_M) {
            NoDirection::InsidePulley
        } else {
            NoDirection::OnAxis
        })
    }
}
