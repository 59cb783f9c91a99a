//! Errors of this crate, one sentence each.

use thiserror::Error;

/// Error of an invalid grid or option.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SurveyError {
    /// A number is outside its accepted range.
    #[error("{key} is {value}; accepted: {accepted}")]
    Value {
        /// Name of the field, with its unit as suffix.
        key: &'static str,
        /// Value given.
        value: f64,
        /// Accepted values.
        accepted: &'static str,
    },
    /// The grid has too many cells.
    #[error(
        "a grid of {columns} x {rows} cells is too large; accepted: at most {most} cells, with larger cells or a smaller area"
    )]
    Cells {
        /// Number of cells along x.
        columns: usize,
        /// Number of cells along y.
        rows: usize,
        /// Largest number of cells.
        most: usize,
    },
}
