//! Result and errors of the kinematics.

use nalgebra::Vector3;
use thiserror::Error;

use crate::pulley::{NoDirection, Pulley};

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
    /// The node is inside the wheel of a pulley.
    #[error(
        "the position ({:.3}, {:.3}, {:.3}) m lies inside the wheel of cable {cable}, whose radius is {radius_m} m; move it away from the anchor",
        position_m[0], position_m[1], position_m[2]
    )]
    InsidePulley {
        /// The cable, counted from 1.
        cable: usize,
        /// Radius of the wheel, m.
        radius_m: f64,
        /// The position, m.
        position_m: [f64; 3],
    },
    /// The node is on the swivel axis of a pulley, where the direction of the cable is undefined.
    #[error(
        "the position ({:.3}, {:.3}, {:.3}) m is singular: it lies on the vertical axis of the pulley of cable {cable}, which may turn to any side; move it sideways",
        position_m[0], position_m[1], position_m[2]
    )]
    OnPulleyAxis {
        /// The cable, counted from 1.
        cable: usize,
        /// The position, m.
        position_m: [f64; 3],
    },
    /// The iteration with pulleys ended without a position.
    #[error("no position found: the lengths are missed by {residual_m:.3e} m after all iterations; check the lengths")]
    NotConverged {
        /// Root mean square of the remaining differences, m.
        residual_m: f64,
    },
}

impl KinematicsError {
    /// Error kind for programs: `invalid_argument`, `degenerate_geometry`, `unreachable`, `ambiguous`, `singular` or
    /// `not_converged`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::InvalidArgument { .. } | Self::WrongCount { .. } => "invalid_argument",
            Self::DegenerateGeometry => "degenerate_geometry",
            Self::Unreachable { .. } => "unreachable",
            Self::Ambiguous => "ambiguous",
            Self::Singular { .. } | Self::InsidePulley { .. } | Self::OnPulleyAxis { .. } => "singular",
            Self::NotConverged { .. } => "not_converged",
        }
    }

    /// Creates the error for a cable, counted from 0, that has no direction at a position.
    pub fn without_direction(why: NoDirection, cable: usize, pulley: &Pulley, position: &Vector3<f64>) -> Self {
        let (cable, position_m, radius_m) = (cable + 1, (*position).into(), pulley.radius_m);
        match why {
            NoDirection::AtAnchor => Self::singular(position),
            NoDirection::InsidePulley => Self::InsidePulley { cable, radius_m, position_m },
            NoDirection::OnAxis => Self::OnPulleyAxis { cable, position_m },
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
    /// The other position with these lengths; only for as many cables as directions. With pulleys it may be None
    /// although the other position exists: [`super::mirror_position`] computes it.
    pub mirror: Option<Vector3<f64>>,
    /// Root mean square of (length at the position - given length), m; 0 for three cables.
    pub residual_rms_m: f64,
}
