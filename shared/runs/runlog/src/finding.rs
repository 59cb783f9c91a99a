//! Problems of a run: one enum for programs, its sentences for operators.

use std::path::PathBuf;

/// One problem of a run, or that it is still being recorded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Finding {
    /// A recorder has the file open but does not write.
    #[error(
        "{}: open in a recorder that has written nothing for {silent_s} s; contains only what is on the disk",
        path.display()
    )]
    Silent {
        /// The file.
        path: PathBuf,
        /// Time without a write, whole seconds.
        silent_s: u64,
    },
    /// A recorder is writing the file.
    #[error("{}: being recorded; contains only what is on the disk", path.display())]
    Recording {
        /// The file.
        path: PathBuf,
    },
    /// A file has unreadable places.
    #[error("{}: {places} damaged places; run `nims recover`", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Number of unreadable places.
        places: usize,
    },
    /// A file has no end mark: its recorder was killed.
    #[error("{}: not closed properly; run `nims recover`", path.display())]
    NotClosed {
        /// The file.
        path: PathBuf,
    },
    /// A file was recovered.
    #[error("{}: recovered; {lack}", path.display())]
    Recovered {
        /// The file.
        path: PathBuf,
        /// Data that may be missing.
        lack: MissingData,
    },
    /// Time without samples of a fast channel.
    #[error("{seconds:.2} s were not recorded")]
    Unrecorded {
        /// Total time, s.
        seconds: f64,
    },
    /// Sequence numbers show that samples of a channel are missing.
    #[error("{channel}: {samples} samples missing in {gaps} gaps")]
    Lost {
        /// The channel.
        channel: String,
        /// Number of missing samples.
        samples: u64,
        /// Number of gaps.
        gaps: u64,
    },
    /// Samples of channels without a definition.
    #[error("{samples} samples of channels without a definition in the file")]
    Orphaned {
        /// Number of these samples.
        samples: u64,
    },
    /// The run contains no samples.
    #[error("no samples")]
    NoSamples,
}

/// Data that a recovered file may lack.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MissingData {
    /// Samples that were not yet on the disk are known to be missing.
    #[error("samples that were not yet on the disk when its recorder ended are missing")]
    NotOnDisk,
    /// It is the last file, so no later sequence numbers show what is missing.
    #[error("at most the last 0.5 s before its recorder ended are missing, after a power cut the last 2 s")]
    Unknown,
    /// The sequence numbers of the next file continue without a gap.
    #[error("sequence numbers show no samples missing between it and the next file")]
    Nothing,
}
