//! Mission files on the command line.

use std::path::{Path, PathBuf};

use crate::{Answer, Failure};

/// Returns the path of a mission file given by path, or by name in the missions folder of the system.
///
/// # Errors
/// There is no such file.
pub fn mission_path(asked: &Path, missions: Option<&Path>) -> Answer<PathBuf> {
    let mut candidates = vec![asked.to_path_buf()];
    if let Some(folder) = missions {
        candidates.push(folder.join(asked));
        candidates.push(folder.join(asked).with_extension("toml"));
    }
    let Some(found) = candidates.iter().find(|path| path.is_file()).or(candidates.iter().find(|path| path.exists()))
    else {
        let beside = missions.map(|folder| format!(", nor in {}", folder.display())).unwrap_or_default();
        return Err(Failure::BadInput(format!("there is no mission file {}{beside}", asked.display())));
    };
    std::path::absolute(found).map_err(Failure::bad)
}
