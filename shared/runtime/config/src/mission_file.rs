//! Where a mission is that is given by its name.

use std::path::{Path, PathBuf};

/// The file that `given` means: a path, or the name of one of the missions.
#[must_use]
pub fn mission_file(given: &str, missions: &Path) -> PathBuf {
    let path = PathBuf::from(given);
    if path.is_file() || path.components().count() > 1 {
        return path;
    }
    let named = missions.join(given);
    if named.is_file() { named } else { missions.join(format!("{given}.toml")) }
}
