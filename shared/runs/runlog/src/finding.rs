//! What is wrong with a run: for programs by its kind, for people as a sentence.

use std::path::PathBuf;

/// One thing that is wrong with a run, or that it is being recorded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Finding {
    /// A recorder holds a file and writes nothing.
    #[error(
        "{}: a recorder holds it, but nothing has been written for {silent_s} s; read up to what is on the disk",
        path.display()
    )]
    Silent {
        /// The file.
        path: PathBuf,
        /// For how long, whole seconds.
        silent_s: u64,
    },
    /// A recorder writes a file.
    #[error("{}: is being recorded, and read up to what is on the disk", path.display())]
    Recording {
        /// The file.
        path: PathBuf,
    },
    /// A file has places that cannot be read.
    #[error("{}: {places} damaged places; run `nims recover`", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// How many.
        places: usize,
    },
    /// A file ends where its recorder was killed.
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
        /// What it may lack.
        lack: Lack,
    },
    /// Time without samples of a fast channel.
    #[error("{seconds:.2} s were not recorded")]
    Unrecorded {
        /// How long, s.
        seconds: f64,
    },
    /// A channel lacks samples by their numbers.
    #[error("{channel}: {samples} samples missing in {gaps} gaps")]
    Lost {
        /// The channel.
        channel: String,
        /// How many.
        samples: u64,
        /// In how many gaps.
        gaps: u64,
    },
    /// Samples of channels without a definition.
    #[error("{samples} samples of channels that nothing in the file describes")]
    Orphaned {
        /// How many.
        samples: u64,
    },
    /// Nothing was recorded.
    #[error("no samples")]
    NoSamples,
}

/// What a recovered file may lack.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Lack {
    /// Samples are known to be missing: those that had not come to the disk.
    #[error("what its recorder had not yet given to the disk when it ended is missing")]
    NotOnDisk,
    /// It is the last file, so no later numbers show what is missing.
    #[error("at most the last half second before its recorder ended is missing, after a power cut the last two")]
    Unknown,
    /// The numbers of the next file follow on.
    #[error("by their numbers, no samples are missing between it and the next file")]
    Nothing,
}
