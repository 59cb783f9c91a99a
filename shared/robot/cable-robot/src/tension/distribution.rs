//! The ways to distribute tension, and why there is no distribution.

use thiserror::Error;

use crate::CableVec;
use crate::kinematics::KinematicsError;

/// Tensions this close to a limit keep it, as a share of the larger of force and limit: rounding.
pub(super) const TOLERANCE: f64 = 1e-10;

/// Forces above this are a wrong unit or an error, N; infinity as an upper limit of tension is not a force.
pub(super) const STRONGEST_N: f64 = 1e9;

/// Which of the feasible distributions is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Distribution {
    /// The only one: as many cables as directions.
    Unique,
    /// Least sum of squares (27), the least I²R loss of ideal motors. It moves continuously with the pose.
    LeastNorm,
    /// Least sum (37). It jumps between bounds where two cables' roles change.
    MinSum,
    /// Greatest distance to the nearest limit.
    Safest,
}

impl std::fmt::Display for Distribution {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Unique => "unique",
            Self::LeastNorm => "least-norm",
            Self::MinSum => "min-sum",
            Self::Safest => "safest",
        })
    }
}

/// A name that is no distribution.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{given:?} is no way to distribute tension; accepted: unique, least-norm, min-sum, safest")]
pub struct UnknownDistribution {
    /// What was given.
    pub given: String,
}

impl std::str::FromStr for Distribution {
    type Err = UnknownDistribution;

    /// As it is written, or with an underscore.
    fn from_str(name: &str) -> Result<Self, UnknownDistribution> {
        match name {
            "unique" => Ok(Self::Unique),
            "least-norm" | "least_norm" => Ok(Self::LeastNorm),
            "min-sum" | "min_sum" => Ok(Self::MinSum),
            "safest" => Ok(Self::Safest),
            _ => Err(UnknownDistribution { given: name.to_owned() }),
        }
    }
}

/// The line that cannot keep its limits, in the distribution that spreads the excess most evenly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// Index of the cable, from 0.
    pub cable: usize,
    /// The tension it would have, N.
    pub tension_n: f64,
    /// The limit it misses, N.
    pub limit_n: f64,
}

impl Violation {
    /// How far beyond the limit, N.
    pub fn excess_n(&self) -> f64 {
        (self.tension_n - self.limit_n).abs()
    }
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let side = if self.tension_n < self.limit_n { "below the lower" } else { "above the upper" };
        let (cable, tension, limit) = (self.cable + 1, self.tension_n, self.limit_n);
        write!(f, "cable {cable} would carry {tension:.2} N, {:.2} N {side} limit of {limit:.2} N", self.excess_n())
    }
}

/// No tensions, and why.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum TensionError {
    /// No distribution keeps the limits.
    #[error("no tensions within the limits hold the node: {0}")]
    Infeasible(Violation),
    /// The lines do not span the space at this pose.
    #[error("the lines do not hold the node in every direction here: it is in the plane of the anchors or at one")]
    Singular,
    /// The method does not fit the number of cables.
    #[error("the distribution {method} is not defined for {cables} cables; accepted: {accepted}")]
    Method {
        /// What was asked for.
        method: Distribution,
        /// How many cables there are.
        cables: usize,
        /// What can be asked for.
        accepted: &'static str,
    },
    /// A limit or force is not a number.
    #[error("{what} is {value}; accepted: {accepted}")]
    InvalidArgument {
        /// The quantity.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is accepted.
        accepted: &'static str,
    },
}

impl TensionError {
    /// The kind as a short word for other programs: `infeasible`, `singular` or `invalid_argument`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Infeasible(_) => "infeasible",
            Self::Singular => "singular",
            Self::Method { .. } | Self::InvalidArgument { .. } => "invalid_argument",
        }
    }
}

impl From<KinematicsError> for TensionError {
    fn from(_: KinematicsError) -> Self {
        Self::Singular
    }
}

/// A feasible distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tensions {
    /// Tension of each cable, N.
    pub tensions_n: CableVec,
    /// Least distance to a limit, N.
    pub margin_n: f64,
}

pub(super) fn check_limits([low, high]: [f64; 2]) -> Result<(), TensionError> {
    if !(0.0..=STRONGEST_N).contains(&low) {
        return Err(TensionError::InvalidArgument {
            what: "the lower tension limit",
            value: low,
            accepted: "0 N to 1e9 N",
        });
    }
    if !(high >= low) {
        let accepted = "no less than the lower limit, or infinity";
        return Err(TensionError::InvalidArgument { what: "the upper tension limit", value: high, accepted });
    }
    Ok(())
}

pub(super) fn check_wrench(wrench_n: &[f64]) -> Result<(), TensionError> {
    match wrench_n.iter().find(|v| !(v.abs() <= STRONGEST_N)) {
        None => Ok(()),
        Some(value) => Err(TensionError::InvalidArgument {
            what: "the force on the node",
            value: *value,
            accepted: "at most 1e9 N in each direction",
        }),
    }
}

/// Least distance to a limit, N; negative outside.
pub fn margin(tensions_n: &[f64], [low, high]: [f64; 2]) -> f64 {
    tensions_n.iter().fold(f64::INFINITY, |m, t| m.min(t - low).min(high - t))
}

/// The tension farthest outside the limits, if any is outside by more than rounding.
pub fn worst_violation(tensions_n: &[f64], [low, high]: [f64; 2]) -> Option<Violation> {
    let scale = tensions_n.iter().fold(low.max(1.0), |m, t| m.max(t.abs()));
    let mut worst: Option<Violation> = None;
    for (cable, t) in tensions_n.iter().enumerate() {
        let limit_n = if *t < low { low } else { high };
        let excess = (low - t).max(t - high);
        if excess > TOLERANCE * scale && worst.is_none_or(|w| excess > w.excess_n()) {
            worst = Some(Violation { cable, tension_n: *t, limit_n });
        }
    }
    worst
}
