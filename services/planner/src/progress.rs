//! Progress of a mission, and the file that stores it.
//!
//! A separate thread writes the file atomically twice a second while a mission is flown, so a stalled disk delays no
//! motion. After a power cut the last moments of the mission are flown again.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, SyncSender, TrySendError};
use std::thread::JoinHandle;

use config::file;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::plan::Mark;
use mission::Mission;

/// Shortest time between two writes, ns: a fifth of a metre at 0.4 m/s, and as often as motor-io stores the position.
const PAUSE_NS: u64 = 500_000_000;
/// First text line of the file.
const HEAD: &str = "# How far the last mission came, for nims run MISSION --continue; written by the planner.\n";

/// Progress of a mission, from which it can be continued.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Position of the node at the start of the mission, m.
    pub start_m: [f64; 3],
    /// Number of the reached segment in the plan of the whole mission, from 0.
    pub segment: usize,
    /// Position on the segment: arc length, m; of a dwell the time, s.
    pub along: f64,
    /// Coordinates of that point, m.
    pub at_m: [f64; 3],
    /// The mission is complete.
    pub done: bool,
    /// Duration of the earlier parts of the mission, s.
    #[serde(default)]
    pub flown_s: f64,
    /// Completed share of the mission, 0 to 1, as published.
    #[serde(default)]
    pub share: f64,
    /// The mission that was requested.
    pub mission: Mission,
    /// With adaptive legs: the present part up to the next of them, with the earlier ones resolved.
    #[serde(default)]
    pub stage: Option<Mission>,
    /// The rest after that part, beginning with an adaptive leg.
    #[serde(default)]
    pub left: Option<Mission>,
    /// The parts before the present one, if a map is still to come: their paths say where it has samples.
    #[serde(default)]
    pub before: Option<FlownParts>,
}

/// Parts of a mission that were flown, with their adaptive legs resolved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlownParts {
    /// Position of the node at their start, m.
    pub start_m: [f64; 3],
    /// Their legs.
    pub mission: Mission,
}

impl Progress {
    /// Returns the reached point of the path.
    #[must_use]
    pub fn mark(&self) -> Mark {
        Mark { segment: self.segment, along: self.along }
    }

    /// Begins the next part at a position, m, after `flown_s` seconds of the mission.
    pub(crate) fn begin_part(&mut self, at_m: [f64; 3], flown_s: f64, stage: Mission, left: Option<Mission>) {
        let flown = self.stage.replace(stage).filter(|_| left.is_some());
        self.before = flown.map(|flown| match self.before.take() {
            Some(mut before) => {
                before.mission.leg.extend(flown.leg);
                before
            }
            None => FlownParts { start_m: self.start_m, mission: flown },
        });
        (self.start_m, self.at_m) = (at_m, at_m);
        (self.segment, self.along, self.flown_s, self.left) = (0, 0.0, flown_s, left);
    }

    /// Reads the progress of the system `name` from `folder`; `None` if no mission was begun.
    ///
    /// # Errors
    /// The file exists and cannot be used.
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

    /// Writes the file atomically.
    fn write(&self, path: &Path) -> io::Result<()> {
        let text = toml::to_string(self).map_err(io::Error::other)?;
        file::replace(path, format!("{HEAD}{text}"))
    }
}

/// Progress that cannot be stored or read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum KeepError {
    /// The file exists and cannot be used.
    #[error("{path}: the progress of the last mission cannot be read ({why}); it can only be run from its beginning")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Reason.
        why: String,
    },
    /// The file cannot be written.
    #[error(
        "{path}: the progress of missions cannot be stored ({why}); after an interruption a mission starts from its beginning"
    )]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Reason given by the operating system.
        why: String,
    },
}

fn path_of(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("mission-{name}.toml"))
}

/// Writer of the progress of the missions of one robot.
#[derive(Debug)]
pub struct ProgressWriter {
    sender: Option<SyncSender<Option<Progress>>>,
    thread: Option<JoinHandle<()>>,
    kept: Option<Progress>,
    kept_ns: u64,
}

impl ProgressWriter {
    /// Creates `folder` and starts the thread that writes into it.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn start(folder: &Path, name: &str) -> Result<Self, KeepError> {
        let path = path_of(folder, name);
        let unwritable = |error: io::Error| KeepError::Unwritable { path: path.clone(), why: error.to_string() };
        fs::create_dir_all(folder).map_err(unwritable)?;
        let (sender, receiver) = mpsc::sync_channel::<Option<Progress>>(1);
        let target = path.clone();
        let work = move || {
            runtime::realtime::ordinary();
            let mut failed = false;
            while let Ok(progress) = receiver.recv() {
                let written = match progress {
                    Some(progress) => progress.write(&target),
                    None => file::remove(&target),
                };
                match written {
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

    /// Queues changed progress, that of an incomplete mission at most twice a second. Never waits. `None` removes
    /// what this writer has stored: a mission that never began to move is not left unfinished.
    pub fn store(&mut self, progress: Option<&Progress>, now_ns: u64) {
        if self.kept.as_ref() == progress {
            return;
        }
        if progress.is_some_and(|progress| !progress.done) && now_ns.saturating_sub(self.kept_ns) < PAUSE_NS {
            return;
        }
        if let Some(sender) = &self.sender {
            match sender.try_send(progress.cloned()) {
                Ok(()) => (self.kept, self.kept_ns) = (progress.cloned(), now_ns),
                // The last one is still being written: the next pass tries again.
                Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {}
            }
        }
    }
}

impl Drop for ProgressWriter {
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
            before: None,
            stage: mission.clone().ok(),
            mission: mission.unwrap(),
        }
    }

    #[test]
    fn stored_progress_is_read_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Progress::load(folder.path(), "lab").unwrap(), None);
        let mut keeper = ProgressWriter::start(&folder.path().join("state"), "lab").unwrap();
        keeper.store(Some(&progress()), 1_000_000_000);
        drop(keeper);
        assert_eq!(Progress::load(&folder.path().join("state"), "lab").unwrap(), Some(progress()));
    }

    #[test]
    fn a_file_that_is_none_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mission-lab.toml");
        fs::write(&file, "segment = -1").unwrap();
        let error = Progress::load(folder.path(), "lab").unwrap_err();
        assert!(matches!(&error, KeepError::Unreadable { path, .. } if *path == file), "{error:?}");
        assert!(error.to_string().starts_with(file.to_str().unwrap()), "{error}");
    }
}
