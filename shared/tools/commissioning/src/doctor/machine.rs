//! What the doctor knows of a machine: plain facts, so that they can be judged without one.

use evidence::busy::Busy;
use std::path::PathBuf;

/// A machine, and what a box needs of it.
#[derive(Debug, Clone, Default)]
pub struct Machine {
    /// User id of whoever asks.
    pub user: u32,
    /// Where shared memory lies.
    pub memory: Memory,
    /// This user's domains.
    pub domains: Vec<DomainFound>,
    /// Bytes in shared memory that belong to no domain of this user, and in how many files.
    pub ownerless: (u64, usize),
    /// What a process may have.
    pub limits: Limits,
    /// What the system does not permit of the box's `[realtime]`, in its own words.
    pub realtime_refused: Option<String>,
    /// Serial devices of the box.
    pub ports: Vec<PortFound>,
    /// Clock source of the kernel; empty: unknown.
    pub clock_source: String,
    /// Clock sources that it could have instead.
    pub clock_sources: String,
    /// Calendar time, s since 1970.
    pub unix_s: u64,
    /// Frequency governors, one per processor; empty: the machine has none.
    pub governors: Vec<String>,
    /// Processors.
    pub processors: usize,
    /// What else runs.
    pub busy: Option<Busy>,
    /// Folders of this user's domains that others may enter, which therefore cannot be used.
    pub open_folders: Vec<PathBuf>,
    /// Where runs are kept.
    pub runs: Option<Runs>,
    /// Programs that should stand beside this one, and do not.
    pub programs_missing: Vec<String>,
}

/// /dev/shm.
#[derive(Debug, Clone, Copy, Default)]
pub struct Memory {
    /// It is there, and in memory.
    pub is_tmpfs: bool,
    /// This user may make files there.
    pub is_writable: bool,
    /// Size, bytes.
    pub size_bytes: u64,
    /// Room left, bytes.
    pub free_bytes: u64,
}

/// One robot's part of shared memory.
#[derive(Debug, Clone, Default)]
pub struct DomainFound {
    /// Its name.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
    /// What of it others could read, write or enter.
    pub open: Vec<PathBuf>,
    /// Names of the processes that live in it.
    pub alive: Vec<String>,
    /// Processes that have died and whose traces are still there.
    pub dead: usize,
    /// Whether a supervisor runs it.
    pub is_run: bool,
}

/// Limits of a process; `None`: none.
#[derive(Debug, Clone, Copy, Default)]
pub struct Limits {
    /// Open files.
    pub open_files: Option<u64>,
    /// Highest real-time priority.
    pub realtime_priority: Option<u64>,
    /// Processes and threads of this user.
    pub processes: Option<u64>,
}

/// A serial device.
#[derive(Debug, Clone, Default)]
pub struct PortFound {
    /// Its place in the system file, from 1.
    pub number: usize,
    /// As the system file has it.
    pub path: String,
    /// It is there.
    pub exists: bool,
    /// It is a device.
    pub is_device: bool,
    /// This user may read and write it.
    pub is_usable: bool,
    /// The group that may, by its number.
    pub group: u32,
    /// How long its adapter holds short answers back, ms; `None`: not at all, or unknown.
    pub latency_ms: Option<u32>,
    /// This user may change that.
    pub latency_is_writable: bool,
}

/// Where runs are kept.
#[derive(Debug, Clone, Default)]
pub struct Runs {
    /// The folder.
    pub folder: PathBuf,
    /// It, or the folder that it would be made in, can be written.
    pub is_writable: bool,
    /// Room left, bytes.
    pub free_bytes: u64,
    /// Below this nothing is recorded, bytes.
    pub least_bytes: u64,
    /// Runs, and files of the remembered position, that other users may read.
    pub open: Vec<PathBuf>,
}
