//! The request to set a parameter while the robot runs: checked, recorded in the run folder, and announced.

use super::Supervisor;
use super::refused::{Decision, bus_failed};
use bus::clock;
use config::{Role, SystemFile};
use messages::newer;
use robot_state::Reason;
use robot_state::answers::detail;

/// Least time from the announcement of a change to its effect, s: processes receive it one cycle after the
/// announcement.
const LEAD_S: f64 = 0.1;

/// Record of the changes in the run folder.
const RECORD: &str = "set.toml";

const RECORD_HEAD: &str =
    "# Changes by `nims set`, in order; resolved-NUMBER.toml is the system file with all changes up to NUMBER.\n";

impl Supervisor {
    /// Sets a parameter in every process of its role until the run ends.
    pub(super) fn set(&mut self, key: &str, value: &str) -> Decision {
        let invalid = |why: String| Reason::ParameterInvalid { key: detail(key), why: detail(why) };
        let tuned = self.settings.tuned.with(key, value).map_err(invalid)?;
        let file = self.context.file.tuned(&self.settings.robot, &tuned).map_err(invalid)?;
        let (was, is) = (self.settings.file.value_of(key), file.value_of(key));
        if was == is {
            return Ok(Reason::ParameterUnchanged { key: detail(key), value: detail(is) });
        }
        let number = self.settings.sample.changes + 1;
        let (life, cycle) = self.cycle_of_change(&file)?;
        let not_recorded = |why: std::fmt::Arguments<'_>| Reason::ParameterNotRecorded {
            key: detail(key),
            before: detail(&was),
            why: detail(why),
        };
        let name = format!("resolved-{number}.toml");
        let text = file.resolved("robot.toml").map_err(|why| not_recorded(format_args!("{why}")))?;
        let head = format!(
            "# The system file with the first {number} changes of set.toml; processes that start from now on read it.\n\n"
        );
        let run = self.folder.path().to_path_buf();
        let copies = self.folder.copies().clone();
        let earlier = copies.with(|copies| copies.text(RECORD)).unwrap_or_else(|| RECORD_HEAD.to_owned());
        let record = format!("{earlier}{}", entry(number, key, &was, &is, cycle));
        let files = [(name.clone(), format!("{head}{text}")), (RECORD.to_owned(), record)];
        let written = files.iter().map(|(name, text)| (run.join(name), text.clone())).collect();
        self.restore_folder();
        if let Err(why) = self.archive.write_in_time(written) {
            // A slow disk may still write the change, which is not made.
            self.archive.write(run.join(RECORD), earlier);
            return Err(not_recorded(format_args!("{why}")).into());
        }
        for (name, text) in files {
            copies.with(|copies| copies.add(&name, text));
        }
        (self.settings.tuned, self.settings.file, self.settings.path) = (tuned, file, run.join(name));
        (self.settings.sample.changes, self.settings.sample.from_cycle, self.settings.life) = (number, cycle, life);
        self.settings.publish().map_err(bus_failed)?;
        Ok(Reason::ParameterChanged { cycle, key: detail(key), value: detail(is), before: detail(was) })
    }

    /// Life of motor-io and cycle from which a change applies; 0 (at once) while motor-io does not run.
    fn cycle_of_change(&mut self, file: &SystemFile) -> Decision<(u64, u64)> {
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
