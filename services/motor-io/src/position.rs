//! Position file: the cable lengths on disk, so that a power cut does not lose the position.
//!
//! A separate thread writes; the loop hands over a copy and never waits. After a restart the stored position needs
//! confirmation by the operator.

use crate::odometry::Position;
use crate::settings::CoreConfig;
use config::file;
use messages::CABLES;
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, SyncSender, TrySendError};
use std::thread::JoinHandle;
use thiserror::Error;
use tracing::warn;

/// Shortest time between two writes, ns.
const PAUSE_NS: u64 = 500_000_000;
/// Least change that is worth a write, m.
const WORTH_M: f64 = 1e-4;
/// First line of the file.
const HEAD: &str = "# Where the lines were when motor-io last looked; written by motor-io.\n";

/// Version of the file. 1: without `zeroed_m`, and without its number.
const VERSION: u32 = 2;

/// Content of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionFile {
    /// Version of the file.
    #[serde(default = "first_version")]
    pub version: u32,
    /// Unstretched length of each cable beyond the routed part, m.
    pub lengths_m: Vec<f64>,
    /// Encoder count of each cable at that time, or [`NOT_COUNTED`](crate::NOT_COUNTED).
    pub counts: Vec<i64>,
    /// The lengths as they were last set, m, from which the errors of the robot's model count; empty: unknown.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub zeroed_m: Vec<f64>,
    /// Encoder scale at that time; with another one the counts are meaningless.
    pub counts_per_m: Vec<f64>,
    /// Anchors at that time; for another robot the lengths are meaningless.
    pub anchors_m: Vec<[f64; 3]>,
    /// Radii of the pulleys at that time, m, which the lengths include; empty for eyes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pulley_radius_m: Vec<f64>,
}

fn first_version() -> u32 {
    1
}

/// Reason why no stored position can be used or kept.
#[derive(Debug, Error)]
pub enum PositionError {
    /// The file cannot be read.
    #[error("{path}: the position from before cannot be read ({why}); zero the robot where it is")]
    Unreadable {
        /// Path of the file.
        path: PathBuf,
        /// Message of the system or the parser.
        why: String,
    },
    /// The file belongs to another robot.
    #[error("{path}: the position from before is of another robot or other encoders; zero the robot where it is")]
    OtherRobot {
        /// Path of the file.
        path: PathBuf,
    },
    /// Another process keeps the same position.
    #[error("{path}: another motor-io of this robot is running and keeps the position there; end it first")]
    InUse {
        /// Path of the lock file.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("{path}: the position cannot be kept ({why}); give a folder that can be written with --state")]
    Unwritable {
        /// Path of the file.
        path: PathBuf,
        /// Message of the system.
        why: String,
    },
}

/// Writer of one robot's position file.
#[derive(Debug)]
pub struct PositionWriter {
    sender: Option<SyncSender<Position>>,
    thread: Option<JoinHandle<()>>,
    kept: Option<Position>,
    kept_ns: u64,
    cables: usize,
    /// Held for the life of this process, so that no second one writes the same file.
    _lock: File,
}

impl PositionFile {
    fn new(config: &CoreConfig, position: &Position) -> Self {
        let (n, anchors) = (config.cable_count(), config.robot.anchors());
        let zeroed_m = &position.zeroed_m[..n];
        Self {
            version: VERSION,
            lengths_m: position.lengths_m[..n].to_vec(),
            counts: position.counts[..n].to_vec(),
            zeroed_m: if zeroed_m.iter().all(|m| m.is_finite()) { zeroed_m.to_vec() } else { Vec::new() },
            counts_per_m: config.counts_per_m[..n].to_vec(),
            anchors_m: anchors.iter().map(|a| [a.x, a.y, a.z]).collect(),
            pulley_radius_m: if anchors.have_pulleys() { anchors.radii_m().to_vec() } else { Vec::new() },
        }
    }

    /// Reads the position of the robot `name` from `folder`; `None` without a file.
    ///
    /// # Errors
    /// The file cannot be read, or belongs to another robot.
    pub fn load(folder: &Path, name: &str, config: &CoreConfig) -> Result<Option<Position>, PositionError> {
        let path = path_of(folder, name);
        let text = match file::read_text_if_there(&path) {
            Ok(Some(text)) => text,
            Ok(None) => return Ok(None),
            Err(error) => return Err(PositionError::Unreadable { path, why: error.to_string() }),
        };
        let kept: Self = match toml::from_str(&text) {
            Ok(kept) => kept,
            Err(error) => return Err(PositionError::Unreadable { path, why: error.message().to_owned() }),
        };
        if !(1..=VERSION).contains(&kept.version) {
            let why = format!("its version is {}, and this program reads 1 to {VERSION}", kept.version);
            return Err(PositionError::Unreadable { path, why });
        }
        let n = config.cable_count();
        let nowhere = Position { lengths_m: [0.0; CABLES], counts: [0; CABLES], zeroed_m: [f64::NAN; CABLES] };
        let same = Self {
            version: kept.version,
            lengths_m: kept.lengths_m.clone(),
            counts: kept.counts.clone(),
            zeroed_m: kept.zeroed_m.clone(),
            ..Self::new(config, &nowhere)
        };
        let finite = |lengths_m: &[f64]| lengths_m.len() == n && lengths_m.iter().all(|l| l.is_finite());
        let zeroed = kept.zeroed_m.is_empty() || finite(&kept.zeroed_m);
        if kept != same || !(kept.counts.len() == n && finite(&kept.lengths_m) && zeroed) {
            return Err(PositionError::OtherRobot { path });
        }
        let mut position = Position { zeroed_m: [0.0; CABLES], ..nowhere };
        position.lengths_m[..n].copy_from_slice(&kept.lengths_m);
        position.counts[..n].copy_from_slice(&kept.counts);
        for (i, zeroed_m) in position.zeroed_m.iter_mut().enumerate().take(n) {
            *zeroed_m = kept.zeroed_m.get(i).copied().unwrap_or(f64::NAN);
        }
        Ok(Some(position))
    }

    /// Writes the file as a whole or not at all.
    fn write(&self, path: &Path) -> io::Result<()> {
        let text = toml::to_string(self).map_err(io::Error::other)?;
        file::replace(path, format!("{HEAD}{text}"))
    }
}

fn path_of(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("position-{name}.toml"))
}

impl PositionWriter {
    /// Starts the thread that writes into `folder`, which is created if missing.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn start(folder: &Path, name: &str, config: &CoreConfig) -> Result<Self, PositionError> {
        let path = path_of(folder, name);
        let unwritable = |error: io::Error| PositionError::Unwritable { path: path.clone(), why: error.to_string() };
        fs::create_dir_all(folder).map_err(unwritable)?;
        let probe = path.with_extension("tmp");
        File::create(&probe).and_then(|_| fs::remove_file(&probe)).map_err(unwritable)?;
        let held = path.with_extension("lock");
        let lock = File::create(&held).map_err(unwritable)?;
        if lock.try_lock().is_err() {
            return Err(PositionError::InUse { path: held });
        }
        let (sender, receiver) = mpsc::sync_channel::<Position>(1);
        let (cables, config, target) = (config.cable_count(), config.clone(), path.clone());
        let work = move || {
            runtime::realtime::ordinary();
            let mut failed = false;
            while let Ok(position) = receiver.recv() {
                match PositionFile::new(&config, &position).write(&target) {
                    Ok(()) => failed = false,
                    Err(error) if !failed => {
                        failed = true;
                        warn!("{}", PositionError::Unwritable { path: target.clone(), why: error.to_string() });
                    }
                    Err(_) => {}
                }
            }
        };
        let thread = std::thread::Builder::new()
            .name("position".to_owned())
            .stack_size(256 << 10)
            .spawn(work)
            .map_err(unwritable)?;
        Ok(Self { sender: Some(sender), thread: Some(thread), kept: None, kept_ns: 0, cables, _lock: lock })
    }

    /// Hands over the present position, at most twice a second and only if it has changed. Never waits or allocates.
    pub fn store(&mut self, position: Option<Position>, now_ns: u64) {
        let Some(position) = position else { return };
        if now_ns.saturating_sub(self.kept_ns) < PAUSE_NS || !self.has_moved(&position) {
            return;
        }
        if let Some(sender) = &self.sender {
            match sender.try_send(position) {
                Ok(()) => (self.kept, self.kept_ns) = (Some(position), now_ns),
                // The previous write is not finished; the next cycle tries again.
                Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {}
            }
        }
    }

    fn has_moved(&self, position: &Position) -> bool {
        let bits = |lengths_m: &[f64; CABLES]| lengths_m.map(f64::to_bits);
        self.kept.as_ref().is_none_or(|kept| {
            let far = |i: usize| (position.lengths_m[i] - kept.lengths_m[i]).abs() > WORTH_M;
            (0..self.cables).any(far) || bits(&position.zeroed_m) != bits(&kept.zeroed_m)
        })
    }

    /// Writes the last position and ends.
    pub fn finish(mut self, position: Option<Position>) {
        if let (Some(sender), Some(position)) = (self.sender.take(), position) {
            let _ = sender.send(position);
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::Robot;
    use cable_robot::RobotParts;

    fn config(height: f64) -> CoreConfig {
        let robot = Robot::new(RobotParts {
            anchors_m: vec![[0.0, 0.0, height], [9.8, 0.0, 3.1], [4.7, 8.6, 3.0]],
            node_mass_kg: 1.2,
            tension_limits_n: [2.0, 60.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            ..RobotParts::default()
        })
        .unwrap();
        CoreConfig::new(robot, 0.01, &[10_000.0; 3], &[vec![0, 1], vec![2]]).unwrap()
    }

    fn somewhere() -> Position {
        Position { lengths_m: [2.5; CABLES], counts: [9; CABLES], zeroed_m: [f64::NAN; CABLES] }
    }

    #[test]
    fn a_stored_position_is_read_exactly() {
        let folder = tempfile::tempdir().unwrap();
        let config = config(3.0);
        assert_eq!(PositionFile::load(folder.path(), "lab", &config).unwrap(), None);
        let mut position = Position { lengths_m: [0.0; CABLES], counts: [0; CABLES], zeroed_m: [0.0; CABLES] };
        position.lengths_m[..3].copy_from_slice(&[0.1 + 0.2, 5.0, 1.0 / 3.0]);
        position.counts[..3].copy_from_slice(&[-7, i64::MAX, 12]);
        position.zeroed_m[..3].copy_from_slice(&[4.0, 0.7, 2.0 / 3.0]);
        let mut keeper = PositionWriter::start(folder.path(), "lab", &config).unwrap();
        keeper.store(Some(position), 1_000_000_000);
        position.lengths_m[0] += 0.5;
        keeper.store(Some(position), 1_100_000_000); // too soon
        keeper.finish(None);
        let back = PositionFile::load(folder.path(), "lab", &config).unwrap().unwrap();
        position.lengths_m[0] = 0.1 + 0.2;
        assert_eq!(back, position);
    }

    #[test]
    fn lengths_that_are_set_at_rest_are_stored() {
        let folder = tempfile::tempdir().unwrap();
        let config = config(3.0);
        let mut keeper = PositionWriter::start(folder.path(), "lab", &config).unwrap();
        let unknown = somewhere();
        keeper.store(Some(unknown), 1_000_000_000);
        let set = Position { zeroed_m: unknown.lengths_m, ..unknown };
        let stored = || PositionFile::load(folder.path(), "lab", &config).unwrap();
        // While a write is not finished, a later cycle tries again.
        for cycle in 2..10_000 {
            keeper.store(Some(set), cycle * 1_000_000_000);
            if stored().is_some_and(|back| back.zeroed_m[..3] == set.zeroed_m[..3]) {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        assert_eq!(stored().unwrap().zeroed_m[..3], set.zeroed_m[..3]);
        keeper.finish(None);
    }

    #[test]
    fn a_file_of_an_older_version_does_not_say_where_the_lengths_were_set() {
        let folder = tempfile::tempdir().unwrap();
        let config = config(3.0);
        let keeper = PositionWriter::start(folder.path(), "lab", &config).unwrap();
        keeper.finish(Some(Position { zeroed_m: [2.0; CABLES], ..somewhere() }));
        let path = path_of(folder.path(), "lab");
        let text = fs::read_to_string(&path).unwrap();
        let old = |line: &&str| !line.starts_with("version") && !line.starts_with("zeroed_m");
        fs::write(&path, text.lines().filter(old).collect::<Vec<_>>().join("\n")).unwrap();
        let back = PositionFile::load(folder.path(), "lab", &config).unwrap().unwrap();
        assert_eq!(back.lengths_m[..3], [2.5; 3]);
        assert!(back.zeroed_m[..3].iter().all(|m| m.is_nan()), "{back:?}");
        fs::write(&path, text.replace("version = 2", "version = 3")).unwrap();
        let newer = PositionFile::load(folder.path(), "lab", &config).unwrap_err();
        assert!(matches!(newer, PositionError::Unreadable { .. }) && newer.to_string().contains('3'), "{newer}");
    }

    #[test]
    fn the_last_position_is_stored_at_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let config = config(3.0);
        let keeper = PositionWriter::start(folder.path(), "lab", &config).unwrap();
        keeper.finish(Some(somewhere()));
        assert_eq!(PositionFile::load(folder.path(), "lab", &config).unwrap().unwrap().counts[2], 9);
    }

    #[test]
    fn two_processes_cannot_store_the_same_position() {
        let folder = tempfile::tempdir().unwrap();
        let first = PositionWriter::start(folder.path(), "lab", &config(3.0)).unwrap();
        let second = PositionWriter::start(folder.path(), "lab", &config(3.0)).unwrap_err();
        assert!(matches!(second, PositionError::InUse { .. }), "{second}");
        assert!(PositionWriter::start(folder.path(), "field", &config(3.0)).is_ok());
        first.finish(None);
        assert!(PositionWriter::start(folder.path(), "lab", &config(3.0)).is_ok());
    }

    #[test]
    fn another_robot_or_a_damaged_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let keeper = PositionWriter::start(folder.path(), "lab", &config(3.0)).unwrap();
        keeper.finish(Some(somewhere()));
        let other = PositionFile::load(folder.path(), "lab", &config(3.1)).unwrap_err();
        assert!(matches!(other, PositionError::OtherRobot { .. }), "{other}");
        fs::write(path_of(folder.path(), "lab"), "lengths_m = 3").unwrap();
        let damaged = PositionFile::load(folder.path(), "lab", &config(3.0)).unwrap_err();
        assert!(matches!(damaged, PositionError::Unreadable { .. }), "{damaged}");
    }
}
