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
        /// Seconds before and after a fault, a stop, an emergency stop or a mark for which blobs (pictures, scans,
        /// grids) are recorded. Default: all are recorded.
        #[serde(deserialize_with = "crate::exactly_if_given")]
        pub blobs_around_s: Option<[f64; 2]> = None => between(0.0, 600.0, "s").each("two times"),
        /// Memory for blobs that wait for such an event; the oldest are dropped beyond, bytes.
        pub blobs_waiting_bytes: u64 = 256_000_000 => between(1e6, 1e11, "bytes"),
        /// Channels that are not recorded (names; a trailing `*` matches any ending).
        pub exclude: Vec<String> = Vec::new(),
    }
}
