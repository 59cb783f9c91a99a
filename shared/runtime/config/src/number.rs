//! Numbers in messages about values that are not accepted.

use crate::Problem;

/// Displays a number in a sentence; very large and very small numbers in exponential notation.
pub struct Given(pub f64);

impl std::fmt::Display for Given {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self(value) = self;
        if value.is_finite() && *value != 0.0 && !(1e-6..1e9).contains(&value.abs()) {
            write!(f, "{value:e}")
        } else {
            write!(f, "{value}")
        }
    }
}

/// Refuses `value` unless it is finite and accepted.
///
/// # Errors
/// A problem at the key that states the value and what is accepted.
pub fn number(key: &str, value: f64, accepted: &str, ok: impl Fn(f64) -> bool) -> Result<(), Problem> {
    if value.is_finite() && ok(value) {
        Ok(())
    } else {
        Err(Problem::with_clause(key, format!("is {}; accepted: {accepted}", Given(value))))
    }
}
