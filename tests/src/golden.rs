//! The golden run: a short flight that must compute to the same bits in every build, on every machine.

use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::record;
use crate::scenarios::Case;

/// Records it again, after a change that is meant to alter decisions.
pub const RENEW: &str = "cargo run --example golden";
/// Five seconds.
const CYCLES: u64 = 250;

/// The folder with the file and the configuration that it is flown with.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden")
}

/// The file.
pub fn file() -> PathBuf {
    folder().join("run.mcap")
}

/// Flies it into another file.
///
/// # Errors
/// What is wrong with the flight.
pub fn fly(path: &Path) -> Result<PathBuf> {
    let case = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] };
    record::fly(path, &folder().join("system.toml"), &case, CYCLES)
}
