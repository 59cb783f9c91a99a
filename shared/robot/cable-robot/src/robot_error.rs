//! What is wrong with the description of a robot, by key of the robot file.

use thiserror::Error;

/// A key of a robot's description and what is wrong with it, in one sentence.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{key} {problem}; accepted: {accepted}")]
pub struct RobotError {
    /// The key as the robot file spells it.
    pub key: &'static str,
    /// What was given.
    pub problem: String,
    /// What is accepted.
    pub accepted: &'static str,
}

/// Magnitudes above this are a wrong unit, m.
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
