//! Files that a command writes.

use std::path::Path;

use command::{Answer, Failure};

/// Writes a file.
///
/// # Errors
/// It cannot be written.
pub(crate) fn write(path: &Path, text: impl AsRef<[u8]>) -> Answer {
    std::fs::write(path, text).map_err(|error| cannot_write(path, &error))
}

/// The failure of a file or folder that cannot be written.
pub(crate) fn cannot_write(path: &Path, error: &std::io::Error) -> Failure {
    Failure::NotNow(format!("{} cannot be written: {error}; choose another folder with --out", path.display()))
}
