//! Error and result of an operation.

use serde_json::Value;

/// Error of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SolveError {
    /// Identifier for programs.
    pub kind: &'static str,
    /// One sentence for people.
    pub message: String,
}

impl SolveError {
    pub(crate) fn invalid(message: impl Into<String>) -> Self {
        Self { kind: "invalid_argument", message: message.into() }
    }
}

/// Result of an operation.
pub(crate) type OperationResult = Result<Value, SolveError>;
