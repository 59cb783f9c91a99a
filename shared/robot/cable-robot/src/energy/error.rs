//! Errors of the cost of a move.

use thiserror::Error;

use super::current::TableError;
use crate::motion::Refusal;
use crate::tension::TensionError;

/// Error of a cost that cannot be computed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EnergyError {
    /// A parameter outside its range.
    #[error("{what} is {value}; accepted: {accepted}")]
    InvalidArgument {
        /// Name of the parameter.
        what: &'static str,
        /// Value of the quantity.
        value: f64,
        /// Accepted values.
        accepted: &'static str,
    },
    /// Start and end coincide.
    #[error("start and end of the move coincide; give two different points")]
    NoDistance,
    /// An end of the move is below the ground.
    #[error("the move has an end at a height of {height_m} m, below the ground at {ground_m} m; raise it")]
    BelowGround {
        /// Height of the lower end, m.
        height_m: f64,
        /// Height of the ground, m.
        ground_m: f64,
    },
    /// The cables cannot hold the node at a point of the path.
    #[error("at ({x:.3}, {y:.3}, {z:.3}) m: {why}")]
    Tension {
        /// x of the position, m.
        x: f64,
        /// y of the position, m.
        y: f64,
        /// z of the position, m.
        z: f64,
        /// Reason.
        why: TensionError,
    },
    /// The measured table does not cover the move.
    #[error(transparent)]
    Table(#[from] TableError),
    /// A check of the whole segment rejects the path.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

impl EnergyError {
    /// Error kind for programs: `invalid_argument`, `degenerate_geometry`, `infeasible`, `singular` or `out_of_range`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::InvalidArgument { .. } | Self::BelowGround { .. } => "invalid_argument",
            Self::NoDistance => "degenerate_geometry",
            Self::Tension { why, .. } => why.kind(),
            Self::Table(error) => error.kind(),
            Self::Refused(_) => "infeasible",
        }
    }

    /// True if this path is impossible but another path between the same ends may be possible.
    pub fn is_of_the_path(&self) -> bool {
        matches!(self.kind(), "infeasible" | "singular" | "out_of_range")
    }
}
