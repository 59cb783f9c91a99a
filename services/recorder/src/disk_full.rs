//! The refusal to record on a full disk.

use std::path::PathBuf;

/// Nothing is recorded, because the disk is full.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the disk is full: {:.0} MB are free at {}, and at least {:.0} MB are needed; free disk space, and the recording resumes",
    *free_bytes as f64 / 1e6, folder.display(), *needed_bytes as f64 / 1e6
)]
pub struct DiskFull {
    /// The run folder.
    pub folder: PathBuf,
    /// Free disk space, bytes.
    pub free_bytes: u64,
    /// Needed disk space, bytes.
    pub needed_bytes: u64,
}
