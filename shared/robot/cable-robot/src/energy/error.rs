//! Why the cost of a move cannot be told.

use thiserror::Error;

use super::current::TableError;
use crate::motion::Refusal;
use crate::tension::TensionError;

/// A move whose cost cannot be told.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum EnergyError {
    /// A parameter outside its range.
    #[error("{what} is {value}; accepted: {accepted}")]
    InvalidArgument {
        /// The parameter.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted.
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
    /// The lines cannot hold the node on the way.
    #[error("at ({x:.3}, {y:.3}, {z:.3}) m: {why}")]
    Tension {
        /// x of the position, m.
        x: f64,
        /// y of the position, m.
        y: f64,
        /// z of the position, m.
        z: f64,
        /// Why not.
        why: TensionError,
    },
    /// The measured table does not cover the move.
    #[error(transparent)]
    Table(#[from] TableError),
    /// The robot may not fly it.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

impl EnergyError {
    /// The kind as a short word for other programs: `invalid_argument`, `degenerate_geometry`, `infeasible`, `singular` or
    /// `out_of_range`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::InvalidArgument { .. } | Self::BelowGround { .. } => "invalid_argument",
            Self::NoDistance => "degenerate_geometry",
            Self::Tension { why, .. } => why.kind(),
            Self::Table(error) => error.kind(),
            Self::Refused(_) => "infeasible",
        }
    }

    /// True if this path cannot be flown, but another between the same ends might.
    pub fn is_of_the_path(&self) -> bool {
        matches!(self.kind(), "infeasible" | "singular" | "out_of_range")
    }
}
