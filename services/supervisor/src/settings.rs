//! Parameters that the operator sets while the robot runs.
//!
//! A change is checked as the file is, written down, and announced on `system/config/nims`: from a stated cycle on it holds in every
//! process of its role. A process that is started later reads a copy of the box that has all changes.

use super::Supervisor;
use super::process_spec::{ProcessSpec, Site};
use bus::{Bus, Publisher, clock};
use command::{Answer, Failure};
use config::{RobotFile, Role, SystemFile, Tuned};
use messages::{Header, SystemConfig, newer, put_text};
use runtime::{ProgramHash, TUNED_CHANNEL, build, hash_of, parts_of};
use std::ffi::OsString;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A change is announced at least this long before it holds, s: processes hear of it in the cycle after.
const LEAD_S: f64 = 0.1;
/// The record of the changes, in the run folder.
const RECORD: &str = "set.toml";
const RECORD_HEAD: &str =
    "# What was set with `nims set`, in this order; resolved-NUMBER.toml is the box with all changes up to NUMBER.\n";

/// What is set so far.
pub struct Settings {
    port: Publisher<SystemConfig>,
    sample: Box<SystemConfig>,
    program_hash: ProgramHash,
    robot: RobotFile,
    tuned: Tuned,
    /// The box with all changes, and where its copy stands.
    file: SystemFile,
    path: PathBuf,
    /// The life of motor-io in which the last change was announced.
    life: u64,
}

impl Settings {
    /// Nothing is set.
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

    /// A process as it is started now: it reads the box with all changes.
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

    /// How many changes there were.
    pub(super) fn changes(&self) -> u32 {
        self.sample.changes
    }

    /// The program's hash, once it is there; a listener that came since the last change gets that too.
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
    /// Another value of a parameter, in every process of its role, until the run ends.
    pub(super) fn set(&mut self, key: &str, value: &str) -> Answer<String> {
        let tuned = self.settings.tuned.with(key, value).map_err(Failure::BadInput)?;
        let file = self.site.file.tuned(&self.settings.robot, &tuned).map_err(Failure::BadInput)?;
        let (was, is) = (self.settings.file.value_of(key), file.value_of(key));
        if was == is {
            return Ok(format!("{key} is {is} already"));
        }
        let number = self.settings.sample.changes + 1;
        let (life, cycle) = self.cycle_of_change(&file)?;
        let failed = |path: &Path, error: std::io::Error| {
            Failure::NotNow(format!(
                "{key} stays {was}, because the change cannot be written down: {}: {error}",
                path.display()
            ))
        };
        let name = format!("resolved-{number}.toml");
        let text = file.resolved("robot.toml").map_err(Failure::NotNow)?;
        let head = format!(
            "# The box with the first {number} changes of set.toml: a process that is started from now on reads it.\n\n"
        );
        let run = self.folder.path().to_path_buf();
        self.folder.copies().add(&name, format!("{head}{text}"));
        self.folder.copies().put_back(&run).map_err(|(path, error)| failed(&path, error))?;
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
        Ok(format!("{key} is {is} from cycle {cycle} on, and was {was}: in every {role}, until this run ends"))
    }

    /// Life of motor-io and cycle from which a change holds; 0, at once, where there are no cycles.
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

/// What stands in the record of a change.
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
