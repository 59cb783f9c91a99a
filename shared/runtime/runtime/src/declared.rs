//! What a process works with, on `system/config/NAME`: at its start and whenever it changes.

use std::path::{Path, PathBuf};

use bus::{BusError, Publisher};
use messages::{Header, SystemConfig, put_text};

use crate::build::Program;
use crate::hash::{ProgramHash, hash_of};
use config::{RobotFile, SystemFile};

/// Stands at the end of parameters that a sample does not hold.
const MORE: &str = "# and more: see the file";

/// What an answer of the control chain was made with, from which answer on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Since {
    /// Life of motor-io, and control cycle in it; 0: from the start of the process.
    pub life: u64,
    /// See `life`.
    pub cycle: u64,
    /// Number of the first sample of `control/status` or `node/estimate`.
    pub seq: u64,
    /// Changes of this run that are in it.
    pub changes: u32,
}

/// See the module's text.
#[derive(Debug)]
pub(crate) struct Declared {
    /// `None` while a predecessor of the same name has it.
    port: Option<Publisher<SystemConfig>>,
    sample: Box<SystemConfig>,
    program_hash: ProgramHash,
    /// `[program]` of a program of one's own, which stands behind the parameters.
    program: Option<String>,
    /// The process has said that it is ready, so a change is said at once.
    open: bool,
    life: u64,
}

impl Declared {
    /// For a process of this role, which read `file`, if it read one.
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
        let mut declared = Self { port, sample, program_hash, program: None, open: false, life: 0 };
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

    /// The predecessor has gone: what was said until now is said on this port.
    pub(crate) fn take(&mut self, port: Publisher<SystemConfig>, now_ns: u64) -> Result<(), BusError> {
        self.port = Some(port);
        if self.open { self.say(now_ns) } else { Ok(()) }
    }

    /// The program's own version.
    pub(crate) fn version(&mut self, version: &str) {
        put_text(&mut self.sample.version, version);
    }

    /// The program is one's own, and no part of nims.
    pub(crate) fn is_program(&mut self, program: &Program) {
        self.version(&program.described());
        self.program = Some(program.to_toml());
    }

    /// The file that the process goes by, and everything that belongs to it.
    pub(crate) fn read(&mut self, file: &Path, parts: &[PathBuf]) {
        put_text(&mut self.sample.file, &file.to_string_lossy());
        put_text(&mut self.sample.file_sha256, &hash_of(parts).unwrap_or_default());
    }

    /// Law and parameters, in place of those that the file's section for this role gives.
    pub(crate) fn uses(&mut self, law: &str, parameters: &str) {
        put_text(&mut self.sample.law, law);
        match &self.program {
            Some(program) => put_lines(&mut self.sample.parameters, &format!("{}\n\n{program}", parameters.trim_end())),
            None => put_lines(&mut self.sample.parameters, parameters),
        }
    }

    /// From when on it holds; said at once if the process is ready.
    pub(crate) fn since(&mut self, since: Since, now_ns: u64) -> Result<(), BusError> {
        self.life = since.life;
        (self.sample.from_cycle, self.sample.from_seq, self.sample.changes) = (since.cycle, since.seq, since.changes);
        if self.open { self.say(now_ns) } else { Ok(()) }
    }

    /// The process is ready: what it works with is known.
    pub(crate) fn ready(&mut self, now_ns: u64) -> Result<(), BusError> {
        if std::mem::replace(&mut self.open, true) {
            return Ok(());
        }
        self.hashed();
        self.say(now_ns)
    }

    /// The program's hash, once it is there; a listener that came since the last change gets that too.
    pub(crate) fn keep_up(&mut self, now_ns: u64) -> Result<(), BusError> {
        if self.open && self.hashed() {
            self.say(now_ns)?;
        }
        if let Some(port) = &mut self.port {
            port.update_connections();
        }
        Ok(())
    }

    /// True if the program has been read meanwhile.
    fn hashed(&mut self) -> bool {
        let hash = self.program_hash.take();
        if let Some(hash) = &hash {
            put_text(&mut self.sample.program_sha256, hash);
        }
        hash.is_some()
    }

    fn say(&mut self, now_ns: u64) -> Result<(), BusError> {
        self.sample.header = Header { life: self.life, ..Header::at(now_ns) };
        self.port.as_mut().map_or(Ok(()), |port| port.send(&mut self.sample).map(|_| ()))
    }
}

/// The system file, its robot file, and what that names: what `file_sha256` is of, in this order.
#[must_use]
pub fn parts_of(path: &Path, robot_path: &Path, robot: Option<&RobotFile>) -> Vec<PathBuf> {
    let folder = robot_path.parent().unwrap_or(Path::new(""));
    let named = robot.map(|robot| robot.named_files(folder)).unwrap_or_default();
    [path.to_owned(), robot_path.to_owned()].into_iter().chain(named).collect()
}

/// The sections of a system file that a role goes by.
fn sections_of(role: &str) -> &'static [&'static str] {
    match role {
        "motor-io" => &["motor_io", "arbiter", "rate_hz"],
        "estimator" => &["estimator"],
        "controller" => &["controller"],
        "planner" => &["planner"],
        "recorder" => &["recorder"],
        "sensor-logger" => &["sensor_logger"],
        "motor-box" => &["motor_box", "rate_hz"],
        "viewer" => &["viewer"],
        _ => &[],
    }
}

/// As many whole lines as fit.
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
    fn what_does_not_fit_is_cut_at_a_line_and_says_so() {
        let mut field = [0; 64];
        put_lines(&mut field, "a = 1\nb = 2\n");
        assert_eq!(text_of(&field), "a = 1\nb = 2");
        let long: String = (0..20).map(|i| format!("key_{i} = {i}\n")).collect();
        put_lines(&mut field, &long);
        let said = text_of(&field);
        assert!(said.starts_with("key_0 = 0\n") && said.ends_with(&format!("\n{MORE}")), "{said}");
    }
}
