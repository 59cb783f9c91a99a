//! The configuration that a process uses, published on `system/config/NAME` at its start and at each change.

use std::path::{Path, PathBuf};

use bus::{BusError, Publisher};
use messages::{Header, SystemConfig, put_text};

use crate::build::Program;
use crate::hash::{ProgramHash, hash_of};
use config::{RobotFile, SystemFile};

/// Last line of parameters that do not fit into a sample.
const MORE: &str = "# and more: see the file";

/// The first output of the control chain to which a configuration applies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FirstOutput {
    /// Life of motor-io; 0: from the start of the process.
    pub life: u64,
    /// Control cycle in that life.
    pub cycle: u64,
    /// Sequence number of the first sample of `control/status` or `node/estimate`.
    pub seq: u64,
    /// Number of changes of this run that the configuration contains.
    pub changes: u32,
}

/// The published configuration of this process.
#[derive(Debug)]
pub(crate) struct DeclaredConfig {
    /// `None` while a predecessor of the same name publishes.
    port: Option<Publisher<SystemConfig>>,
    sample: Box<SystemConfig>,
    program_hash: ProgramHash,
    /// The table `[program]` of a custom program, appended to the parameters.
    program: Option<String>,
    /// Whether the process is ready, so that changes are published at once.
    is_ready: bool,
    life: u64,
}

impl DeclaredConfig {
    /// Creates the configuration of a process of this role that has read `file`.
    pub(crate) fn new(
        port: Option<Publisher<SystemConfig>>,
        name: &str,
        incarnation: u32,
        role: &str,
        file: Option<(&Path, &SystemFile)>,
    ) -> Self {
        let mut sample = Box::new(SystemConfig { pid: std::process::id(), incarnation, ..SystemConfig::default() });
        put_text(&mut sample.name, name);
        let program = std::env::current_exe().unwrap_or_default();
        put_text(&mut sample.program, &program.to_string_lossy());
        let program_hash = ProgramHash::begin(program);
        let mut declared = Self { port, sample, program_hash, program: None, is_ready: false, life: 0 };
        if let Some((path, file)) = file {
            let robot = file.robot_file().ok();
            declared.read(path, &parts_of(path, &file.robot, robot.as_ref()));
            let law = match role {
                "controller" => file.controller.law.name(),
                "estimator" => file.estimator.method.name(),
                _ => "",
            };
            declared.uses(law, &file.sections(sections_of(role)));
        }
        declared
    }

    /// Sets the port after the predecessor has ended, and publishes the configuration if the process is ready.
    pub(crate) fn set_port(&mut self, port: Publisher<SystemConfig>, now_ns: u64) -> Result<(), BusError> {
        self.port = Some(port);
        if self.is_ready { self.publish(now_ns) } else { Ok(()) }
    }

    /// Sets the version of the program.
    pub(crate) fn set_version(&mut self, version: &str) {
        put_text(&mut self.sample.version, version);
    }

    /// Declares a custom program, which is not part of nims.
    pub(crate) fn set_program(&mut self, program: &Program) {
        self.set_version(&program.described());
        self.program = Some(program.to_toml());
    }

    /// Sets the file that the process uses, and the files whose hash identifies it.
    pub(crate) fn read(&mut self, file: &Path, parts: &[PathBuf]) {
        put_text(&mut self.sample.file, &file.to_string_lossy());
        put_text(&mut self.sample.file_sha256, &hash_of(parts).unwrap_or_default());
    }

    /// Sets law and parameters instead of those in the file's section for this role.
    pub(crate) fn uses(&mut self, law: &str, parameters: &str) {
        put_text(&mut self.sample.law, law);
        match &self.program {
            Some(program) => put_lines(&mut self.sample.parameters, &format!("{}\n\n{program}", parameters.trim_end())),
            None => put_lines(&mut self.sample.parameters, parameters),
        }
    }

    /// Sets the first output to which the configuration applies; publishes it if the process is ready.
    pub(crate) fn since(&mut self, since: FirstOutput, now_ns: u64) -> Result<(), BusError> {
        self.life = since.life;
        (self.sample.from_cycle, self.sample.from_seq, self.sample.changes) = (since.cycle, since.seq, since.changes);
        if self.is_ready { self.publish(now_ns) } else { Ok(()) }
    }

    /// Publishes the configuration when the process becomes ready.
    pub(crate) fn ready(&mut self, now_ns: u64) -> Result<(), BusError> {
        if std::mem::replace(&mut self.is_ready, true) {
            return Ok(());
        }
        self.poll_hash();
        self.publish(now_ns)
    }

    /// Publishes the program's hash when it is computed, and sends the configuration to late subscribers.
    pub(crate) fn update(&mut self, now_ns: u64) -> Result<(), BusError> {
        if self.is_ready && self.poll_hash() {
            self.publish(now_ns)?;
        }
        if let Some(port) = &mut self.port {
            port.update_connections();
        }
        Ok(())
    }

    /// Returns whether the hash of the program has just become available.
    fn poll_hash(&mut self) -> bool {
        let hash = self.program_hash.poll();
        if let Some(hash) = &hash {
            put_text(&mut self.sample.program_sha256, hash);
        }
        hash.is_some()
    }

    fn publish(&mut self, now_ns: u64) -> Result<(), BusError> {
        self.sample.header = Header { life: self.life, ..Header::at(now_ns) };
        self.port.as_mut().map_or(Ok(()), |port| port.send(&mut self.sample).map(|_| ()))
    }
}

/// Returns the files that `file_sha256` covers, in this order: the system file, its robot file, and the files that the
/// robot file names.
#[must_use]
pub fn parts_of(path: &Path, robot_path: &Path, robot: Option<&RobotFile>) -> Vec<PathBuf> {
    let folder = robot_path.parent().unwrap_or(Path::new(""));
    let named = robot.map(|robot| robot.named_files(folder)).unwrap_or_default();
    [path.to_owned(), robot_path.to_owned()].into_iter().chain(named).collect()
}

/// Returns the sections of the system file that a role uses.
fn sections_of(role: &str) -> &'static [&'static str] {
    match role {
        "motor-io" => &["motor_io", "arbiter", "rate_hz"],
        "estimator" => &["estimator"],
        "controller" => &["controller"],
        "planner" => &["planner"],
        "recorder" => &["recorder"],
        "sensor-logger" => &["sensor_logger"],
        // It states its section itself, without the true world.
        "motor-box" => &["rate_hz"],
        "viewer" => &["viewer"],
        _ => &[],
    }
}

/// Stores as many whole text lines as fit.
fn put_lines(into: &mut [u8], text: &str) {
    let text = text.trim_end();
    if text.len() <= into.len() {
        return put_text(into, text);
    }
    let mut kept = String::new();
    for line in text.lines() {
        if kept.len() + line.len() + 1 + MORE.len() > into.len() {
            break;
        }
        kept.push_str(line);
        kept.push('\n');
    }
    kept.push_str(MORE);
    put_text(into, &kept);
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::text_of;

    #[test]
    fn a_text_that_is_too_long_is_cut_at_a_line_and_marked() {
        let mut field = [0; 64];
        put_lines(&mut field, "a = 1\nb = 2\n");
        assert_eq!(text_of(&field), "a = 1\nb = 2");
        let long: String = (0..20).map(|i| format!("key_{i} = {i}\n")).collect();
        put_lines(&mut field, &long);
        let text = text_of(&field);
        assert!(text.starts_with("key_0 = 0\n") && text.ends_with(&format!("\n{MORE}")), "{text}");
    }
}
