//! The golden run: a short flight that must compute to the same bits in every build, on every machine.

use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::record;
use crate::scenarios::Case;

/// The command that records it again, after an intended change of decisions.
pub const RENEW: &str = "cargo run --example golden";
/// Cycles of the flight: five seconds.
const CYCLES: u64 = 250;

/// The folder with the run file and its configuration.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden")
}

/// The run file.
pub fn file() -> PathBuf {
    folder().join("run.mcap")
}

/// Flies the golden run and writes it into another file.
///
/// # Errors
/// If the flight fails.
pub fn fly(path: &Path) -> Result<PathBuf> {
    let case = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] };
    record::fly(path, &folder().join("system.toml"), &case, CYCLES)
}
