//! Finds a mission file by its path or name.

use std::path::{Path, PathBuf};

/// Returns the mission file for `given`: a path, or the name of a file in the folder `missions`, with or without
/// `.toml`.
#[must_use]
pub fn mission_file(given: &str, missions: &Path) -> PathBuf {
    let path = PathBuf::from(given);
    if path.is_file() || path.components().count() > 1 {
        return path;
    }
    let named = missions.join(given);
    if named.is_file() { named } else { missions.join(format!("{given}.toml")) }
}
