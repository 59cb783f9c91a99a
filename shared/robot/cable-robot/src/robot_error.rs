//! Errors of the description of a robot, with the key of the robot file.

use thiserror::Error;

/// Error of a key of a robot's description: problem and accepted values in one sentence.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{key} {problem}; accepted: {accepted}")]
pub struct RobotError {
    /// Key of the robot file.
    pub key: &'static str,
    /// Description of the problem.
    pub problem: String,
    /// Accepted values.
    pub accepted: &'static str,
}

/// Magnitudes above this are in a wrong unit, m.
pub(crate) const FARTHEST_M: f64 = 1e5;

pub(crate) fn refuse<T>(
    key: &'static str,
    problem: impl Into<String>,
    accepted: &'static str,
) -> Result<T, RobotError> {
    Err(RobotError { key, problem: problem.into(), accepted })
}

pub(crate) fn positive(key: &'static str, value: f64, accepted: &'static str) -> Result<(), RobotError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { refuse(key, format!("is {value}"), accepted) }
}

pub(crate) fn not_negative(key: &'static str, value: f64, accepted: &'static str) -> Result<(), RobotError> {
    if value.is_finite() && value >= 0.0 { Ok(()) } else { refuse(key, format!("is {value}"), accepted) }
}
