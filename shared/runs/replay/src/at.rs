//! `nims replay --at`: the inputs and outputs of every process at an instant, as the run recorded them.

use crate::sample::sample_value;
use analysis::incidents::{self, Incident};
use command::{Answer, Failure};
use messages::schema::{Number, Schema, Value as FieldValue};
use messages::{
    ControlStatus, Message, MotorAuthority, MotorInput, MotorSlots, MotorState, NodeEstimate, PlanMotion, ProcessState,
    SLOT_NAMES, channel_of,
};
use runlog::{Instant, KeptSample, RunClock, RunReader, seconds_since, utc};
use serde::Serialize;
use serde_json::Value;
use std::path::Path;

/// Entries of an array that text lines show at most: arrays by cable and by unit have eight.
const SHOWN: usize = 8;

/// Times in reports are rounded to a tenth of a second: as much later than the last sample is the end of the run, ns.
const ROUNDED_NS: u64 = 100_000_000;

/// Time after the failure of a process in which it is stated although no fault is present, s.
const LATELY_S: f64 = 10.0;

/// A sample of one channel.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Entry {
    /// Channel name.
    pub channel: String,
    /// Publication time, s since the start of the run.
    pub time_s: f64,
    /// All fields.
    pub sample: Value,
}

/// What a process had read and what it had published.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Process {
    /// Its name: of a controller or an estimator with the slot, of a sensor that of its channel.
    pub process: String,
    /// The samples that its newest answer is computed from, as far as the answer names them.
    pub inputs: Vec<Entry>,
    /// Its newest samples.
    pub outputs: Vec<Entry>,
}

/// The processes at an instant.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Snapshot {
    /// Time since the start of the run, s.
    pub at_s: f64,
    /// UNIX time, ns.
    pub at_unix_ns: u64,
    /// The same as text.
    pub at_utc: String,
    /// Control cycle.
    pub cycle: Option<u64>,
    /// The fault of the instant, or a process that failed in the ten seconds before, with what the robot did.
    pub happened: Option<Incident>,
    /// The processes: the control chain, then the others by name.
    pub processes: Vec<Process>,
    /// Chunks of the run files that were read.
    pub chunks: usize,
}

/// Returns the UNIX time of a time of the run in ns: seconds since its start, or UTC.
///
/// # Errors
/// The text is neither, or the run has no sample.
pub fn instant_of(run: &Path, text: &str) -> Answer<u64> {
    let mut reader = RunReader::open(run).map_err(Failure::bad)?;
    if reader.next_sample().map_err(Failure::not_now)?.is_none() {
        return Err(Failure::NotNow(format!("{} has no sample", run.display())));
    }
    let begin_ns = reader.begin_ns().unwrap_or(0);
    if let Some(at_ns) = runlog::unix_ns(text) {
        return Ok(at_ns);
    }
    match text.trim().parse::<f64>() {
        Ok(at_s) if (0.0..1e7).contains(&at_s) => Ok(begin_ns.saturating_add((at_s * 1e9).round() as u64)),
        _ => Err(Failure::BadInput(format!(
            "--at is {text}; accepted: seconds since the start of the run, or UTC like {}",
            utc(begin_ns)
        ))),
    }
}

/// Reads the processes at a UNIX time, ns.
///
/// # Errors
/// The run cannot be read, or the instant is before its first sample or after its last one.
pub fn snapshot(run: &Path, at_ns: u64) -> Answer<Snapshot> {
    let mut reader = RunReader::open(run).map_err(Failure::bad)?;
    let first_ns = reader.next_sample().map_err(Failure::not_now)?.map_or(at_ns, |first| first.log_time_ns);
    let (begin_ns, clock) = (reader.begin_ns().unwrap_or(first_ns), reader.clock());
    let instant = Instant::read(run, at_ns).map_err(Failure::not_now)?;
    if instant.samples.is_empty() {
        return Err(Failure::BadInput(format!(
            "--at is {}, and the first sample of the run is at {}: give a later time",
            place(begin_ns, at_ns),
            place(begin_ns, first_ns)
        )));
    }
    if at_ns > instant.end_ns.saturating_add(ROUNDED_NS) {
        return Err(Failure::BadInput(format!(
            "--at is {}, and the last sample of the run is at {}: give an earlier time",
            place(begin_ns, at_ns),
            place(begin_ns, instant.end_ns)
        )));
    }
    let view = View { instant: &instant, begin_ns, clock };
    Ok(Snapshot {
        at_s: seconds_since(at_ns, begin_ns),
        at_unix_ns: at_ns,
        at_utc: utc(at_ns),
        cycle: view.newest::<MotorAuthority>("motor/authority").map(|authority| authority.header.cycle),
        happened: view.happened(run, at_ns)?,
        processes: view.processes(),
        chunks: instant.chunks,
    })
}

/// Returns a UNIX time as seconds of the run and as UTC.
fn place(begin_ns: u64, at_ns: u64) -> String {
    format!("{:.3} s ({})", seconds_since(at_ns, begin_ns), utc(at_ns))
}

/// The samples of an instant by process.
struct View<'a> {
    instant: &'a Instant,
    begin_ns: u64,
    clock: Option<RunClock>,
}

impl View<'_> {
    fn newest<T: Message>(&self, channel: &str) -> Option<T> {
        decode(self.instant.samples.get(channel)?.back()?)
    }

    /// Returns the last fault until a UNIX time, ns, if it is present or was shortly before. Only then is more of the
    /// run read than the instant.
    fn happened(&self, run: &Path, at_ns: u64) -> Answer<Option<Incident>> {
        let stopped = |mode| [MotorAuthority::MODE_FAULTED, MotorAuthority::MODE_EMERGENCY_STOP].contains(&mode);
        let authority = self.newest::<MotorAuthority>("motor/authority");
        let present = authority.is_some_and(|authority| authority.faults != 0 || stopped(authority.mode));
        let lost = [ProcessState::STATE_DIED, ProcessState::STATE_SILENT, ProcessState::STATE_GAVE_UP];
        let mut rows =
            self.instant.samples.get("system/process").into_iter().flatten().filter_map(decode::<ProcessState>);
        if !present && !rows.any(|row| lost.contains(&row.state)) {
            return Ok(None);
        }
        let at_s = seconds_since(at_ns, self.begin_ns);
        Ok(incidents::until(run, at_ns)?.pop().filter(|last| present || at_s - last.time_s < LATELY_S))
    }

    fn entry(&self, kept: &KeptSample) -> Entry {
        let schema = Schema::parse(&kept.channel.schema).ok();
        Entry {
            channel: kept.channel.name.clone(),
            time_s: seconds_since(published_unix_ns(kept, schema.as_ref(), self.clock), self.begin_ns),
            sample: sample_value(schema.as_ref(), &kept.sample),
        }
    }

    /// Returns the newest sample of each of these channels.
    fn last(&self, channels: &[&str]) -> Vec<Entry> {
        let newest = channels.iter().filter_map(|channel| self.instant.samples.get(*channel)?.back());
        newest.map(|kept| self.entry(kept)).collect()
    }

    /// Returns the recent sample of a channel that an answer names by its number; 0 names none.
    fn named<T: Message>(&self, channel: &str, number: u64, of: impl Fn(&T) -> u64) -> Option<Entry> {
        let recent = self.instant.samples.get(channel).filter(|_| number > 0)?.iter().rev();
        let is = |kept: &&KeptSample| decode::<T>(kept).is_some_and(|sample| of(&sample) == number);
        recent.filter(|kept| kept.channel.conversion::<T>().is_some()).find(is).map(|kept| self.entry(kept))
    }

    fn of_cycle<T: Message>(&self, channel: &str, cycle: u64) -> Option<Entry> {
        self.named::<T>(channel, cycle, |sample| sample.header().cycle)
    }

    fn processes(&self) -> Vec<Process> {
        let process = |process: &str, inputs: Vec<Entry>, outputs: Vec<Entry>| Process {
            process: process.to_owned(),
            inputs,
            outputs,
        };
        let mut processes = vec![self.motor_io()];
        processes.extend(SLOT_NAMES.iter().filter_map(|slot| self.estimator(slot)));
        processes.extend(SLOT_NAMES.iter().filter_map(|slot| self.controller(slot)));
        let asked = self.last(&["operator/request", "motor/authority"]);
        processes.push(process("planner", asked, self.last(&["plan/motion", "plan/status"])));
        let shown = |name: &str| {
            let cycle = ["motor/", "node/estimate/", "control/status/", "plan/"];
            cycle.iter().any(|beginning| name.starts_with(beginning)) || name == "energy"
        };
        let mut others: Vec<Process> = Vec::new();
        for (name, kept) in self.instant.samples.iter().filter(|(name, _)| !shown(name)) {
            let own = match channel_of(name).map(|channel| channel.publisher) {
                // The channel has the name of its process.
                None | Some("each process" | "each sensor") => name.rsplit('/').next().unwrap_or(name),
                Some(publisher) => publisher,
            };
            let entry = kept.back().map(|kept| self.entry(kept));
            match others.iter_mut().find(|other| other.process == own) {
                Some(other) => other.outputs.extend(entry),
                None => others.push(process(own, Vec::new(), entry.into_iter().collect())),
            }
        }
        others.sort_by(|one, other| one.process.cmp(&other.process));
        processes.extend(others);
        processes.retain(|process| !process.outputs.is_empty());
        processes
    }

    /// Returns motor-io in its newest cycle: the samples of a cycle have stamps of several instants in it.
    fn motor_io(&self) -> Process {
        let cycle = self.newest::<MotorAuthority>("motor/authority").map_or(0, |authority| authority.header.cycle);
        let decided = [
            self.of_cycle::<MotorState>("motor/state", cycle),
            self.of_cycle::<MotorAuthority>("motor/authority", cycle),
            self.of_cycle::<MotorSlots>("motor/slots", cycle),
        ];
        Process {
            process: "motor-io".to_owned(),
            inputs: self.of_cycle::<MotorInput>("motor/input", cycle).into_iter().collect(),
            outputs: decided.into_iter().flatten().chain(self.last(&["energy"])).collect(),
        }
    }

    fn estimator(&self, slot: &str) -> Option<Process> {
        let output = format!("node/estimate/{slot}");
        let estimate = self.newest::<NodeEstimate>(&output)?;
        let state = self.of_cycle::<MotorState>("motor/state", estimate.header.cycle);
        let authority = self.of_cycle::<MotorAuthority>("motor/authority", estimate.based_on_authority);
        Some(Process {
            process: format!("estimator in slot {slot}"),
            inputs: state.into_iter().chain(authority).collect(),
            outputs: self.last(&[&output]),
        })
    }

    fn controller(&self, slot: &str) -> Option<Process> {
        let (status, command) = (format!("control/status/{slot}"), format!("motor/command/{slot}"));
        let answer = self.newest::<ControlStatus>(&status)?;
        let estimates = SLOT_NAMES.iter().zip(answer.based_on_estimate);
        let estimates = estimates
            .filter_map(|(slot, cycle)| self.of_cycle::<NodeEstimate>(&format!("node/estimate/{slot}"), cycle));
        let motion = self.named::<PlanMotion>("plan/motion", answer.based_on_motion, |motion| motion.beat);
        let authority = self.of_cycle::<MotorAuthority>("motor/authority", answer.based_on_authority);
        let state = self.of_cycle::<MotorState>("motor/state", answer.based_on_state);
        Some(Process {
            process: format!("controller in slot {slot}"),
            inputs: estimates.chain(motion).chain(authority).chain(state).collect(),
            outputs: self.last(&[&status, &command]),
        })
    }
}

/// Returns the publication time of a sample, UNIX time, ns. A file that repeats the sample of a silent channel has it
/// at the file's begin; the header has the time of its publication.
fn published_unix_ns(kept: &KeptSample, schema: Option<&Schema>, clock: Option<RunClock>) -> u64 {
    let published_ns = || {
        let field = schema.filter(|schema| schema.has_header())?.field("header.published_ns")?;
        match FieldValue::read(field, &kept.sample)?.number()? {
            Number::Unsigned(published_ns) if published_ns > 0 => Some(clock?.unix_of(published_ns)),
            _ => None,
        }
    };
    // The file orders samples by the time of their content, some milliseconds earlier, and so does the instant.
    published_ns().map_or(kept.log_time_ns, |published_ns| published_ns.min(kept.log_time_ns))
}

fn decode<T: Message>(kept: &KeptSample) -> Option<T> {
    kept.channel.conversion::<T>()?.apply(&kept.sample)
}

impl Snapshot {
    /// Returns the snapshot as text: a line for each sample, and one for each of its fields.
    #[must_use]
    pub fn words(&self) -> String {
        let cycle = self.cycle.map_or_else(String::new, |cycle| format!(", cycle {cycle}"));
        let mut lines = vec![format!("{:.3} s of the run, {}{cycle}", self.at_s, self.at_utc)];
        lines.extend(self.happened.iter().map(|incident| format!("fault: {}", incident.sentence)));
        for process in &self.processes {
            lines.push(format!("\n{}", process.process));
            let inputs = process.inputs.iter().map(|entry| ("in ", entry));
            for (way, entry) in inputs.chain(process.outputs.iter().map(|entry| ("out", entry))) {
                lines.push(format!("  {way} {} at {:.3} s", entry.channel, entry.time_s));
                let fields = entry.sample.as_object().into_iter().flatten();
                lines.extend(fields.map(|(field, value)| format!("        {field} = {}", field_text(value))));
            }
        }
        lines.join("\n")
    }
}

fn field_text(value: &Value) -> String {
    match value {
        Value::Array(values) if values.len() > SHOWN => {
            let shown: Vec<String> = values.iter().take(SHOWN).map(field_text).collect();
            format!("[{}, .. {} values]", shown.join(", "), values.len())
        }
        Value::Array(values) => format!("[{}]", values.iter().map(field_text).collect::<Vec<_>>().join(", ")),
        Value::Null => "none".to_owned(),
        other => other.to_string(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use messages::SystemConfig;
    use runlog::{ChannelSpec, RunWriter, next_file};

    const SECOND_NS: u64 = 1_000_000_000;

    /// Writes a file that begins with the configuration of 2 s, and has samples of each cycle of 10 ms.
    fn write(folder: &Path, from_ns: u64, to_ns: u64, published_ns: u64) {
        let clock = RunClock { t0_unix_ns: 1_700_000_000 * SECOND_NS, t0_mono_ns: 0 };
        let mut writer = RunWriter::create(&next_file(folder), clock, &Default::default(), &[]).unwrap();
        let channel = writer.add_channel(&ChannelSpec::for_type::<SystemConfig>("system/config/planner")).unwrap();
        let authority = writer.add_channel(&ChannelSpec::for_type::<MotorAuthority>("motor/authority")).unwrap();
        let state = writer.add_channel(&ChannelSpec::for_type::<MotorState>("motor/state")).unwrap();
        let estimate = writer.add_channel(&ChannelSpec::for_type::<NodeEstimate>("node/estimate/a")).unwrap();
        let mut config = SystemConfig::default();
        (config.header.seq, config.header.stamp_ns, config.header.published_ns) = (1, 2 * SECOND_NS, published_ns);
        writer.write(channel, 1, from_ns, 2 * SECOND_NS, bytemuck::bytes_of(&config)).unwrap();
        for stamp_ns in (from_ns..to_ns).step_by(10_000_000) {
            let cycle = stamp_ns / 10_000_000;
            let header = messages::Header { life: 1, cycle, seq: cycle, ..messages::Header::at(stamp_ns) };
            // Published after its content.
            let header = messages::Header { published_ns: stamp_ns + 5_000_000, ..header };
            let decided = MotorAuthority { header, ..Default::default() };
            let read = MotorState { header, ..Default::default() };
            // The estimator answers five cycles late.
            let mut late = NodeEstimate { header, based_on_authority: cycle - 6, ..Default::default() };
            late.header.cycle = cycle - 5;
            writer.write(authority, cycle, stamp_ns, stamp_ns, bytemuck::bytes_of(&decided)).unwrap();
            writer.write(state, cycle, stamp_ns, stamp_ns, bytemuck::bytes_of(&read)).unwrap();
            writer.write(estimate, cycle, stamp_ns, stamp_ns, bytemuck::bytes_of(&late)).unwrap();
        }
        writer.finish(&Default::default()).unwrap();
    }

    fn output_time_s(snapshot: &Snapshot, channel: &str) -> f64 {
        let mut outputs = snapshot.processes.iter().flat_map(|process| &process.outputs);
        outputs.find(|entry| entry.channel == channel).unwrap().time_s
    }

    #[test]
    fn a_sample_that_a_new_file_repeats_has_the_time_of_its_publication() {
        let at = |unix_s: u64| (1_700_000_000 + unix_s) * SECOND_NS;
        let folder = tempfile::tempdir().unwrap();
        // The file before is missing: this one begins at 10 s with what was published at 2.25 s.
        write(folder.path(), 10 * SECOND_NS, 12 * SECOND_NS, 2_250_000_000);
        // Its seconds are those of the whole run.
        assert_eq!(instant_of(folder.path(), "11").unwrap(), at(11));
        let snapshot = snapshot(folder.path(), at(11)).unwrap();
        assert_eq!(snapshot.at_s, 11.0);
        let time_s = output_time_s(&snapshot, "system/config/planner");
        assert!((time_s - 2.25).abs() < 1e-6, "{time_s} s");
        let time_s = output_time_s(&snapshot, "motor/authority");
        assert!((time_s - 11.0).abs() < 1e-6, "{time_s} s: not after the instant");
    }

    #[test]
    fn an_instant_outside_of_the_run_is_refused_with_its_ends() {
        let at_ns = |unix_s: f64| 1_700_000_000 * SECOND_NS + (unix_s * 1e9) as u64;
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), 2 * SECOND_NS, 10 * SECOND_NS, 2_250_000_000);
        write(folder.path(), 10 * SECOND_NS, 12 * SECOND_NS, 2_250_000_000);
        for (unix_s, named) in [(1.5, ["1.500 s", "2.000 s"]), (12.5, ["12.500 s", "11.990 s"])] {
            let refused = snapshot(folder.path(), at_ns(unix_s)).unwrap_err();
            let text = refused.to_string();
            assert!(refused.exit_code() == 2 && named.iter().all(|named| text.contains(named)), "{text}");
        }
        // The end as `nims info` rounds it.
        let last = snapshot(folder.path(), at_ns(12.0)).unwrap();
        assert_eq!((last.cycle, last.happened), (Some(1199), None));
        // The same for a file without an index.
        let file = folder.path().join("run-0002.mcap");
        let bytes = std::fs::read(&file).unwrap();
        std::fs::write(&file, &bytes[..bytes.len() * 9 / 10]).unwrap();
        assert_eq!(snapshot(folder.path(), at_ns(20.0)).unwrap_err().exit_code(), 2);
    }

    #[test]
    fn a_sample_without_a_time_of_publication_has_that_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), 10 * SECOND_NS, 12 * SECOND_NS, 0);
        let snapshot = snapshot(folder.path(), (1_700_000_000 + 11) * SECOND_NS).unwrap();
        assert!((output_time_s(&snapshot, "system/config/planner") - 10.0).abs() < 1e-6);
    }

    #[test]
    fn shortly_after_a_new_file_answers_still_have_their_inputs() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), 2 * SECOND_NS, 10 * SECOND_NS, 2_250_000_000);
        write(folder.path(), 10 * SECOND_NS, 12 * SECOND_NS, 2_250_000_000);
        for cycles in [0, 1, 4, 7, 100] {
            let at_ns = 1_700_000_010 * SECOND_NS + cycles * 10_000_000;
            let snapshot = snapshot(folder.path(), at_ns).unwrap();
            let estimator = snapshot.processes.iter().find(|process| process.process == "estimator in slot a").unwrap();
            let inputs: Vec<_> = estimator.inputs.iter().map(|entry| &entry.sample["header.cycle"]).collect();
            assert_eq!(inputs, [&Value::from(995 + cycles), &Value::from(994 + cycles)], "{cycles} cycles later");
            assert_eq!(snapshot.cycle, Some(1000 + cycles));
            let time_s = output_time_s(&snapshot, "system/config/planner");
            assert!((time_s - 2.0).abs() < 1e-6, "the file before begins with it, not at {time_s} s");
        }
    }
}
