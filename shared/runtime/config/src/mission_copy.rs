//! Missions by content: a copy under its SHA-256 in the run folder, which the planner reads in place of the original.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use thiserror::Error;

use crate::file::{self, ReadError};

/// Folder of the run in which requested missions lie for the planner.
pub const INBOX: &str = "inbox";

/// A copy of a mission that cannot be stored or used.
#[derive(Debug, Error)]
pub enum MissionCopyError {
    /// It cannot be written.
    #[error("the mission cannot be copied to {path}: {why}")]
    NotStored {
        /// The copy.
        path: PathBuf,
        /// The operating system's reason.
        why: io::Error,
    },
    /// It cannot be read.
    #[error("the copy {path} of the mission cannot be read: {why}; request the mission again")]
    Unreadable {
        /// The copy.
        path: PathBuf,
        /// Why not.
        why: ReadError,
    },
    /// Its content was changed after the request was made.
    #[error("{path} is not the mission that was requested: its SHA-256 differs; request the mission again")]
    OtherContent {
        /// The copy.
        path: PathBuf,
    },
}

/// SHA-256 of the text of a mission.
#[must_use]
pub fn mission_hash(text: &str) -> [u8; 32] {
    Sha256::digest(text.as_bytes()).into()
}

/// Where the mission of that hash lies in the folder of the run.
#[must_use]
pub fn mission_copy(run: &Path, hash: &[u8; 32]) -> PathBuf {
    run.join(INBOX).join(format!("{}.toml", messages::hex(hash)))
}

/// Stores the text of a mission for the planner of the run; returns its hash.
///
/// # Errors
/// The run folder cannot be written.
pub fn store_mission(run: &Path, text: &str) -> Result<[u8; 32], MissionCopyError> {
    let hash = mission_hash(text);
    let path = mission_copy(run, &hash);
    let stored = fs::create_dir_all(run.join(INBOX)).and_then(|()| file::replace(&path, text));
    stored.map(|()| hash).map_err(|why| MissionCopyError::NotStored { path, why })
}

/// Text of the mission of that hash, checked against it.
///
/// # Errors
/// There is no such copy, or its content has another hash.
pub fn read_mission(run: &Path, hash: &[u8; 32]) -> Result<String, MissionCopyError> {
    let path = mission_copy(run, hash);
    match file::read_text(&path) {
        Ok(text) if mission_hash(&text) == *hash => Ok(text),
        Ok(_) => Err(MissionCopyError::OtherContent { path }),
        Err(why) => Err(MissionCopyError::Unreadable { path, why }),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_mission_is_found_by_its_hash_and_another_content_is_refused() {
        let run = tempfile::tempdir().unwrap();
        let hash = store_mission(run.path(), "abc").unwrap();
        let copy = mission_copy(run.path(), &hash);
        // printf abc | sha256sum
        let name = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad.toml";
        assert_eq!(copy, run.path().join("inbox").join(name));
        assert_eq!(read_mission(run.path(), &hash).unwrap(), "abc");
        fs::write(&copy, "abd").unwrap();
        assert!(matches!(read_mission(run.path(), &hash), Err(MissionCopyError::OtherContent { .. })));
        let missing = read_mission(run.path(), &[7; 32]).unwrap_err();
        assert!(
            matches!(&missing, MissionCopyError::Unreadable { path, .. } if path.to_string_lossy().contains("0707")),
            "{missing}"
        );
    }
}
