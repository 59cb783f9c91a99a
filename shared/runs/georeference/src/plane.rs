//! The plane that maps lie in.

/// Where a map lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plane {
    /// x and y.
    Level,
    /// x and z: that of a planar robot.
    Upright,
}

impl Plane {
    /// The coordinates of a place in it.
    #[must_use]
    pub fn of(self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        match self {
            Self::Level => [x, y],
            Self::Upright => [x, z],
        }
    }

    /// Their names.
    #[must_use]
    pub fn axes(self) -> [&'static str; 2] {
        match self {
            Self::Level => ["x", "y"],
            Self::Upright => ["x", "z"],
        }
    }
}
