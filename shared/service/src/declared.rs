//! What a process works with, on `system/config/NAME`: at its start and whenever it changes.

use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

use bus::{BusError, Publisher};
use messages::{Header, SystemConfig, put_text};
use rustix::process::setpriority_process;
use rustix::thread::gettid;
use sha2::{Digest, Sha256};

use crate::config::{BoxFile, RobotFile};
use crate::file;

/// Stands at the end of parameters that a sample does not hold.
const MORE: &str = "# and more: see the file";

/// Niceness of the thread that reads the program.
const LEFT_OVER: i32 = 19;
/// Stack of the thread that reads the program: it may stay locked in memory.
const STACK_BYTES: usize = 256 * 1024;

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
    /// The program is read beside the start of the process. On a busy computer that takes seconds, for which nothing waits.
    hashing: Option<JoinHandle<String>>,
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
        file: Option<(&Path, &BoxFile)>,
    ) -> Self {
        let mut sample = Box::new(SystemConfig { pid: std::process::id(), incarnation, ..SystemConfig::default() });
        put_text(&mut sample.name, name);
        let program = std::env::current_exe().unwrap_or_default();
        put_text(&mut sample.program, &program.to_string_lossy());
        let hash = move || {
            // It takes what time is left over; where that is not permitted, it takes its turn.
            let _ = setpriority_process(Some(gettid()), LEFT_OVER);
            hash_of(&[program]).unwrap_or_default()
        };
        let hashing = std::thread::Builder::new().name("hash".to_owned()).stack_size(STACK_BYTES).spawn(hash).ok();
        let mut declared = Self { port, sample, hashing, open: false, life: 0 };
        if let Some((path, file)) = file {
            let robot = file.robot_file().ok();
            declared.read(path, &parts_of(path, &file.robot, robot.as_ref()));
            let law = match role {
                "controller" => file.controller.law.as_str(),
                "estimator" => file.estimator.method.as_str(),
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

    /// The file that the process goes by, and everything that belongs to it.
    pub(crate) fn read(&mut self, file: &Path, parts: &[PathBuf]) {
        put_text(&mut self.sample.file, &file.to_string_lossy());
        put_text(&mut self.sample.file_sha256, &hash_of(parts).unwrap_or_default());
    }

    /// Law and parameters, in place of those that the file's section for this role gives.
    pub(crate) fn uses(&mut self, law: &str, parameters: &str) {
        put_text(&mut self.sample.law, law);
        put_lines(&mut self.sample.parameters, parameters);
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
        let done = self.hashing.take_if(|hashing| hashing.is_finished());
        let hash = done.and_then(|hashing| hashing.join().ok());
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

/// The box file, its robot file, and what that names.
fn parts_of(path: &Path, robot_path: &Path, robot: Option<&RobotFile>) -> Vec<PathBuf> {
    let folder = robot_path.parent().unwrap_or(Path::new(""));
    let named = robot.map(|robot| robot.named_files(folder)).unwrap_or_default();
    [path.to_owned(), robot_path.to_owned()].into_iter().chain(named).collect()
}

/// The sections of a box file that a role goes by.
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

/// SHA-256 of regular files of any size (a program has more than a configuration may), one behind the other, as `cat FILES | sha256sum` has
/// it; `None` if one cannot be read.
#[must_use]
pub fn hash_of(files: &[PathBuf]) -> Option<String> {
    let mut hash = Hasher(Sha256::new());
    for path in files {
        std::io::copy(&mut file::open(path).ok()?, &mut hash).ok()?;
    }
    Some(hash.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

struct Hasher(Sha256);

impl std::io::Write for Hasher {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
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
    fn the_hash_is_the_one_that_a_shell_gives() {
        let folder = tempfile::tempdir().unwrap();
        let files: Vec<PathBuf> = ["a", "bc"]
            .iter()
            .map(|text| {
                let path = folder.path().join(text);
                std::fs::write(&path, text).unwrap();
                path
            })
            .collect();
        // printf abc | sha256sum
        let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(hash_of(&files).as_deref(), Some(known));
        assert_eq!(hash_of(&[folder.path().join("x")]), None);
        assert_eq!(hash_of(&[PathBuf::from("/dev/zero")]), None, "it has no end");
    }

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
