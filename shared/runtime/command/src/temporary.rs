//! Temporary files of programs.

use crate::{Answer, Failure};
use std::fs::File;
use std::io::{Error, ErrorKind};
use tempfile::TempDir;

/// Folder for large temporary files, on a disk where `/tmp` may lie in memory.
const LARGE: &str = "/var/tmp";

/// Creates a temporary folder, which is removed when the result is dropped.
///
/// # Errors
/// The machine has no folder for temporary files, or it cannot be written.
pub fn temporary_folder() -> Answer<TempDir> {
    tempfile::tempdir().map_err(|error| no_place(&error))
}

/// As [`temporary_folder`], for files that may be larger than the memory.
///
/// # Errors
/// As [`temporary_folder`].
pub fn large_temporary_folder() -> Answer<TempDir> {
    tempfile::tempdir_in(LARGE).or_else(|_| temporary_folder())
}

/// Creates a temporary file without a name.
///
/// # Errors
/// As [`temporary_folder`].
pub fn temporary_file() -> Answer<File> {
    tempfile::tempfile().map_err(|error| no_place(&error))
}

fn no_place(error: &Error) -> Failure {
    let folder = std::env::temp_dir();
    let why = match error.kind() {
        ErrorKind::NotFound => "there is no such folder".to_owned(),
        kind => kind.to_string(),
    };
    Failure::NotNow(format!(
        "temporary files need a folder, and {} cannot be used ({why}); name another one with TMPDIR",
        folder.display()
    ))
}
