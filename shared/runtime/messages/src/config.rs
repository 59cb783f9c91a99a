//! Configuration in use by each process, as samples for the run file.

use crate::{Header, message};

message! {
    /// `system/config/NAME`: configuration of the process NAME, from its start or from a change on.
    /// `system/config/nims` holds the parameters that were set while the robot runs.
    pub struct SystemConfig {
        header: Header,
        /// First control cycle in which it is used; 0: from the start of the process.
        from_cycle: u64,
        /// Number of the first sample of `control/status` or `node/estimate` that was computed with it; 0: other
        /// processes.
        from_seq: u64,
        /// Process id.
        pid: u32,
        /// Non-zero random number of the process.
        incarnation: u32,
        /// Number of changes by `nims set` that it includes.
        changes: u32,
        pad0: [u8; 4],
        /// Name of the process.
        name: [u8; 32],
        /// Law of a controller, method of an estimator.
        law: [u8; 32],
        /// Version and build profile of the program.
        version: [u8; 64],
        /// Path of the program.
        program: [u8; 128],
        /// SHA-256 of the program, in hexadecimal digits.
        program_sha256: [u8; 64],
        /// The configuration file that the process read.
        file: [u8; 128],
        /// SHA-256 of the configuration file and those that it names, in hexadecimal digits.
        file_sha256: [u8; 64],
        /// TOML: the parameters in use. `nims`: the changes, one text line per key.
        parameters: [u8; 2048],
    }
}
