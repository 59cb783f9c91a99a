//! `nims status`: the robot and its processes at one glance.

use bus::{Bus, Memory, Subscriber, clock};
use client::{Running, state_name};
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

/// The slowest rows come once a second; a stall of the machine may come between.
const PATIENCE_NS: u64 = 1_500_000_000;
const LOOK_NS: u64 = 20_000_000;
/// The recorder speaks once a second; what is older than this is not the present any more, s.
const OLD_S: f64 = 2.5;
/// motor-io that has not been heard for this long steers nothing, s: a shared machine stands still for up to 0.25 s.
const SILENT_S: f64 = 1.0;
/// A cycle without readings has no estimate: where the position is known, the next ones are worth waiting for.
const ESTIMATE_NS: u64 = 300_000_000;
/// What a process has said before is given to a late listener with its next heartbeat, five times a second.
const LOG_NS: u64 = 500_000_000;

/// Why no mission runs.
const WITHOUT_MOTOR_IO: &str = "motor-io does not run";

/// Below this much free shared memory a process may not find room, bytes.
const SCARCE_BYTES: u64 = 8 << 20;

/// Newest sample of a channel.
struct Newest<T: Message> {
    subscriber: Subscriber<T>,
    sample: Option<T>,
}

impl<T: Message> Newest<T> {
    fn of(bus: &Bus, channel: &str) -> Answer<Self> {
        Ok(Self { subscriber: bus.subscriber(channel)?, sample: None })
    }

    fn look(&mut self) -> Answer<bool> {
        if let Some(sample) = self.subscriber.latest()? {
            self.sample = Some(sample);
        }
        Ok(self.sample.is_some())
    }
}

/// The state of the robot as JSON and as words.
///
/// # Errors
/// Shared memory cannot be read.
pub fn status(bus: &Bus) -> Answer<Output> {
    let mut authority = Newest::<MotorAuthority>::of(bus, "motor/authority")?;
    let mut state = Newest::<MotorState>::of(bus, "motor/state")?;
    let [a, b] = SLOT_NAMES;
    let estimates = [a, b].map(|slot| Newest::<NodeEstimate>::of(bus, &format!("node/estimate/{slot}")));
    let controls = [a, b].map(|slot| Newest::<ControlStatus>::of(bus, &format!("control/status/{slot}")));
    let [estimate_a, estimate_b] = estimates;
    let mut estimates = [estimate_a?, estimate_b?];
    let [control_a, control_b] = controls;
    let mut controls = [control_a?, control_b?];
    let mut seats = Newest::<MotorSlots>::of(bus, "motor/slots")?;
    let mut plan = Newest::<PlanStatus>::of(bus, "plan/status")?;
    let mut recorder = Newest::<RecorderStatus>::of(bus, "recorder/status")?;
    let mut set = Newest::<SystemConfig>::of(bus, TUNED_CHANNEL)?;
    let mut table = bus.subscriber::<ProcessState>("system/process")?;
    let mut processes: BTreeMap<String, ProcessState> = BTreeMap::new();

    let begun = clock::now_ns();
    loop {
        while let Some(row) = table.receive()? {
            if row.state == ProcessState::STATE_GONE {
                processes.remove(&text_of(&row.name));
            } else {
                processes.insert(text_of(&row.name), row);
            }
        }
        let have = [
            authority.look()?,
            state.look()?,
            // One of the two slots will do.
            estimates[0].look()? | estimates[1].look()?,
            controls[0].look()? | controls[1].look()?,
            seats.look()?,
            plan.look()?,
            recorder.look()?,
            set.look()?,
            !processes.is_empty(),
        ];
        let known = state.sample.is_some_and(|state| state.position_known == MotorState::POSITION_KNOWN);
        let passed = clock::now_ns() - begun;
        let settled = !known
            || passed >= ESTIMATE_NS
            || estimates.iter().any(|one| one.sample.is_some_and(|estimate| estimate.valid == 1));
        if (have.iter().all(|have| *have) && settled) || passed >= PATIENCE_NS {
            break;
        }
        clock::sleep_until(clock::now_ns() + LOOK_NS);
    }

    let mut value = json!({ "domain": bus.domain().name() });
    let mut lines = vec![format!("domain     {}", bus.domain().name())];
    if let Some(running) = Running::of(bus.domain()) {
        value["run"] = json!(running.run);
        value["box"] = json!(running.system_file);
        lines.push(format!("run        {}", running.run.display()));
    }
    if let Some(set) = set.sample.filter(|set| set.changes > 0) {
        let set = text_of(&set.parameters);
        value["set"] = json!(set.lines().collect::<Vec<_>>());
        lines.push(format!("set        {}", set.lines().collect::<Vec<_>>().join(", ")));
    }
    match &authority.sample {
        Some(authority) => {
            motors(authority, processes.get("motor-io"), &mut value, &mut lines);
            if authority.faults & MotorAuthority::FAULT_LOST_UNIT != 0
                && let Some(said) = of_ports(bus)?
            {
                lines.push(format!("drives     {said}"));
                value["drives"] = json!(said);
            }
        }
        None => lines.push("motor-io   says nothing: it does not run; nothing can move".to_owned()),
    }
    if let Some(sample) = &seats.sample {
        slots(sample, &processes, &mut value, &mut lines);
    }
    if let Some(state) = &state.sample {
        let cables = usize::from(state.cable_count).min(state.length_m.len());
        value["lengths_m"] = json!(state.length_m[..cables]);
        value["currents_a"] = json!(state.current_a[..cables]);
    }
    let [one, other] = &estimates;
    let estimate =
        blended_estimate(authority.sample.as_ref(), [one.sample.as_ref(), other.sample.as_ref()], Rule::History);
    if let Some(estimate) = estimate.filter(|estimate| estimate.valid == 1) {
        let cables = usize::from(estimate.cable_count).min(estimate.tension_n.len());
        let [x, y, z] = estimate.position_m;
        let tensions = &estimate.tension_n[..cables];
        value["position_m"] = json!(estimate.position_m);
        value["tensions_n"] = json!(tensions);
        let listed: Vec<String> = tensions.iter().map(|tension| format!("{tension:.1}")).collect();
        lines.push(format!("node       at {x:.3}, {y:.3}, {z:.3} m; lines carry {} N", listed.join(", ")));
    } else {
        lines.push("node       position not estimated".to_owned());
    }
    let leading = authority.sample.as_ref().map_or(0, |authority| usize::from(authority.active_controller).min(1));
    if let Some(control) = controls[leading].sample.filter(|control| control.valid == 1 && control.segment != 0) {
        value["tracking_error_m"] = json!(control.error_norm_m);
    }
    if let Some(plan) = &plan.sample {
        let heard = authority.sample.as_ref();
        let steered = steering(heard, processes.get("motor-io"), clock::now_ns());
        mission(plan, steered, &mut value, &mut lines);
    }
    if let Some(recorder) = &recorder.sample {
        let recording = recording_words(recorder, clock::now_ns());
        value["recorder"] = json!({ "state": recording, "messages": recorder.total_messages, "bytes": recorder.total_bytes, "lost": recorder.lost });
        let megabytes = recorder.total_bytes as f64 * 1e-6;
        lines.push(format!("recorder   {recording}, {} messages, {megabytes:.1} MB", recorder.total_messages));
    }
    let memory = bus.domain().memory();
    value["shared_memory"] =
        json!({ "used_bytes": memory.used, "free_bytes": memory.free, "total_bytes": memory.total });
    lines.push(format!("memory     {}", memory_words(&memory)));
    value["processes"] = processes.iter().map(|(name, row)| json!({ "name": name, "pid": row.pid, "state": state_name(row.state), "restarts": row.restarts })).collect();
    let listed: Vec<String> = processes.iter().map(|(name, row)| format!("{name} {}", state_name(row.state))).collect();
    lines
        .push(format!("processes  {}", if listed.is_empty() { "no supervisor".to_owned() } else { listed.join(", ") }));
    Ok(Output::new(value, lines.join("\n")))
}

/// Shared memory, on one line; with a warning while there is still room for what the warning asks for.
fn memory_words(memory: &Memory) -> String {
    let megabytes = |bytes: u64| format!("{:.1} MB", bytes as f64 * 1e-6);
    let used = format!("{} of shared memory used by this robot", megabytes(memory.used));
    match (memory.total, memory.free) {
        (0, _) => used,
        (total, free) if free < SCARCE_BYTES => format!(
            "{used}, ONLY {} of {} free: no sensor can be plugged in and no process started until /dev/shm has room again",
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
    let periods = Periods::of(authority);
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
        periods.words()
    ));
}

/// What motor-io said last of one of its serial ports: which, and what comes from there.
fn of_ports(bus: &Bus) -> Answer<Option<String>> {
    let Ok(file) = client::box_of(bus) else { return Ok(None) };
    let root = bus.domain().root().to_string_lossy().into_owned();
    let ports: Vec<String> = file.motor_io.ports.iter().map(|port| port.path.replace("{domain}", &root)).collect();
    let mut log = bus.subscriber::<LogEvent>("system/log/motor-io")?;
    let (mut said, give_up) = (None, clock::now_ns() + LOG_NS);
    while clock::now_ns() < give_up {
        while let Some(event) = log.receive()? {
            let text = text_of(&event.text);
            if event.level >= LogEvent::LEVEL_WARN && ports.iter().any(|port| text.starts_with(port)) {
                said = Some(text);
            }
        }
        clock::sleep_until(clock::now_ns() + LOOK_NS);
    }
    Ok(said)
}

/// How far the position can be trusted; of one from before a start, when that was, by motor-io's row of the process table.
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

/// Who is in charge, and who stands by.
fn slots(slots: &MotorSlots, processes: &BTreeMap<String, ProcessState>, value: &mut Value, lines: &mut Vec<String>) {
    for (role, who) in sentences::ROLE_NAMES.iter().enumerate() {
        let seats = SLOT_NAMES.iter().enumerate().map(|(slot, name)| {
            let seat = SLOTS * role + slot;
            let (phase, cause) = (slots.phase[seat], sentences::cause_phrase(role, slots.cause[seat]));
            // One that was asked to end has not failed.
            let ended = processes.values().any(|row| {
                row.state == ProcessState::STATE_STOPPED
                    && text_of(&row.role) == *who
                    && usize::from(row.slot) == slot + 1
            });
            let cause = if ended && phase == MotorSlots::PHASE_EMPTY { "" } else { cause };
            (*name, sentences::phase_name(phase), cause, phase != MotorSlots::PHASE_EMPTY)
        });
        let listed: Vec<String> = seats
            .clone()
            .filter(|(.., cause, there)| *there || !cause.is_empty())
            .map(|(name, phase, cause, _)| match cause {
                "" => format!("{name} {phase}"),
                cause => format!("{name} {phase} (it {cause})"),
            })
            .collect();
        value[*who] =
            seats.map(|(name, phase, cause, _)| json!({ "slot": name, "phase": phase, "cause": cause })).collect();
        if !listed.is_empty() {
            lines.push(format!("{who:<10} {}", listed.join(", ")));
        }
    }
}

/// What a motor-io says that steers at present; otherwise why none does. Its last sample may outlive it.
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
        return Err(format!("motor-io has said nothing for {age_s:.0} s"));
    }
    Ok(authority)
}

fn mission(plan: &PlanStatus, steered: Result<&MotorAuthority, String>, value: &mut Value, lines: &mut Vec<String>) {
    let was = is_on(plan) && steered.is_err();
    let state = format!("{}{}", if was { "was " } else { "" }, mission_state(plan.state));
    value["mission"] = json!({
        "state": state, "name": text_of(&plan.mission), "leg": plan.leg, "legs": plan.legs,
        "progress": plan.progress, "time_left_s": (!was).then_some(plan.time_left_s), "reason": text_of(&plan.reason),
    });
    lines.push(format!("mission    {}", steered_words(plan, steered)));
}

/// Whether the planner has a mission under way.
fn is_on(plan: &PlanStatus) -> bool {
    matches!(plan.state, PlanStatus::STATE_READY | PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED)
}

fn mission_state(state: u8) -> &'static str {
    match state {
        PlanStatus::STATE_IDLE => "idle",
        PlanStatus::STATE_READY => "ready",
        PlanStatus::STATE_RUNNING => "running",
        PlanStatus::STATE_PAUSED => "paused",
        PlanStatus::STATE_DONE => "done",
        PlanStatus::STATE_ABORTED => "aborted",
        _ => "refused",
    }
}

/// What the planner does, on one line; `authority` is what a motor-io says that runs.
pub(crate) fn mission_words(plan: &PlanStatus, authority: Option<&MotorAuthority>) -> String {
    steered_words(plan, authority.ok_or_else(|| WITHOUT_MOTOR_IO.to_owned()))
}

/// The same, or why nothing steers: without motor-io no mission runs, whatever the planner says.
fn steered_words(plan: &PlanStatus, steered: Result<&MotorAuthority, String>) -> String {
    let (name, reason) = (text_of(&plan.mission), text_of(&plan.reason));
    let slows = steered.as_ref().is_ok_and(|authority| {
        let moves = matches!(authority.mode, MotorAuthority::MODE_FOLLOWING | MotorAuthority::MODE_STOPPING);
        moves && authority.plan_rate_target == 0.0
    });
    let without = steered.err().filter(|_| is_on(plan));
    let mut line = match plan.state {
        PlanStatus::STATE_RUNNING if slows => "slowing down".to_owned(),
        state if without.is_some() => format!("was {}", mission_state(state)),
        state => mission_state(state).to_owned(),
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
        line += &format!("; {without}, so nothing moves");
    }
    if !reason.is_empty() {
        line += &format!("; {reason}");
    }
    line
}

/// What the recorder does, in a word or two; why, where it does not record.
pub(crate) fn recording_words(row: &RecorderStatus, now_ns: u64) -> String {
    let age_s = now_ns.saturating_sub(row.header.stamp_ns) as f64 * 1e-9;
    match client::unrecorded_of(row) {
        _ if age_s > OLD_S => format!("NOT RECORDING: the recorder has said nothing for {age_s:.0} s"),
        Some(why) => format!("NOT RECORDING: {why}"),
        None => "recording".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_from_before_a_start_names_that_start() {
        let row = ProcessState { started_ns: 5_000_000_000, restarts: 2, ..ProcessState::default() };
        let before = MotorState::POSITION_RESTORED;
        let words = position_words(before, Some(&row), 17_000_000_000);
        assert!(words.contains("12 s ago, restart 2 of this run"), "{words}");
        assert!(!position_words(MotorState::POSITION_KNOWN, Some(&row), 17_000_000_000).contains("restart"));
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
        for (steered, why) in [
            (steering(None, None, now_ns), "motor-io does not run"),
            (steering(Some(&authority), row, now_ns), "motor-io does not run"),
            (steering(Some(&authority), None, 14 * second_ns), "motor-io has said nothing for 4 s"),
        ] {
            let (mut value, mut lines) = (json!({}), Vec::new());
            mission(&plan, steered, &mut value, &mut lines);
            let line = &lines[0];
            assert!(line.contains("was running") && line.contains(why) && !line.contains("left"), "{line}");
            assert_eq!(value["mission"]["state"], "was running");
            assert!(value["mission"]["time_left_s"].is_null(), "{value}");
        }
        assert!(mission_words(&plan, None).starts_with("was running"));
        plan.state = PlanStatus::STATE_DONE;
        assert_eq!(mission_words(&plan, None), "done");
    }

    #[test]
    fn a_recorder_says_why_it_does_not_record() {
        let mut row = RecorderStatus { state: RecorderStatus::STATE_FAILED, ..RecorderStatus::default() };
        messages::put_text(&mut row.reason, "the folder was removed");
        assert!(recording_words(&row, 0).ends_with("the folder was removed"));
        row.state = RecorderStatus::STATE_RECORDING;
        assert_eq!(recording_words(&row, 0), "recording");
        assert!(recording_words(&row, 9_000_000_000).contains("nothing for 9 s"), "it hangs, whatever it said before");
    }
}
