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
//! horizontal unit vector a across the plane. It is positive semidefinite, and L convex, where the node is farther from
//! the axis than the touching point (u_out >= 0); below the wheel that is p >= about 2 r.
//!
//! At p = 0 the direction outward is undefined: the pulley may turn to any side, L has a kink, and the pose is
//! singular.
//! A planar robot has the wheel in the plane y = 0, with outward to +x or -x.
//!
//! Positions and lengths in m. [`NoDirection`] states why a position has no direction.

use nalgebra::{Matrix3, Vector3};

use crate::angle;

/// Smallest distance at which a direction is defined, m.
const SMALLEST_M: f64 = 1e-9;

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

/// A cable from its anchor to the node at one position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CableGeometry {
    /// Length from the anchor, including the part on the wheel, m.
    pub length_m: f64,
    /// Derivative of the length with respect to the position: unit vector of the free cable toward the node.
    pub direction: Vector3<f64>,
    /// Length of the free cable, m.
    pub free_m: f64,
    /// How fast the direction turns about the axis: u_out / p, 1/m; for an eye 1 / length.
    sideways_per_m: f64,
    /// Unit vector across the plane of the wheel; None for an eye.
    across: Option<Vector3<f64>>,
}

impl CableGeometry {
    /// Second derivative of the length with respect to the position, 1/m; symmetric. For a planar robot the entry of y,
    /// which has no effect, is 1 / `free_m`.
    pub fn curvature(&self) -> Matrix3<f64> {
        let u = &self.direction;
        match &self.across {
            None => (Matrix3::identity() - u * u.transpose()) * self.sideways_per_m,
            Some(a) => {
                let n = a.cross(u);
                n * n.transpose() * (1.0 / self.free_m) + a * a.transpose() * self.sideways_per_m
            }
        }
    }
}

/// The tangent in the plane of the wheel.
struct Tangent {
    /// Horizontal distance from the axis, m.
    p: f64,
    /// Unit vector outward in x and y; zero on the axis.
    outward: [f64; 2],
    /// Free length, m; NaN inside the wheel.
    free: f64,
    /// Unit vector of the free cable: outward and up.
    out: f64,
    up: f64,
    /// Height of the node above the anchor, m.
    z: f64,
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
        self.length_of(&self.tangent(position))
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
        let at = self.tangent(position);
        let [ex, ey] = at.outward;
        Ok(CableGeometry {
            direction: self.direction_of(&at)?,
            length_m: self.length_of(&at),
            free_m: at.free,
            sideways_per_m: if self.planar { 1.0 / at.free } else { at.out / at.p },
            across: Some(Vector3::new(-ey, ex, 0.0)),
        })
    }

    /// Computes the direction alone, which needs no trigonometric function.
    pub fn direction(&self, position: &Vector3<f64>) -> Result<Vector3<f64>, NoDirection> {
        if self.radius_m == 0.0 {
            return self.straight(position).map(|cable| cable.direction);
        }
        self.direction_of(&self.tangent(position))
    }

    /// Computes the direction and the length of the free cable, m, which need no trigonometric function.
    pub(crate) fn free_cable(&self, position: &Vector3<f64>) -> Result<(Vector3<f64>, f64), NoDirection> {
        if self.radius_m == 0.0 {
            return self.straight(position).map(|cable| (cable.direction, cable.free_m));
        }
        let at = self.tangent(position);
        Ok((self.direction_of(&at)?, at.free))
    }

    /// The cable of an eye.
    fn straight(&self, position: &Vector3<f64>) -> Result<CableGeometry, NoDirection> {
        let d = position - self.anchor;
        let length_m = d.norm();
        // Also false for NaN.
        if !(length_m >= SMALLEST_M && length_m.is_finite()) {
            return Err(NoDirection::AtAnchor);
        }
        let (direction, sideways_per_m) = (d / length_m, 1.0 / length_m);
        Ok(CableGeometry { length_m, direction, free_m: length_m, sideways_per_m, across: None })
    }

    #[inline]
    fn tangent(&self, position: &Vector3<f64>) -> Tangent {
        let (d, r) = (position - self.anchor, self.radius_m);
        let (p, outward) = if self.planar {
            (d.x.abs(), [if d.x < 0.0 { -1.0 } else { 1.0 }, 0.0])
        } else {
            let p = (d.x * d.x + d.y * d.y).sqrt();
            let per_p = if p > 0.0 { 1.0 / p } else { 0.0 };
            (p, [d.x * per_p, d.y * per_p])
        };
        let (q, z) = (p - r, d.z);
        let free = (p * (p - 2.0 * r) + z * z).sqrt();
        let per_square = 1.0 / (q * q + z * z);
        Tangent { p, outward, free, out: (r * z + free * q) * per_square, up: (free * z - r * q) * per_square, z }
    }

    fn direction_of(&self, at: &Tangent) -> Result<Vector3<f64>, NoDirection> {
        if !at.p.is_finite() || !at.z.is_finite() {
            return Err(NoDirection::AtAnchor);
        }
        if !(at.free >= SMALLEST_M) {
            return Err(NoDirection::InsidePulley);
        }
        if at.p < SMALLEST_M {
            return Err(NoDirection::OnAxis);
        }
        Ok(Vector3::new(at.outward[0] * at.out, at.outward[1] * at.out, at.up))
    }

    #[inline]
    fn length_of(&self, at: &Tangent) -> f64 {
        let turn = angle::from_unit(at.out, at.up);
        // Only below the wheel the cable wraps more than half a turn; above, a negative angle is rounding.
        let wrapped = if turn < 0.0 && at.z < 0.0 { turn + 2.0 * std::f64::consts::PI } else { turn };
        at.free + self.radius_m * wrapped
    }
}
