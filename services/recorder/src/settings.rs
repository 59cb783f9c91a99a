//! Settings of a recording.

use config::RecorderSection;
use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::Around;

/// Settings of a recording.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The run folder. Its configuration and mission files are attached to every run file.
    pub folder: PathBuf,
    /// Free space below which recording stops, bytes.
    pub min_free_bytes: u64,
    /// Longest time before samples are written to the disk, ns.
    pub flush_ns: u64,
    /// Size at which the next file is started, bytes.
    pub segment_bytes: u64,
    /// Age at which the next file is started, ns.
    pub segment_ns: u64,
    /// Which blobs are recorded; `None`: all.
    pub blobs: Option<Around>,
    /// Facts about the run, e.g. versions and host.
    pub about: BTreeMap<String, String>,
}

impl Settings {
    /// Creates the settings of `[recorder]` for a run folder.
    #[must_use]
    pub fn new(section: &RecorderSection, folder: PathBuf, about: BTreeMap<String, String>) -> Self {
        Self {
            folder,
            min_free_bytes: section.min_free_bytes,
            flush_ns: (section.flush_s * 1e9) as u64,
            segment_bytes: section.segment_bytes,
            segment_ns: (section.segment_s * 1e9) as u64,
            blobs: section.blobs_around_s.map(|[before_s, after_s]| Around {
                before_ns: (before_s * 1e9) as u64,
                after_ns: (after_s * 1e9) as u64,
                most_bytes: section.blobs_waiting_bytes as usize,
            }),
            about,
        }
    }
}
