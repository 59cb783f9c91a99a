//! `[bus]`: places in shared memory.

use crate::section::between;

crate::section! {
    /// `[bus]`.
    pub struct BusSection {
        /// Largest number of processes at once, with sensors and commands. Memory is reserved for each, running or not:
        /// `nims check` states how much. A process in excess runs, but announces no channel; a gateway counts twice.
        pub processes: usize = messages::PROCESSES => between(64.0, 4096.0, "processes"),
    }
}
