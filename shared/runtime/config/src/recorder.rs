//! `[recorder]`: the run file.

use crate::section::between;

crate::section! {
    /// `[recorder]`.
    pub struct RecorderSection {
        /// Free disk space below which recording stops with an error, bytes.
        pub min_free_bytes: u64 = 500_000_000,
        /// Longest time before data are written to the disk, s.
        pub flush_s: f64 = 0.5 => between(0.05, 10.0, "s"),
        /// Size at which the next file of the run is started, bytes.
        pub segment_bytes: u64 = 2_000_000_000 => between(1e7, 1e12, "bytes"),
        /// Age at which the next file of the run is started, s.
        pub segment_s: f64 = 900.0 => between(10.0, 1e6, "s"),
        /// Channels that are not recorded (names; a trailing `*` matches any ending).
        pub exclude: Vec<String> = Vec::new(),
    }
}
