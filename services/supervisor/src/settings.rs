//! Parameters that the operator sets while the robot runs.
//!
//! A change passes the same checks as the system file, is recorded, and is announced on `system/config/nims`: from a
//! stated cycle on it applies in every process of its role. A process that starts later reads a copy of the system
//! file that includes all changes.

use super::process_spec::{ProcessSpec, RunContext};
use bus::{Bus, Publisher, clock};
use command::{Answer, Failure};
use config::{RobotFile, SystemFile, Tuned};
use messages::{Header, SystemConfig, put_text};
use runtime::{ProgramHash, TUNED_CHANNEL, build, hash_of, parts_of};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The parameters that were set so far.
pub struct Settings {
    pub(super) port: Publisher<SystemConfig>,
    pub(super) sample: Box<SystemConfig>,
    pub(super) program_hash: ProgramHash,
    pub(super) robot: RobotFile,
    pub(super) tuned: Tuned,
    /// The system file with all changes, and the path of its copy.
    pub(super) file: SystemFile,
    pub(super) path: PathBuf,
    /// The life of motor-io in which the last change was announced.
    pub(super) life: u64,
}

impl Settings {
    /// Without any change.
    pub(super) fn new(bus: &Bus, context: &RunContext, incarnation: u32) -> Answer<Self> {
        let robot = context.file.robot_file().map_err(Failure::not_now)?;
        let mut sample = Box::new(SystemConfig { pid: std::process::id(), incarnation, ..SystemConfig::default() });
        put_text(&mut sample.name, client::SUPERVISOR);
        put_text(&mut sample.version, build::description());
        let program = std::env::current_exe().unwrap_or_default();
        put_text(&mut sample.program, &program.to_string_lossy());
        let program_hash = ProgramHash::begin(program);
        let (file, path) = (context.file.clone(), context.config.clone());
        let port = bus.publisher(TUNED_CHANNEL)?;
        let mut settings = Self { port, sample, program_hash, robot, tuned: Tuned::default(), file, path, life: 0 };
        settings.publish()?;
        Ok(settings)
    }

    /// The process with its arguments changed so that it reads the system file with all changes.
    pub(super) fn configured(&self, member: &ProcessSpec, initial: &Path) -> ProcessSpec {
        let mut member = member.clone();
        let (initial, present) = (initial.to_string_lossy(), self.path.to_string_lossy());
        if initial != present {
            for argument in &mut member.args {
                if let Some(text) = argument.to_str().filter(|text| text.contains(&*initial)) {
                    *argument = OsString::from(text.replace(&*initial, &present));
                }
            }
        }
        member
    }

    /// Number of changes so far.
    pub(super) fn changes(&self) -> u32 {
        self.sample.changes
    }

    /// Publishes the program's hash once it is computed, and the last change to subscribers that joined since.
    pub(super) fn update(&mut self) -> Answer {
        if let Some(hash) = self.program_hash.poll() {
            put_text(&mut self.sample.program_sha256, &hash);
            self.publish()?;
        }
        self.port.update_connections();
        Ok(())
    }

    pub(super) fn publish(&mut self) -> Answer {
        self.sample.header = Header { life: self.life, ..Header::at(clock::now_ns()) };
        put_text(&mut self.sample.parameters, self.tuned.text().trim_end());
        put_text(&mut self.sample.file, &self.path.to_string_lossy());
        let parts = parts_of(&self.path, &self.file.robot, Some(&self.robot));
        put_text(&mut self.sample.file_sha256, &hash_of(&parts).unwrap_or_default());
        self.port.send(&mut self.sample)?;
        Ok(())
    }
}
