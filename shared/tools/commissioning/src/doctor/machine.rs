//! Facts about a machine as plain data, so that they can be judged in tests without that machine.

use evidence::busy::SystemLoad;
use std::path::PathBuf;

/// Facts about a machine, as far as a system needs them.
#[derive(Debug, Clone, Default)]
pub struct Machine {
    /// User id of this process.
    pub user: u32,
    /// Shared memory.
    pub memory: Memory,
    /// This user's domains.
    pub domains: Vec<DomainFacts>,
    /// Size in bytes and number of files of this user in shared memory that belong to no domain.
    pub ownerless: (u64, usize),
    /// Resource limits of a process.
    pub limits: Limits,
    /// Processes for which the system has places (`[bus]`).
    pub places: usize,
    /// Error of the operating system for a setting in `[realtime]` that it does not permit.
    pub realtime_refused: Option<String>,
    /// Serial devices of the system.
    pub ports: Vec<PortFacts>,
    /// Clock source of the kernel; empty if unknown.
    pub clock_source: String,
    /// Available clock sources, separated by spaces.
    pub clock_sources: String,
    /// Calendar time, s since 1970.
    pub unix_s: u64,
    /// Number of processors.
    pub processors: usize,
    /// Load by other programs.
    pub busy: Option<SystemLoad>,
    /// Folders of this user's domains that other users may enter; nims refuses to use them.
    pub open_folders: Vec<PathBuf>,
    /// Folder of the runs.
    pub runs: Option<Runs>,
    /// Programs missing in the folder of this program.
    pub programs_missing: Vec<String>,
}

/// Shared memory, /dev/shm.
#[derive(Debug, Clone, Copy, Default)]
pub struct Memory {
    /// Whether it exists and is a tmpfs.
    pub is_tmpfs: bool,
    /// Whether this user may create files in it.
    pub is_writable: bool,
    /// Size, bytes.
    pub size_bytes: u64,
    /// Free space, bytes.
    pub free_bytes: u64,
}

/// Domain of a robot in shared memory.
#[derive(Debug, Clone, Default)]
pub struct DomainFacts {
    /// Name of the domain.
    pub name: String,
    /// Folder of the domain.
    pub folder: PathBuf,
    /// Files and folders of the domain that other users could read, write or enter.
    pub open: Vec<PathBuf>,
    /// Names of its running processes.
    pub alive: Vec<String>,
    /// Number of dead processes whose resources have not been removed.
    pub dead: usize,
    /// Whether a supervisor is running in it.
    pub is_run: bool,
}

/// Resource limits of a process; `None` means unlimited.
#[derive(Debug, Clone, Copy, Default)]
pub struct Limits {
    /// Number of open files.
    pub open_files: Option<u64>,
    /// Highest real-time priority.
    pub realtime_priority: Option<u64>,
    /// Number of processes and threads of this user.
    pub processes: Option<u64>,
}

/// A serial device.
#[derive(Debug, Clone, Default)]
pub struct PortFacts {
    /// Number in the system file, from 1.
    pub number: usize,
    /// Path in the system file.
    pub path: String,
    /// Whether the path exists.
    pub exists: bool,
    /// Whether it is a character device.
    pub is_device: bool,
    /// Whether this user may read and write it.
    pub is_usable: bool,
    /// Id of the group that owns it.
    pub group: u32,
}

/// Folder of the runs.
#[derive(Debug, Clone, Default)]
pub struct Runs {
    /// Path.
    pub folder: PathBuf,
    /// Whether it, or the folder in which it would be created, is writable.
    pub is_writable: bool,
    /// The user who owns it, if that is neither this user nor root: the robot runs as that one.
    pub owner: Option<String>,
    /// Free space, bytes.
    pub free_bytes: u64,
    /// Free space below which nothing is recorded, bytes.
    pub least_bytes: u64,
    /// Runs, and files of the saved position, that other users may read.
    pub open: Vec<PathBuf>,
}
