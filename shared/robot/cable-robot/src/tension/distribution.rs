//! Names, results and errors of tension distributions.

use thiserror::Error;

use crate::CableVec;
use crate::kinematics::KinematicsError;

/// Tensions this close to a limit keep it, as a share of the larger of force and limit: rounding.
pub(super) const TOLERANCE: f64 = 1e-10;

/// Forces above this are in a wrong unit or erroneous, N; only an upper tension limit may be infinite.
pub(super) const STRONGEST_N: f64 = 1e9;

/// Method that selects one of the feasible distributions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Distribution {
    /// The only distribution of as many cables as directions.
    Unique,
    /// Least sum of squares (27), the least I²R loss of ideal motors. It is continuous in the pose.
    LeastNorm,
    /// Least sum (37). It jumps between bounds where the roles of two cables change.
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

/// Error: a name that is not a distribution.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{given:?} is not a tension distribution; accepted: unique, least-norm, min-sum, safest")]
pub struct UnknownDistribution {
    /// Name given.
    pub given: String,
}

impl std::str::FromStr for Distribution {
    type Err = UnknownDistribution;

    /// Parses the displayed name, with a hyphen or an underscore.
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

/// The cable that violates a limit, in the distribution that spreads the excess most evenly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// Index of the cable, from 0.
    pub cable: usize,
    /// Tension of the cable, N.
    pub tension_n: f64,
    /// Violated limit, N.
    pub limit_n: f64,
}

impl Violation {
    /// Distance beyond the limit, N.
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

/// Why there are no tensions.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum TensionError {
    /// No distribution keeps the limits.
    #[error("no tensions within the limits hold the node: {0}")]
    Infeasible(Violation),
    /// The cables do not span all directions at this pose.
    #[error("the cables do not hold the node in every direction here: it is in the plane of the anchors or at one")]
    Singular,
    /// The method does not fit the number of cables.
    #[error("the distribution {method} is not defined for {cables} cables; accepted: {accepted}")]
    Method {
        /// Requested distribution.
        method: Distribution,
        /// Number of cables.
        cables: usize,
        /// Accepted distributions or numbers of cables.
        accepted: &'static str,
    },
    /// A limit or force is not a number.
    #[error("{what} is {value}; accepted: {accepted}")]
    InvalidArgument {
        /// Name of the quantity.
        what: &'static str,
        /// Value of the quantity.
        value: f64,
        /// Accepted values.
        accepted: &'static str,
    },
}

impl TensionError {
    /// Error kind for programs: `infeasible`, `singular` or `invalid_argument`.
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
    /// Smallest distance to a limit, N.
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

/// Smallest distance to a limit, N; negative outside.
pub fn margin(tensions_n: &[f64], [low, high]: [f64; 2]) -> f64 {
    tensions_n.iter().fold(f64::INFINITY, |m, t| m.min(t - low).min(high - t))
}

/// Returns the tension farthest outside the limits, if any is outside by more than rounding.
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
