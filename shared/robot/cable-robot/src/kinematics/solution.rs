//! Result and errors of the kinematics.

use nalgebra::Vector3;
use thiserror::Error;

/// Longest accepted length, m; beyond it, squares and their differences lose millimetres.
pub const LONGEST_M: f64 = 1e5;

/// Error of the kinematics.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum KinematicsError {
    /// An argument has the wrong shape or is not a number.
    #[error("{what} of cable {cable} is {value}; give one value of 0 m to {LONGEST_M} m per cable")]
    InvalidArgument {
        /// Name of the quantity.
        what: &'static str,
        /// The cable, counted from 1.
        cable: usize,
        /// Value given.
        value: f64,
    },
    /// The number of values is not the number of cables.
    #[error("{given} values were given for {cables} cables; give one per cable")]
    WrongCount {
        /// Number of values given.
        given: usize,
        /// Number of cables.
        cables: usize,
    },
    /// The anchors lie on one line.
    #[error("the anchors lie on one line, so lengths do not determine a position; move an anchor sideways")]
    DegenerateGeometry,
    /// The spheres do not intersect.
    #[error("no position has these lengths: the cables are {shortfall_m:.4} m too short to meet")]
    Unreachable {
        /// Distance by which the spheres miss each other, m.
        shortfall_m: f64,
    },
    /// Two mirror positions at the same height and no hint.
    #[error("two positions at the same height have these lengths; give a position near the right one")]
    Ambiguous,
    /// Singular pose: in the plane of the anchors, or at an anchor.
    #[error("the position ({x:.3}, {y:.3}, {z:.3}) m is singular: it lies in the plane of the anchors or at an anchor")]
    Singular {
        /// x of the position, m.
        x: f64,
        /// y of the position, m.
        y: f64,
        /// z of the position, m.
        z: f64,
    },
}

impl KinematicsError {
    /// Error kind for programs: `invalid_argument`, `degenerate_geometry`, `unreachable`, `ambiguous` or `singular`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::InvalidArgument { .. } | Self::WrongCount { .. } => "invalid_argument",
            Self::DegenerateGeometry => "degenerate_geometry",
            Self::Unreachable { .. } => "unreachable",
            Self::Ambiguous => "ambiguous",
            Self::Singular { .. } => "singular",
        }
    }

    pub(crate) fn singular(p: &Vector3<f64>) -> Self {
        Self::Singular { x: p.x, y: p.y, z: p.z }
    }
}

/// A position computed from lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forward {
    /// The position, m.
    pub position: Vector3<f64>,
    /// The other intersection of the spheres; only for three cables.
    pub mirror: Option<Vector3<f64>>,
    /// Root mean square of (length at the position - given length), m; 0 for three cables.
    pub residual_rms_m: f64,
}
