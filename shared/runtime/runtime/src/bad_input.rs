//! Input that cannot be used.

/// Bad input of the caller; the program exits with 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct BadInput(pub String);
