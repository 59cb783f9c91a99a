//! How far a mission has come, and the file that keeps it while everything else ends.
//!
//! Written whole or not at all, a few times a second while a mission is flown, by a thread of its own: a disk that stands still delays
//! no motion. What is lost with a power cut are the last moments, which are then flown again.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, SyncSender, TrySendError};
use std::thread::JoinHandle;

use config::file;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::mission::Mission;
use crate::plan::Mark;

/// Least time between two writings, ns: at 0.4 m/s a tenth of a metre.
const PAUSE_NS: u64 = 250_000_000;
/// First line of the file.
const HEAD: &str = "# How far the last mission came, for nims run MISSION --continue; written by the planner.\n";

/// How far a mission has come; enough to go on with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Where the node was when the mission began, m.
    pub start_m: [f64; 3],
    /// Number of the segment that is reached, from 0, as the whole was planned.
    pub segment: usize,
    /// How far along it: arc length, m; of a dwell the time, s.
    pub along: f64,
    /// Where that is, m.
    pub at_m: [f64; 3],
    /// Nothing is left.
    pub done: bool,
    /// How long the parts of the mission before the present one were flown, s.
    #[serde(default)]
    pub flown_s: f64,
    /// How much of the mission is done, 0 to 1, as it was said.
    #[serde(default)]
    pub share: f64,
    /// The mission as it was begun.
    pub mission: Mission,
    /// What of it is flown now, if it has adaptive legs: up to the next of them, with those before as they turned out.
    #[serde(default)]
    pub stage: Option<Mission>,
    /// What comes then, beginning with an adaptive leg.
    #[serde(default)]
    pub left: Option<Mission>,
}

impl Progress {
    /// The point of its way that is reached.
    #[must_use]
    pub fn mark(&self) -> Mark {
        Mark { segment: self.segment, along: self.along }
    }

    /// Reads what `folder` keeps for the box `name`; `None` if no mission was begun.
    ///
    /// # Errors
    /// The file is there and cannot be used.
    pub fn load(folder: &Path, name: &str) -> Result<Option<Self>, KeepError> {
        let path = path_of(folder, name);
        let text = match file::read_text_if_there(&path) {
            Ok(Some(text)) => text,
            Ok(None) => return Ok(None),
            Err(error) => return Err(KeepError::Unreadable { path, why: error.to_string() }),
        };
        let unusable = |why: String| KeepError::Unreadable { path: path.clone(), why: why.replace('\n', " ") };
        let progress: Self = toml::from_str(&text).map_err(|error| unusable(error.message().to_owned()))?;
        let mission = progress.mission.checked().map_err(|error| unusable(error.to_string()))?;
        Ok(Some(Self { mission, ..progress }))
    }

    /// Writes it whole or not at all.
    fn write(&self, path: &Path) -> io::Result<()> {
        let text = toml::to_string(self).map_err(io::Error::other)?;
        file::replace(path, &format!("{HEAD}{text}"))
    }
}

/// Progress that cannot be kept or read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum KeepError {
    /// It is there and cannot be used.
    #[error("{path}: how far the last mission came cannot be read ({why}); it can only be run from its beginning")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why not.
        why: String,
    },
    /// It cannot be written.
    #[error("{path}: how far a mission comes cannot be kept ({why}); after an interruption it begins anew")]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// The system's words.
        why: String,
    },
}

fn path_of(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("mission-{name}.toml"))
}

/// Keeps the progress of one robot's missions.
#[derive(Debug)]
pub struct Keeper {
    sender: Option<SyncSender<Progress>>,
    thread: Option<JoinHandle<()>>,
    kept: Option<Progress>,
    kept_ns: u64,
}

impl Keeper {
    /// Starts the thread that writes into `folder`, which is made if it is not there.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn start(folder: &Path, name: &str) -> Result<Self, KeepError> {
        let path = path_of(folder, name);
        let unwritable = |error: io::Error| KeepError::Unwritable { path: path.clone(), why: error.to_string() };
        fs::create_dir_all(folder).map_err(unwritable)?;
        let (sender, receiver) = mpsc::sync_channel::<Progress>(1);
        let target = path.clone();
        let work = move || {
            runtime::realtime::ordinary();
            let mut failed = false;
            while let Ok(progress) = receiver.recv() {
                match progress.write(&target) {
                    Ok(()) => failed = false,
                    Err(error) if !failed => {
                        failed = true;
                        tracing::warn!("{}", KeepError::Unwritable { path: target.clone(), why: error.to_string() });
                    }
                    Err(_) => {}
                }
            }
        };
        let thread = std::thread::Builder::new().name("progress".to_owned()).spawn(work).map_err(unwritable)?;
        Ok(Self { sender: Some(sender), thread: Some(thread), kept: None, kept_ns: 0 })
    }

    /// Hands over how far the mission has come, if that has changed; what is not done yet at most four times a second. Never waits.
    pub fn keep(&mut self, progress: Option<&Progress>, now_ns: u64) {
        let Some(progress) = progress.filter(|progress| self.kept.as_ref() != Some(progress)) else { return };
        if !progress.done && now_ns.saturating_sub(self.kept_ns) < PAUSE_NS {
            return;
        }
        if let Some(sender) = &self.sender {
            match sender.try_send(progress.clone()) {
                Ok(()) => (self.kept, self.kept_ns) = (Some(progress.clone()), now_ns),
                // Still writing the last one: the next pass tries again.
                Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {}
            }
        }
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        drop(self.sender.take());
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has nothing left to write.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn progress() -> Progress {
        let mission = Mission::parse(
            "name = \"scan\"\n[[leg]]\nraster = { corner_m = [1, 1, 1], opposite_m = [2, 2, 1], pitch_m = 0.1 }\n[[leg]]\ndwell = { duration_s = 1 }",
        );
        Progress {
            start_m: [0.1 + 0.2, 1.0, 2.0],
            segment: 7,
            along: 1.0 / 3.0,
            at_m: [1.0; 3],
            done: false,
            flown_s: 12.5,
            share: 1.0 / 7.0,
            left: None,
            stage: mission.clone().ok(),
            mission: mission.unwrap(),
        }
    }

    #[test]
    fn what_is_kept_is_read_again_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Progress::load(folder.path(), "lab").unwrap(), None);
        let mut keeper = Keeper::start(&folder.path().join("state"), "lab").unwrap();
        keeper.keep(Some(&progress()), 1_000_000_000);
        drop(keeper);
        assert_eq!(Progress::load(&folder.path().join("state"), "lab").unwrap(), Some(progress()));
    }

    #[test]
    fn a_file_that_is_none_is_named() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("mission-lab.toml"), "segment = -1").unwrap();
        let sentence = Progress::load(folder.path(), "lab").unwrap_err().to_string();
        assert!(sentence.contains("mission-lab.toml") && sentence.contains("from its beginning"), "{sentence}");
    }
}
