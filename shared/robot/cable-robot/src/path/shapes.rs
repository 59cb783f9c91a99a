//! Shapes of paths with a closed form, and points of a path.

use nalgebra::Vector3;

/// Point of a path with its derivatives with respect to arc length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Unit tangent dX/ds; zero for a dwell.
    pub tangent: Vector3<f64>,
    /// Curvature vector d²X/ds², 1/m.
    pub curvature: Vector3<f64>,
}

/// A straight line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Start, m.
    pub from: Vector3<f64>,
    /// End, m.
    pub to: Vector3<f64>,
}

/// A parabola in the vertical plane through start and end (25)-(26): ẑ = µ x̂² + ζ x̂, with x̂ the horizontal distance
/// from the start. Positive µ sags below the straight line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parabola {
    /// Start, m.
    pub from: Vector3<f64>,
    /// End, m.
    pub to: Vector3<f64>,
    /// µ, 1/m.
    pub mu_per_m: f64,
}

/// A spiral about a vertical axis: radius and height change linearly with the angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spiral {
    /// Point on the axis at the height of the start, m.
    pub centre: Vector3<f64>,
    /// Radius at the start, m, 0 or more.
    pub start_radius_m: f64,
    /// Radius at the end, m, 0 or more.
    pub end_radius_m: f64,
    /// Number of turns, may be a fraction; positive is counter-clockwise seen from above.
    pub turns: f64,
    /// Height of the end above the start, m.
    pub rise_m: f64,
    /// Angle of the start from the x axis, rad.
    pub start_angle_rad: f64,
}

impl Line {
    pub(super) fn at(&self, s: f64) -> PathPoint {
        let d = self.to - self.from;
        let length = d.norm();
        let tangent = if length > 0.0 { d / length } else { Vector3::zeros() };
        let position = if s >= length { self.to } else { self.from + tangent * s.max(0.0) };
        PathPoint { position, tangent, curvature: Vector3::zeros() }
    }
}
