//! Missions by content: a copy under its SHA-256 in the run folder, which the planner reads in place of the original.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use sha2::{Digest, Sha256};
use thiserror::Error;

use crate::file::{self, ReadError};

/// Folder of the run in which requested missions lie for the planner.
pub const INBOX: &str = "inbox";

/// Most missions in that folder, and their bytes in all: a mission with the largest accepted number of points fits
/// once.
pub const INBOX_FILES: usize = 64;
/// See [`INBOX_FILES`].
pub const INBOX_BYTES: u64 = file::LARGEST_BYTES;
/// Age from which a copy makes room for another one: by then the planner has read it and the supervisor has archived
/// it, or its requester has long given up.
const UNUSED: Duration = Duration::from_secs(60);

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
    /// Too many missions were requested in the last minute.
    #[error("the mission cannot be copied to {path}: the last minute's missions take its {files} places or {megabytes} MB; wait a minute, then request it again", files = INBOX_FILES, megabytes = INBOX_BYTES >> 20)]
    Full {
        /// The folder.
        path: PathBuf,
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

/// Stores the text of a mission for the planner of the run; returns its hash. Where [`INBOX_FILES`] or [`INBOX_BYTES`]
/// would be exceeded, the oldest copies go first, but none that a request may still need.
///
/// # Errors
/// The run folder cannot be written, or the copies of the last minute leave no room.
pub fn store_mission(run: &Path, text: &str) -> Result<[u8; 32], MissionCopyError> {
    let hash = mission_hash(text);
    let (folder, path) = (run.join(INBOX), mission_copy(run, &hash));
    let room = fs::create_dir_all(&folder).and_then(|()| make_room(&folder, &path, text.len() as u64));
    match room.and_then(|room| if room { file::replace(&path, text).map(|()| true) } else { Ok(false) }) {
        Ok(true) => Ok(hash),
        Ok(false) => Err(MissionCopyError::Full { path: folder }),
        Err(why) => Err(MissionCopyError::NotStored { path, why }),
    }
}

/// Removes the oldest unused copies until one of so many bytes fits at that path; false if it does not fit.
fn make_room(folder: &Path, at: &Path, bytes: u64) -> io::Result<bool> {
    if bytes > INBOX_BYTES {
        return Ok(false);
    }
    let now = SystemTime::now();
    let mut copies = Vec::new();
    for entry in fs::read_dir(folder)?.flatten() {
        let (path, Ok(found)) = (entry.path(), entry.metadata()) else { continue };
        // It is replaced.
        if path != at {
            copies.push((found.modified().unwrap_or(now), found.len(), path));
        }
    }
    copies.sort();
    let (mut files, mut held) = (copies.len(), copies.iter().map(|(_, bytes, _)| bytes).sum::<u64>());
    for (modified, length, path) in copies {
        if files < INBOX_FILES && held + bytes <= INBOX_BYTES {
            break;
        }
        // A clock that was set back makes a copy look new, and it stays until the end of the run.
        if now.duration_since(modified).unwrap_or_default() < UNUSED {
            break;
        }
        match fs::remove_file(&path) {
            // The supervisor or another gateway has removed it.
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            removed => removed?,
        }
        (files, held) = (files - 1, held - length);
    }
    Ok(files < INBOX_FILES && held + bytes <= INBOX_BYTES)
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

    fn copies(run: &Path) -> usize {
        fs::read_dir(run.join(INBOX)).unwrap().count()
    }

    /// Makes every copy so old, with differences of a second in the order of their texts.
    fn age(run: &Path, texts: &[String], by: Duration) {
        for (number, text) in texts.iter().enumerate() {
            let copy = fs::File::options().write(true).open(mission_copy(run, &mission_hash(text))).unwrap();
            copy.set_modified(SystemTime::now() - by + Duration::from_secs(number as u64)).unwrap();
        }
    }

    #[test]
    fn the_inbox_is_bounded_and_only_the_oldest_unused_copies_go() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path();
        let texts: Vec<String> = (0..INBOX_FILES).map(|number| format!("name = \"{number}\"")).collect();
        for text in &texts {
            store_mission(run, text).unwrap();
        }
        assert_eq!(copies(run), INBOX_FILES);
        // Requests may still need every one of them.
        assert!(matches!(store_mission(run, "one more"), Err(MissionCopyError::Full { .. })));
        // The same mission again takes no other place.
        store_mission(run, &texts[7]).unwrap();
        age(run, &texts, 2 * UNUSED);
        store_mission(run, &texts[0]).unwrap();
        store_mission(run, "one more").unwrap();
        assert_eq!(copies(run), INBOX_FILES);
        let there = |text: &str| read_mission(run, &mission_hash(text)).is_ok();
        assert!(there(&texts[0]) && !there(&texts[1]) && there(&texts[2]) && there("one more"));
    }

    #[test]
    fn the_inbox_is_bounded_in_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path();
        let third = |letter: &str| letter.repeat((INBOX_BYTES / 3) as usize);
        let texts = [third("a"), third("b"), third("c")];
        for text in &texts {
            store_mission(run, text).unwrap();
        }
        assert!(matches!(store_mission(run, &third("d")), Err(MissionCopyError::Full { .. })));
        age(run, &texts[..1], 2 * UNUSED);
        store_mission(run, &third("d")).unwrap();
        assert_eq!(copies(run), 3);
        // Larger than the whole inbox: nothing goes in vain.
        age(run, &texts[1..2], 2 * UNUSED);
        assert!(matches!(store_mission(run, &third("efgh")), Err(MissionCopyError::Full { .. })));
        assert_eq!(copies(run), 3);
    }

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
