//! `nims status`: the state of the robot and its processes.

use bus::{Memory, clock};
use client::{RobotLink, Samples as Received, state_name};
use command::{Answer, Output};
use messages::{
    ControlStatus, LogEvent, Message, MotorAuthority, MotorSlots, MotorState, NodeEstimate, PlanStatus, ProcessState,
    RecorderStatus, Rule, SLOT_NAMES, SLOTS, SystemConfig, blended_estimate, text_of,
};
use robot_state::{Periods, sentences};
use runtime::TUNED_CHANNEL;
use serde_json::{Value, json};
use std::collections::BTreeMap;

pub use robot_state::sentences::mode_name;

/// Longest time to wait for a sample of every channel, ns: the slowest publish once a second, and the machine may
/// stall.
const TIMEOUT_NS: u64 = 1_500_000_000;
/// Time between two polls of the channels, ns.
const POLL_NS: u64 = 20_000_000;
/// Age from which the recorder's status is stale, s: it is published once a second.
const OLD_S: f64 = 2.5;
/// Age of the last sample from which motor-io does not control the motors, s: a shared machine may stall for 0.25 s.
const SILENT_S: f64 = 1.0;
/// Time to wait for a valid estimate if the position is known, ns: a cycle without readings has none, a later one may.
const ESTIMATE_NS: u64 = 300_000_000;
/// Time in which a new subscriber receives the stored log, ns: a process sends it with its next heartbeat, five times a
/// second.
const LOG_NS: u64 = 500_000_000;

/// The process table, and the time in which all its rows are published again, ns: a second in ten parts, each with the
/// delay of a round of the supervisor.
const TABLE: &str = "system/process";
const TABLE_NS: u64 = 1_300_000_000;

/// Why no mission runs.
const WITHOUT_MOTOR_IO: &str = "motor-io is not running";

/// Free shared memory below which a new process may fail to start, bytes.
const SCARCE_BYTES: u64 = 8 << 20;

/// Newest sample of a channel.
struct Newest<T: Message> {
    subscriber: Received<T>,
    sample: Option<T>,
}

impl<T: Message> Newest<T> {
    fn subscribe(link: &RobotLink, channel: &str) -> Answer<Self> {
        Ok(Self { subscriber: link.subscriber(channel)?, sample: None })
    }

    fn poll(&mut self) -> Answer<bool> {
        if let Some(sample) = self.subscriber.latest()? {
            self.sample = Some(sample);
        }
        Ok(self.sample.is_some())
    }
}

/// Newest samples of every channel that the status shows.
struct Samples {
    authority: Newest<MotorAuthority>,
    state: Newest<MotorState>,
    estimates: [Newest<NodeEstimate>; SLOTS],
    controls: [Newest<ControlStatus>; SLOTS],
    slots: Newest<MotorSlots>,
    plan: Newest<PlanStatus>,
    recorder: Newest<RecorderStatus>,
    set: Newest<SystemConfig>,
    table: Received<ProcessState>,
    processes: Processes,
}

/// The process table, as far as its rows have arrived.
#[derive(Default)]
struct Processes {
    rows: BTreeMap<String, ProcessState>,
    received: usize,
    /// Time of the oldest received row, ns.
    oldest_ns: u64,
}

impl Processes {
    fn record(&mut self, row: ProcessState) {
        let stamp_ns = row.header.stamp_ns;
        self.oldest_ns = if self.received == 0 { stamp_ns } else { self.oldest_ns.min(stamp_ns) };
        self.received += 1;
        let name = text_of(&row.name);
        if row.state == ProcessState::STATE_GONE {
            self.rows.remove(&name);
        } else {
            self.rows.insert(name, row);
        }
    }

    /// Returns whether every row has arrived: the table is larger than what a new subscriber receives of it, but each
    /// row is published again within a second.
    fn are_whole(&self, now_ns: u64) -> bool {
        let at_first = messages::quality_of(TABLE).late;
        !self.rows.is_empty() && (self.received < at_first || now_ns.saturating_sub(self.oldest_ns) >= TABLE_NS)
    }
}

impl Samples {
    fn subscribe(link: &RobotLink) -> Answer<Self> {
        let [a, b] = SLOT_NAMES;
        let estimate = |slot| Newest::subscribe(link, &format!("node/estimate/{slot}"));
        let control = |slot| Newest::subscribe(link, &format!("control/status/{slot}"));
        Ok(Self {
            authority: Newest::subscribe(link, "motor/authority")?,
            state: Newest::subscribe(link, "motor/state")?,
            estimates: [estimate(a)?, estimate(b)?],
            controls: [control(a)?, control(b)?],
            slots: Newest::subscribe(link, "motor/slots")?,
            plan: Newest::subscribe(link, "plan/status")?,
            recorder: Newest::subscribe(link, "recorder/status")?,
            set: Newest::subscribe(link, TUNED_CHANNEL)?,
            table: link.subscriber(TABLE)?,
            processes: Processes::default(),
        })
    }

    /// Waits until every channel has a sample, at most for `TIMEOUT_NS`.
    fn collect(&mut self) -> Answer<()> {
        let begun = clock::now_ns();
        loop {
            let complete = self.poll()?;
            let known = self.state.sample.is_some_and(|state| state.position_known == MotorState::POSITION_KNOWN);
            let passed = clock::now_ns() - begun;
            let settled = !known
                || passed >= ESTIMATE_NS
                || self.estimates.iter().any(|one| one.sample.is_some_and(|estimate| estimate.valid == 1));
            if (complete && settled) || passed >= TIMEOUT_NS {
                return Ok(());
            }
            clock::sleep_until(clock::now_ns() + POLL_NS);
        }
    }

    /// Receives what has arrived; returns true once every channel has a sample.
    fn poll(&mut self) -> Answer<bool> {
        while let Some(row) = self.table.receive()? {
            self.processes.record(row);
        }
        let have = [
            self.authority.poll()?,
            self.state.poll()?,
            // One of the two slots suffices.
            self.estimates[0].poll()? | self.estimates[1].poll()?,
            self.controls[0].poll()? | self.controls[1].poll()?,
            self.slots.poll()?,
            self.plan.poll()?,
            self.recorder.poll()?,
            self.set.poll()?,
            self.processes.are_whole(clock::now_ns()),
        ];
        Ok(have.iter().all(|have| *have))
    }
}

/// Returns the state of the robot.
///
/// # Errors
/// Shared memory cannot be read.
pub fn status(link: &RobotLink) -> Answer<Output> {
    let mut samples = Samples::subscribe(link)?;
    samples.collect()?;
    let mut value = json!({ "domain": link.name() });
    let mut lines = vec![format!("domain     {}", link.name())];
    if let Some(running) = link.running()? {
        value["run"] = json!(running.run);
        value["system"] = json!(running.system_file);
        lines.push(format!("run        {}", running.run.display()));
    }
    if let Some(set) = samples.set.sample.filter(|set| set.changes > 0) {
        let set = text_of(&set.parameters);
        value["set"] = json!(set.lines().collect::<Vec<_>>());
        lines.push(format!("set        {}", set.lines().collect::<Vec<_>>().join(", ")));
    }
    let authority = samples.authority.sample.as_ref();
    match authority {
        Some(authority) => {
            motors(authority, samples.processes.rows.get("motor-io"), &mut value, &mut lines);
            if authority.faults & MotorAuthority::FAULT_LOST_UNIT != 0
                && let Some(warning) = port_warning(link)?
            {
                lines.push(format!("drives     {warning}"));
                value["drives"] = json!(warning);
            }
        }
        None => lines.push("motor-io   is not running; the robot cannot move".to_owned()),
    }
    if let Some(sample) = &samples.slots.sample {
        slots(sample, &samples.processes.rows, &mut value, &mut lines);
    }
    node(&samples, &mut value, &mut lines);
    if let Some(plan) = &samples.plan.sample {
        let steered = steering(authority, samples.processes.rows.get("motor-io"), clock::now_ns());
        mission(plan, steered, &mut value, &mut lines);
    }
    system(link, &samples, &mut value, &mut lines)?;
    Ok(Output::new(value, lines.join("\n")))
}

/// Position, tensions and tracking error of the node, lengths and currents of the cables.
fn node(samples: &Samples, value: &mut Value, lines: &mut Vec<String>) {
    let authority = samples.authority.sample.as_ref();
    if let Some(state) = &samples.state.sample {
        let cables = usize::from(state.cable_count).min(state.length_m.len());
        value["lengths_m"] = json!(state.length_m[..cables]);
        value["currents_a"] = json!(state.current_a[..cables]);
    }
    let [one, other] = &samples.estimates;
    let estimate = blended_estimate(authority, [one.sample.as_ref(), other.sample.as_ref()], Rule::History);
    if let Some(estimate) = estimate.filter(|estimate| estimate.valid == 1) {
        let cables = usize::from(estimate.cable_count).min(estimate.tension_n.len());
        let [x, y, z] = estimate.position_m;
        let tensions = &estimate.tension_n[..cables];
        value["position_m"] = json!(estimate.position_m);
        value["tensions_n"] = json!(tensions);
        let listed: Vec<String> = tensions.iter().map(|tension| format!("{tension:.1}")).collect();
        // Two standard deviations over all axes together.
        let within_m = estimate.two_sigma_m().iter().map(|m| m * m).sum::<f64>().sqrt();
        value["within_m"] = json!(within_m);
        let (within_mm, tensions) = (within_m * 1e3, listed.join(", "));
        lines.push(format!("node       at {x:.3}, {y:.3}, {z:.3} m within {within_mm:.0} mm; tensions {tensions} N"));
    } else {
        lines.push("node       position not estimated".to_owned());
    }
    let leading = authority.map_or(0, |authority| usize::from(authority.active_controller).min(1));
    let control = samples.controls[leading].sample;
    if let Some(control) = control.filter(|control| control.valid == 1 && control.segment != 0) {
        value["tracking_error_m"] = json!(control.error_norm_m);
    }
}

/// Recorder, shared memory and processes.
fn system(link: &RobotLink, samples: &Samples, value: &mut Value, lines: &mut Vec<String>) -> Answer {
    if let Some(recorder) = &samples.recorder.sample {
        let recording = recording_words(recorder, clock::now_ns());
        value["recorder"] = json!({ "state": recording, "messages": recorder.total_messages, "bytes": recorder.total_bytes, "lost": recorder.lost });
        let megabytes = recorder.total_bytes as f64 * 1e-6;
        lines.push(format!("recorder   {recording}, {} messages, {megabytes:.1} MB", recorder.total_messages));
    }
    let memory = link.memory()?;
    value["shared_memory"] =
        json!({ "used_bytes": memory.used, "free_bytes": memory.free, "total_bytes": memory.total });
    lines.push(format!("memory     {}", memory_words(&memory)));
    let processes = &samples.processes.rows;
    value["processes"] = processes.iter().map(|(name, row)| json!({ "name": name, "pid": row.pid, "state": state_name(row.state), "restarts": row.restarts })).collect();
    let listed: Vec<String> = processes.iter().map(|(name, row)| format!("{name} {}", state_name(row.state))).collect();
    lines
        .push(format!("processes  {}", if listed.is_empty() { "no supervisor".to_owned() } else { listed.join(", ") }));
    Ok(())
}

/// Returns the usage of shared memory on one text line, with a warning before it is exhausted.
fn memory_words(memory: &Memory) -> String {
    let megabytes = |bytes: u64| format!("{:.1} MB", bytes as f64 * 1e-6);
    let used = format!("{} of shared memory used by this robot", megabytes(memory.used));
    match (memory.total, memory.free) {
        (0, _) => used,
        (total, free) if free < SCARCE_BYTES => format!(
            "{used}, ONLY {} of {} free: processes and sensors may fail to start; free space in /dev/shm",
            megabytes(free),
            megabytes(total)
        ),
        (total, free) => format!("{used}, {} of {} free", megabytes(free), megabytes(total)),
    }
}

fn motors(authority: &MotorAuthority, row: Option<&ProcessState>, value: &mut Value, lines: &mut Vec<String>) {
    let faults = sentences::faults_of(authority);
    let position = position_words(authority.position_known, row, clock::now_ns());
    value["mode"] = json!(mode_name(authority.mode));
    value["faults"] = json!(faults);
    value["position"] = json!(position);
    value["plan_rate"] = json!(authority.plan_rate);
    value["cycle"] = json!({
        "number": authority.header.cycle, "period_s": authority.period_s, "bus_ns": authority.bus_ns, "command_age_ns": authority.command_age_ns,
    });
    let periods = Periods::from_authority(authority);
    value["periods"] = json!(periods);
    value["periods"]["all"] = json!(periods.all());
    value["periods"]["unsteered"] = json!(periods.unsteered());
    lines.push(format!("mode       {}: {}", mode_name(authority.mode), sentences::mode_sentence(authority.mode)));
    lines.extend(faults.iter().map(|fault| format!("fault      {fault}")));
    lines.push(format!("position   {position}"));
    lines.push(format!(
        "cycle      {} at {:.0} Hz; {}",
        authority.header.cycle,
        1.0 / authority.period_s,
        periods.summary()
    ));
}

/// Returns motor-io's last warning about one of its serial ports.
fn port_warning(link: &RobotLink) -> Answer<Option<String>> {
    let Ok(file) = client::system_of(link) else { return Ok(None) };
    let root = link.domain_folder()?.to_string_lossy().into_owned();
    let ports: Vec<String> = file.motor_io.ports.iter().map(|port| port.path.replace("{domain}", &root)).collect();
    let mut log = link.subscriber::<LogEvent>("system/log/motor-io")?;
    let (mut warning, give_up) = (None, clock::now_ns() + LOG_NS);
    while clock::now_ns() < give_up {
        while let Some(event) = log.receive()? {
            let text = text_of(&event.text);
            if event.level >= LogEvent::LEVEL_WARN && ports.iter().any(|port| text.starts_with(port)) {
                warning = Some(text);
            }
        }
        clock::sleep_until(clock::now_ns() + POLL_NS);
    }
    Ok(warning)
}

/// Returns how reliable the position is. For a position that was restored at a start of motor-io, `row`, the row of
/// motor-io in the process table, adds the time of that start.
pub(crate) fn position_words(position_known: u8, row: Option<&ProcessState>, now_ns: u64) -> String {
    let sentence = sentences::position_sentence(position_known);
    let Some(row) = row.filter(|_| position_known == MotorState::POSITION_RESTORED) else {
        return sentence.to_owned();
    };
    let ago_s = now_ns.saturating_sub(row.started_ns) as f64 * 1e-9;
    let which =
        if row.restarts == 0 { "with this run".to_owned() } else { format!("restart {} of this run", row.restarts) };
    format!("{sentence} motor-io was started {ago_s:.0} s ago, {which}.")
}

/// Adds the controllers and estimators in charge and on standby.
fn slots(slots: &MotorSlots, processes: &BTreeMap<String, ProcessState>, value: &mut Value, lines: &mut Vec<String>) {
    for (role, role_name) in sentences::ROLE_NAMES.iter().enumerate() {
        let states = SLOT_NAMES.iter().enumerate().map(|(slot, name)| {
            let index = SLOTS * role + slot;
            let (phase, cause) = (slots.phase[index], sentences::cause_phrase(role, slots.cause[index]));
            // A process that was ended on request has not failed.
            let ended = processes.values().any(|row| {
                row.state == ProcessState::STATE_STOPPED
                    && text_of(&row.role) == *role_name
                    && usize::from(row.slot) == slot + 1
            });
            let cause = if ended && phase == MotorSlots::PHASE_EMPTY { "" } else { cause };
            (*name, sentences::phase_name(phase), cause, phase != MotorSlots::PHASE_EMPTY)
        });
        let listed: Vec<String> = states
            .clone()
            .filter(|(.., cause, occupied)| *occupied || !cause.is_empty())
            .map(|(name, phase, cause, _)| match cause {
                "" => format!("{name} {phase}"),
                cause => format!("{name} {phase} (it {cause})"),
            })
            .collect();
        value[*role_name] =
            states.map(|(name, phase, cause, _)| json!({ "slot": name, "phase": phase, "cause": cause })).collect();
        if !listed.is_empty() {
            lines.push(format!("{role_name:<10} {}", listed.join(", ")));
        }
    }
}

/// Returns `authority` if motor-io runs and publishes, otherwise why the motors are not controlled: the last sample
/// remains in shared memory after motor-io has ended.
fn steering<'a>(
    authority: Option<&'a MotorAuthority>,
    row: Option<&ProcessState>,
    now_ns: u64,
) -> Result<&'a MotorAuthority, String> {
    let ended = [ProcessState::STATE_DIED, ProcessState::STATE_GAVE_UP, ProcessState::STATE_STOPPED];
    let ended = row.is_some_and(|row| ended.contains(&row.state));
    let Some(authority) = authority.filter(|_| !ended) else { return Err(WITHOUT_MOTOR_IO.to_owned()) };
    let age_s = now_ns.saturating_sub(authority.header.stamp_ns) as f64 * 1e-9;
    if age_s > SILENT_S {
        return Err(format!("no message from motor-io for {age_s:.0} s"));
    }
    Ok(authority)
}

fn mission(plan: &PlanStatus, steered: Result<&MotorAuthority, String>, value: &mut Value, lines: &mut Vec<String>) {
    let was = is_active(plan) && steered.is_err();
    let state = format!("{}{}", if was { "was " } else { "" }, sentences::mission_state(plan.state));
    value["mission"] = json!({
        "state": state, "name": text_of(&plan.mission), "leg": plan.leg, "legs": plan.legs,
        "progress": plan.progress, "time_left_s": (!was).then_some(plan.time_left_s), "reason": text_of(&plan.reason),
        "reason_code": plan.reason_code,
    });
    lines.push(format!("mission    {}", steered_words(plan, steered)));
}

/// Returns whether the planner has a mission that is not finished.
fn is_active(plan: &PlanStatus) -> bool {
    matches!(plan.state, PlanStatus::STATE_READY | PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED)
}

/// Returns the state of the mission on one text line; `authority` is the newest sample of a running motor-io.
pub(crate) fn mission_words(plan: &PlanStatus, authority: Option<&MotorAuthority>) -> String {
    steered_words(plan, authority.ok_or_else(|| WITHOUT_MOTOR_IO.to_owned()))
}

/// As [`mission_words`], with the reason why the motors are not controlled: without motor-io no mission runs, even if
/// the planner still reports one.
fn steered_words(plan: &PlanStatus, steered: Result<&MotorAuthority, String>) -> String {
    let (name, reason) = (text_of(&plan.mission), text_of(&plan.reason));
    let slows = steered.as_ref().is_ok_and(|authority| {
        let moves = matches!(authority.mode, MotorAuthority::MODE_FOLLOWING | MotorAuthority::MODE_STOPPING);
        moves && authority.plan_rate_target == 0.0
    });
    let without = steered.err().filter(|_| is_active(plan));
    let mut line = match plan.state {
        PlanStatus::STATE_RUNNING if slows => "slowing down".to_owned(),
        state if without.is_some() => format!("was {}", sentences::mission_state(state)),
        state => sentences::mission_state(state).to_owned(),
    };
    if !name.is_empty() {
        line += &format!(": {name}");
    }
    if matches!(plan.state, PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED) {
        line += &format!(", leg {} of {}, {:.0} %", plan.leg, plan.legs, 100.0 * plan.progress);
        if without.is_none() {
            line += &format!(", {:.0} s left", plan.time_left_s);
        }
    }
    if let Some(without) = without {
        line += &format!("; {without}, so the robot does not move");
    }
    if !reason.is_empty() {
        line += &format!("; {reason}");
    }
    line
}

/// Returns whether the recorder records, with the reason if it does not.
pub(crate) fn recording_words(row: &RecorderStatus, now_ns: u64) -> String {
    let age_s = now_ns.saturating_sub(row.header.stamp_ns) as f64 * 1e-9;
    match client::unrecorded_of(row) {
        _ if age_s > OLD_S => format!("NOT RECORDING: no message from the recorder for {age_s:.0} s"),
        Some(why) => format!("NOT RECORDING: {why}"),
        None => "recording".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_words_for_a_restored_position_name_the_start_of_motor_io() {
        let row = ProcessState { started_ns: 5_000_000_000, restarts: 2, ..ProcessState::default() };
        let before = MotorState::POSITION_RESTORED;
        let words = position_words(before, Some(&row), 17_000_000_000);
        assert!(words.contains("12 s") && words.contains("restart 2"), "{words}");
        assert!(!position_words(MotorState::POSITION_KNOWN, Some(&row), 17_000_000_000).contains("restart"));
    }

    /// The supervisor publishes the rows of so many processes again and again, in ten parts each second.
    fn published(processes: u64, until_ns: u64) -> Vec<ProcessState> {
        let parts = (0..).map(|part| (part, part * 100_000_000)).take_while(|(_, at_ns)| *at_ns < until_ns);
        let rows = parts.flat_map(|(part, at_ns)| {
            let of_part = (0..processes).filter(move |process| process % 10 == part % 10);
            of_part.map(move |process| (process, at_ns))
        });
        let row = |(process, at_ns)| {
            let mut row = ProcessState { state: ProcessState::STATE_READY, ..ProcessState::default() };
            messages::put_text(&mut row.name, &format!("sensor-{process}"));
            row.header.stamp_ns = at_ns;
            row
        };
        rows.map(row).collect()
    }

    #[test]
    fn all_processes_are_shown_also_if_there_are_more_than_a_subscriber_receives_at_first() {
        const SECOND_NS: u64 = 1_000_000_000;
        let at_first = messages::quality_of(TABLE).late;
        assert!(!Processes::default().are_whole(9 * SECOND_NS), "without a supervisor");
        for (processes, waits) in [(3, false), (300, false), (500, true), (4096, true)] {
            let joined_ns = 10 * SECOND_NS;
            let before = published(processes, joined_ns);
            let mut table = Processes::default();
            before[before.len().saturating_sub(at_first)..].iter().for_each(|row| table.record(*row));
            assert_eq!(!table.are_whole(joined_ns), waits, "{processes}");
            let mut later = published(processes, 2 * joined_ns).into_iter().skip(before.len());
            let mut now_ns = joined_ns;
            while !table.are_whole(now_ns) {
                let row = later.next().unwrap();
                now_ns = row.header.stamp_ns;
                table.record(row);
            }
            assert!(now_ns - joined_ns <= TABLE_NS, "{processes}");
            assert_eq!(table.rows.len() as u64, processes);
        }
        // A robot that has just started has not published more.
        let mut table = Processes::default();
        published(5, 500_000_000).into_iter().for_each(|row| table.record(row));
        assert!(table.are_whole(500_000_000));
    }

    #[test]
    fn a_mission_is_not_paused_while_the_robot_moves() {
        let plan = PlanStatus { state: PlanStatus::STATE_RUNNING, ..PlanStatus::default() };
        let mut authority = MotorAuthority { mode: MotorAuthority::MODE_FOLLOWING, ..MotorAuthority::default() };
        assert!(mission_words(&plan, Some(&authority)).starts_with("slowing down"));
        authority.plan_rate_target = 1.0;
        assert!(mission_words(&plan, Some(&authority)).starts_with("running"));
    }

    #[test]
    fn no_mission_runs_without_motor_io() {
        let second_ns = 1_000_000_000;
        let mut plan = PlanStatus { state: PlanStatus::STATE_RUNNING, time_left_s: 14.0, ..PlanStatus::default() };
        let mut authority = MotorAuthority { mode: MotorAuthority::MODE_FOLLOWING, ..MotorAuthority::default() };
        (authority.header.stamp_ns, authority.plan_rate_target) = (10 * second_ns, 1.0);
        let died = ProcessState { state: ProcessState::STATE_DIED, ..ProcessState::default() };
        let (row, now_ns) = (Some(&died), 10 * second_ns);
        assert!(steering(Some(&authority), None, now_ns).is_ok());
        // Other words than those of a mission that runs.
        let words = mission_words(&plan, None);
        assert_ne!(words, mission_words(&plan, Some(&authority)));
        for (steered, why) in [
            (steering(None, None, now_ns), WITHOUT_MOTOR_IO),
            (steering(Some(&authority), row, now_ns), WITHOUT_MOTOR_IO),
            (steering(Some(&authority), None, 14 * second_ns), " 4 s"),
        ] {
            let (mut value, mut lines) = (json!({}), Vec::new());
            mission(&plan, steered, &mut value, &mut lines);
            let line = &lines[0];
            let state = value["mission"]["state"].as_str().unwrap();
            assert_eq!(state, "was running");
            assert!(line.contains(state) && line.contains(why) && !line.contains("14 s"), "{line}");
            assert!(words.starts_with(state), "{words}");
            assert!(value["mission"]["time_left_s"].is_null(), "{value}");
        }
        plan.state = PlanStatus::STATE_DONE;
        assert_eq!(mission_words(&plan, None), "done");
    }

    #[test]
    fn the_words_for_a_recorder_that_does_not_record_contain_the_reason() {
        let mut row = RecorderStatus { state: RecorderStatus::STATE_FAILED, ..RecorderStatus::default() };
        messages::put_text(&mut row.reason, "the folder was removed");
        assert!(recording_words(&row, 0).ends_with(&text_of(&row.reason)));
        row.state = RecorderStatus::STATE_RECORDING;
        assert_eq!(recording_words(&row, 0), "recording");
        assert!(recording_words(&row, 9_000_000_000).contains("for 9 s"), "the last status is stale");
    }
}
