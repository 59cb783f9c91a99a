//! The request to set a parameter while the robot runs: checked, recorded in the run folder, and announced.

use super::Supervisor;
use bus::clock;
use command::{Answer, Failure};
use config::{Role, SystemFile};
use messages::newer;
use robot_state::Reason;
use robot_state::answers::detail;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

/// Least time from the announcement of a change to its effect, s: processes receive it one cycle after the
/// announcement.
const LEAD_S: f64 = 0.1;

/// Record of the changes in the run folder.
const RECORD: &str = "set.toml";

const RECORD_HEAD: &str =
    "# Changes by `nims set`, in order; resolved-NUMBER.toml is the system file with all changes up to NUMBER.\n";

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
