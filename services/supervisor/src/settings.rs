//! Parameters that the operator sets while the robot runs.
//!
//! A change passes the same checks as the system file, is recorded, and is announced on `system/config/nims`: from a
//! stated cycle on it applies in every process of its role. A process that starts later reads a copy of the system
//! file that includes all changes.

use super::Supervisor;
use super::process_spec::{ProcessSpec, Site};
use bus::{Bus, Publisher, clock};
use command::{Answer, Failure};
use config::{RobotFile, Role, SystemFile, Tuned};
use messages::{Header, SystemConfig, newer, put_text};
use robot_state::Reason;
use robot_state::answers::detail;
use runtime::{ProgramHash, TUNED_CHANNEL, build, hash_of, parts_of};
use std::ffi::OsString;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Least time from the announcement of a change to its effect, s: processes receive it one cycle after the announcement.
const LEAD_S: f64 = 0.1;
/// Record of the changes in the run folder.
const RECORD: &str = "set.toml";
const RECORD_HEAD: &str =
    "# Changes by `nims set`, in order; resolved-NUMBER.toml is the system file with all changes up to NUMBER.\n";

/// The parameters that were set so far.
pub struct Settings {
    port: Publisher<SystemConfig>,
    sample: Box<SystemConfig>,
    program_hash: ProgramHash,
    robot: RobotFile,
    tuned: Tuned,
    /// The system file with all changes, and the path of its copy.
    file: SystemFile,
    path: PathBuf,
    /// The life of motor-io in which the last change was announced.
    life: u64,
}

impl Settings {
    /// Without any change.
    pub(super) fn new(bus: &Bus, site: &Site, incarnation: u32) -> Answer<Self> {
        let robot = site.file.robot_file().map_err(Failure::not_now)?;
        let mut sample = Box::new(SystemConfig { pid: std::process::id(), incarnation, ..SystemConfig::default() });
        put_text(&mut sample.name, client::SUPERVISOR);
        put_text(&mut sample.version, build::own());
        let program = std::env::current_exe().unwrap_or_default();
        put_text(&mut sample.program, &program.to_string_lossy());
        let program_hash = ProgramHash::begin(program);
        let (file, path) = (site.file.clone(), site.config.clone());
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
        if let Some(hash) = self.program_hash.take() {
            put_text(&mut self.sample.program_sha256, &hash);
            self.publish()?;
        }
        self.port.update_connections();
        Ok(())
    }

    fn publish(&mut self) -> Answer {
        self.sample.header = Header { life: self.life, ..Header::at(clock::now_ns()) };
        put_text(&mut self.sample.parameters, self.tuned.text().trim_end());
        put_text(&mut self.sample.file, &self.path.to_string_lossy());
        let parts = parts_of(&self.path, &self.file.robot, Some(&self.robot));
        put_text(&mut self.sample.file_sha256, &hash_of(&parts).unwrap_or_default());
        self.port.send(&mut self.sample)?;
        Ok(())
    }
}

impl Supervisor {
    /// Sets a parameter in every process of its role until the run ends.
    pub(super) fn set(&mut self, key: &str, value: &str) -> Answer<Reason> {
        let tuned = self.settings.tuned.with(key, value).map_err(Failure::BadInput)?;
        let file = self.site.file.tuned(&self.settings.robot, &tuned).map_err(Failure::BadInput)?;
        let (was, is) = (self.settings.file.value_of(key), file.value_of(key));
        if was == is {
            return Ok(Reason::ParameterSet { what: detail(format_args!("{key} is {is} already")) });
        }
        let number = self.settings.sample.changes + 1;
        let (life, cycle) = self.cycle_of_change(&file)?;
        let failed = |path: &Path, error: std::io::Error| {
            Failure::NotNow(format!(
                "{key} stays {was}, because the change cannot be recorded: {}: {error}",
                path.display()
            ))
        };
        let name = format!("resolved-{number}.toml");
        let text = file.resolved("robot.toml").map_err(Failure::NotNow)?;
        let head = format!(
            "# The system file with the first {number} changes of set.toml; processes that start from now on read it.\n\n"
        );
        let run = self.folder.path().to_path_buf();
        self.folder.copies().add(&name, format!("{head}{text}"));
        self.folder.copies().restore(&run).map_err(|(path, error)| failed(&path, error))?;
        let record = run.join(RECORD);
        append(&record, &entry(number, key, &was, &is, cycle)).map_err(|error| failed(&record, error))?;
        if let Ok(text) = std::fs::read_to_string(&record) {
            self.folder.copies().add(RECORD, text);
        }
        (self.settings.tuned, self.settings.file, self.settings.path) = (tuned, file, run.join(name));
        (self.settings.sample.changes, self.settings.sample.from_cycle, self.settings.life) = (number, cycle, life);
        self.settings.publish()?;
        let (role, _) = key.split_once('.').unwrap_or((key, ""));
        let was = if was.is_empty() { "not given".to_owned() } else { was };
        let end = "until this run ends";
        let what = format_args!("{key} is {is} from cycle {cycle} on (before: {was}), in every {role}, {end}");
        Ok(Reason::ParameterSet { what: detail(what) })
    }

    /// Life of motor-io and cycle from which a change applies; 0 (at once) while motor-io does not run.
    fn cycle_of_change(&mut self, file: &SystemFile) -> Answer<(u64, u64)> {
        self.last_authority = newer(self.last_authority, self.authority.latest()?);
        if !self.process_set.has_ready(Role::MotorIo) {
            return Ok((0, 0));
        }
        let lead = (file.arbiter.announce_s.max(LEAD_S) * file.rate_hz).ceil() as u64;
        let header = self.last_authority.map(|authority| authority.header).unwrap_or_default();
        Ok((header.life, header.cycle + lead))
    }
}

/// The entry of a change in the record.
fn entry(number: u32, key: &str, was: &str, is: &str, cycle: u64) -> String {
    let was = if was.is_empty() { String::new() } else { format!("was = {was}\n") };
    let utc = runlog::utc(clock::unix_ns());
    format!("\n[[set]]\nnumber = {number}\nkey = \"{key}\"\n{was}is = {is}\nfrom_cycle = {cycle}\nutc = \"{utc}\"\n")
}

fn append(path: &Path, text: &str) -> std::io::Result<()> {
    let mut file = OpenOptions::new().create(true).append(true).open(path)?;
    if file.metadata()?.len() == 0 {
        file.write_all(RECORD_HEAD.as_bytes())?;
    }
    file.write_all(text.as_bytes())
}
