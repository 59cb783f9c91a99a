//! Errors of run files.

use std::io;
use std::path::{Path, PathBuf};

/// Error of writing, recovering or reading a run file.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The operating system returned an error.
    #[error("{}: could not {what}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The attempted operation.
        what: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The MCAP writer failed and cannot be used further: open a new file. Everything up to the last complete chunk can
    /// be recovered.
    #[error("{}: writing stopped ({why}); recover the file with `nims recover`", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The error message of the writer.
        why: String,
    },
    /// The file was removed or moved while it was being written.
    #[error("the run file was removed or moved while it was written; its samples are missing here: {}", path.display())]
    Removed {
        /// The file.
        path: PathBuf,
    },
    /// Not a run file, or not a run folder.
    #[error("{}: {what}", path.display())]
    NotARun {
        /// The file or folder.
        path: PathBuf,
        /// The reason.
        what: NotARunReason,
    },
    /// A recorder has locked the file.
    #[error("{} is being recorded; stop the recording first", path.display())]
    Busy {
        /// The file.
        path: PathBuf,
    },
    /// The disk has no room for the recovered file.
    #[error(
        "{}: its recovery needs {:.0} MB on the disk, which has {:.0} MB left; make room, such as by removing old runs",
        path.display(), *needed_bytes as f64 / 1e6, *free_bytes as f64 / 1e6
    )]
    NoRoom {
        /// The file.
        path: PathBuf,
        /// Bytes that the disk has left.
        free_bytes: u64,
        /// Bytes that the disk has to have left.
        needed_bytes: u64,
    },
    /// A sample does not have the size of its channel's type.
    #[error("channel {channel}: sample size is {got} bytes; accepted: {expected}")]
    Size {
        /// The channel's name.
        channel: String,
        /// Bytes of the sample.
        got: usize,
        /// Bytes of the type.
        expected: usize,
    },
    /// The channel has a type other than the requested one.
    #[error("channel {channel} has the type {found}; this program reads {wanted}")]
    Type {
        /// The channel's name.
        channel: String,
        /// The type in the file.
        found: String,
        /// The requested type.
        wanted: String,
    },
}

/// Why a file or folder is not a run, or does not contain the requested part.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NotARunReason {
    /// The folder contains no run files.
    #[error("the folder contains no run file (*.mcap or *.mcap.part)")]
    NoFiles,
    /// A pipe, a device or a folder was given where a file is needed.
    #[error("not a regular file")]
    NotRegular,
    /// The name does not end as those of run files do.
    #[error("the name of a run file must end in .mcap or .mcap.part")]
    Name,
    /// The file was recovered before; the result lies next to it.
    #[error("{} already exists; move it away to recover again", beside.display())]
    RecoveredBefore {
        /// The recovered file.
        beside: PathBuf,
    },
    /// The file has no bytes.
    #[error("the file is empty")]
    Empty,
    /// The content is not MCAP.
    #[error("not an MCAP file")]
    NotMcap,
    /// The run contains no samples.
    #[error("the run contains no samples")]
    NoSamples,
    /// The run has none of the requested channels.
    #[error("no channel {}; accepted: {}", wanted.join(", "), there.join(", "))]
    NoChannel {
        /// The requested channels.
        wanted: Vec<String>,
        /// The channels of the run.
        there: Vec<String>,
    },
    /// The run has no samples in the requested time.
    #[error("no samples in the requested time")]
    NoSampleThen,
}

impl RunError {
    pub(crate) fn io(path: &Path, what: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { path: path.to_owned(), what, source }
    }

    pub(crate) fn write(path: &Path) -> impl FnOnce(mcap::McapError) -> Self {
        move |error| Self::Write { path: path.to_owned(), why: cause_text(&error) }
    }

    pub(crate) fn not_a_run(path: &Path, what: NotARunReason) -> Self {
        Self::NotARun { path: path.to_owned(), what }
    }
}

/// The error message; the underlying cause where the library's own message only states that there was one.
pub(crate) fn cause_text(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(cause) => cause.to_string(),
        other => other.to_string(),
    }
}
