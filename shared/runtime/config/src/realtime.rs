//! `[realtime]`: scheduling of the control chain.

use crate::section::between;

crate::section! {
    /// `[realtime]`: without the permissions for it, the system runs with ordinary scheduling and logs one warning.
    pub struct RealtimeSection {
        /// SCHED_FIFO priority of motor-io, 1 to 90; that of estimator and controller is one and two higher. 0:
        /// ordinary scheduling.
        pub priority: u8 = 0 => between(0.0, 90.0, "(0: ordinary)"),
        /// CPU of the control chain; default: any.
        pub cpu: Option<usize> = None,
        /// Lock the memory of the control chain in RAM.
        pub lock_memory: bool = false,
        /// Longest wake-up latency of the CPUs while motor-io runs, µs; 0 disables their idle states, which costs
        /// power. Default: not limited.
        pub idle_latency_us: Option<u32> = None,
    }
}
