//! What cannot be used, in one sentence each.

use thiserror::Error;

/// A grid that cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SurveyError {
    /// A number is outside what makes sense for it.
    #[error("{key} is {value}, but has to be {accepted}")]
    Value {
        /// Name of the field, with its unit as suffix.
        key: &'static str,
        /// What was given.
        value: f64,
        /// What would be accepted.
        accepted: &'static str,
    },
    /// More cells than memory is meant for.
    #[error(
        "a grid of {columns} x {rows} cells is too large: at most {most} cells, so give larger cells or a smaller area"
    )]
    Cells {
        /// Cells along x.
        columns: usize,
        /// Cells along y.
        rows: usize,
        /// The most that a grid may have.
        most: usize,
    },
}
