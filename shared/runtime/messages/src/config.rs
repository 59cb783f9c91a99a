//! What the processes of a robot work with, as samples: the run file says what flew.

use crate::{Header, message};

message! {
    /// `system/config/NAME`: what the process NAME works with, from its start or from a change on. `system/config/nims` is the supervisor's: what was set while the robot runs.
    pub struct SystemConfig {
        header: Header,
        /// The control cycle from which on it holds; 0: from the start of the process.
        from_cycle: u64,
        /// The first sample of `control/status` or `node/estimate` that was made with it, by its number; 0: the process answers no cycle.
        from_seq: u64,
        pid: u32,
        incarnation: u32,
        /// Changes of this run that are in it, made with `nims set`.
        changes: u32,
        pad0: [u8; 4],
        name: [u8; 32],
        /// Law of a controller, method of an estimator.
        law: [u8; 32],
        /// Of the program, and how it was built.
        version: [u8; 64],
        /// The program, and the SHA-256 of its file.
        program: [u8; 128],
        program_sha256: [u8; 64],
        /// The configuration that the process read, and the SHA-256 of it.
        file: [u8; 128],
        file_sha256: [u8; 64],
        /// TOML: the parameters in use, each key with its value. `nims`: what was set, a line for each key.
        parameters: [u8; 2048],
    }
}
