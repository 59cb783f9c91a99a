//! What can go wrong with a run file, one sentence each.

use std::io;
use std::path::{Path, PathBuf};

/// A run file could not be written, recovered or read.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The operating system refused.
    #[error("{}: could not {what}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried.
        what: &'static str,
        /// Why not.
        source: io::Error,
    },
    /// The writer failed, and stays failed: open a new file. What was written up to the last whole chunk can be recovered.
    #[error("{}: writing stopped ({why}); what is in the file can be recovered with `nims recover`", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The writer's own words.
        why: String,
    },
    /// The file was removed or moved while it was written.
    #[error("the run file {}, so what was in it is missing here: {}", RunError::REMOVED, path.display())]
    Removed {
        /// The file.
        path: PathBuf,
    },
    /// Not a run file, or not a run folder.
    #[error("{}: {what}", path.display())]
    NotARun {
        /// The file or folder.
        path: PathBuf,
        /// What it is instead.
        what: NoRun,
    },
    /// A recorder holds the file.
    #[error("{} is being recorded right now; stop the recording first", path.display())]
    Busy {
        /// The file.
        path: PathBuf,
    },
    /// A sample has not the size that its channel announced.
    #[error("channel {channel}: a sample of {got} bytes, where the channel's type has {expected}")]
    Size {
        /// The channel's name.
        channel: String,
        /// Bytes that came.
        got: usize,
        /// Bytes of the type.
        expected: usize,
    },
    /// The channel is there, but holds another type.
    #[error("channel {channel} holds {found}, not {wanted} as this program knows it")]
    Type {
        /// The channel's name.
        channel: String,
        /// What the file says.
        found: String,
        /// What was asked for.
        wanted: String,
    },
}

/// Why a file or a folder is no run, or not the part of one that was asked for.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoRun {
    /// A folder without run files.
    #[error("the folder holds no run file (*.mcap or *.mcap.part)")]
    NoFiles,
    /// A pipe, a device or a folder where a file is needed.
    #[error("it is no regular file")]
    NotRegular,
    /// A file of another name than run files have.
    #[error("the name of a run file ends in .mcap or .mcap.part")]
    Name,
    /// A file that was recovered before, beside it.
    #[error("{} exists already; move it away to recover again", beside.display())]
    RecoveredBefore {
        /// What the recovery made.
        beside: PathBuf,
    },
    /// A file without a byte.
    #[error("the file is empty")]
    Empty,
    /// A file with other content.
    #[error("not an MCAP file")]
    NotMcap,
    /// A run without samples.
    #[error("it holds no samples")]
    NoSamples,
    /// A run without the channels that are wanted.
    #[error("no channel {}; there are {}", wanted.join(", "), there.join(", "))]
    NoChannel {
        /// As they were asked for.
        wanted: Vec<String>,
        /// The channels of the run.
        there: Vec<String>,
    },
    /// A run without samples in the time that is wanted.
    #[error("no sample in that time")]
    NoSampleThen,
}

impl RunError {
    /// What stands in the sentence of a file that was removed or moved, however long its path is. Where only the sentence arrives, it is
    /// known by this.
    pub const REMOVED: &'static str = "was removed or moved while it was written";

    pub(crate) fn io(path: &Path, what: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { path: path.to_owned(), what, source }
    }

    pub(crate) fn write(path: &Path) -> impl FnOnce(mcap::McapError) -> Self {
        move |error| Self::Write { path: path.to_owned(), why: words(&error) }
    }

    pub(crate) fn not_a_run(path: &Path, what: NoRun) -> Self {
        Self::NotARun { path: path.to_owned(), what }
    }
}

/// The cause itself where the library only says that there was one.
pub(crate) fn words(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::Io(cause) => cause.to_string(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_removed_file_is_known_by_its_sentence() {
        let said = RunError::Removed { path: PathBuf::from("/runs/one/run.mcap.part") }.to_string();
        assert!(said.contains(RunError::REMOVED) && said.ends_with("/runs/one/run.mcap.part"), "{said}");
    }
}
