//! Planes of maps.

/// Plane of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plane {
    /// Horizontal: x and y.
    Level,
    /// Vertical: x and z, for a planar robot.
    Upright,
}

impl Plane {
    /// Projects a position onto the plane.
    #[must_use]
    pub fn project(self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        match self {
            Self::Level => [x, y],
            Self::Upright => [x, z],
        }
    }

    /// Returns the coordinate across the plane.
    #[must_use]
    pub fn across(self, [_, y, z]: [f64; 3]) -> f64 {
        match self {
            Self::Level => z,
            Self::Upright => y,
        }
    }

    /// Returns the name of the coordinate across the plane.
    #[must_use]
    pub fn across_axis(self) -> &'static str {
        match self {
            Self::Level => "z",
            Self::Upright => "y",
        }
    }

    /// Returns the names of its coordinates.
    #[must_use]
    pub fn axes(self) -> [&'static str; 2] {
        match self {
            Self::Level => ["x", "y"],
            Self::Upright => ["x", "z"],
        }
    }
}
