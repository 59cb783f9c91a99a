//! Input that cannot be used.

/// Something the caller gave cannot be used; the program exits with 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct BadInput(pub String);
