//! `nims status`: the robot and its processes at one glance.

use crate::failure::Answer;
use crate::live::Running;
use crate::processes::state_name;
use bus::{Bus, Subscriber, clock};
use messages::{
    ControlStatus, Message, MotorAuthority, MotorSlots, MotorState, NodeEstimate, PlanStatus, ProcessState,
    RecorderStatus, SLOT_NAMES, SLOTS, text_of,
};
use motor_io::sentences;
use serde_json::{Value, json};
use std::collections::BTreeMap;

pub use motor_io::sentences::mode_name;

/// The slowest rows come once a second; a stall of the machine may come between.
const PATIENCE_NS: u64 = 1_500_000_000;
const LOOK_NS: u64 = 20_000_000;
/// A cycle without readings has no estimate: where the position is known, the next ones are worth waiting for.
const ESTIMATE_NS: u64 = 300_000_000;

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
pub fn status(bus: &Bus) -> Answer<(Value, String)> {
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
        value["box"] = json!(running.box_file);
        lines.push(format!("run        {}", running.run.display()));
    }
    match &authority.sample {
        Some(authority) => motors(authority, &mut value, &mut lines),
        None => lines.push("motor-io   says nothing: it does not run; nothing can move".to_owned()),
    }
    if let Some(sample) = &seats.sample {
        slots(sample, &mut value, &mut lines);
    }
    if let Some(state) = &state.sample {
        let cables = usize::from(state.cable_count).min(state.length_m.len());
        value["lengths_m"] = json!(state.length_m[..cables]);
        value["currents_a"] = json!(state.current_a[..cables]);
    }
    let [one, other] = &estimates;
    let estimate = messages::blended_estimate(authority.sample.as_ref(), [one.sample.as_ref(), other.sample.as_ref()]);
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
        mission(plan, &mut value, &mut lines);
    }
    if let Some(recorder) = &recorder.sample {
        let recording = recording_words(recorder.state);
        value["recorder"] = json!({ "state": recording, "messages": recorder.total_messages, "bytes": recorder.total_bytes, "lost": recorder.lost });
        let megabytes = recorder.total_bytes as f64 * 1e-6;
        lines.push(format!("recorder   {recording}, {} messages, {megabytes:.1} MB", recorder.total_messages));
    }
    value["processes"] = processes.iter().map(|(name, row)| json!({ "name": name, "pid": row.pid, "state": state_name(row.state), "restarts": row.restarts })).collect();
    let listed: Vec<String> = processes.iter().map(|(name, row)| format!("{name} {}", state_name(row.state))).collect();
    lines
        .push(format!("processes  {}", if listed.is_empty() { "no supervisor".to_owned() } else { listed.join(", ") }));
    Ok((value, lines.join("\n")))
}

fn motors(authority: &MotorAuthority, value: &mut Value, lines: &mut Vec<String>) {
    let faults = sentences::faults_of(authority);
    value["mode"] = json!(mode_name(authority.mode));
    value["faults"] = json!(faults);
    value["position"] = json!(sentences::position_sentence(authority.position_known));
    value["plan_rate"] = json!(authority.plan_rate);
    value["cycle"] = json!({
        "number": authority.header.cycle, "period_s": authority.period_s, "missed": authority.missed, "late": authority.late,
        "skipped": authority.skipped, "bus_ns": authority.bus_ns, "command_age_ns": authority.command_age_ns,
    });
    lines.push(format!("mode       {}: {}", mode_name(authority.mode), sentences::mode_sentence(authority.mode)));
    lines.extend(faults.iter().map(|fault| format!("fault      {fault}")));
    lines.push(format!("position   {}", sentences::position_sentence(authority.position_known)));
    lines.push(format!(
        "cycle      {} at {:.0} Hz; {} missed, {} late, {} skipped",
        authority.header.cycle,
        1.0 / authority.period_s,
        authority.missed,
        authority.late,
        authority.skipped
    ));
}

/// Who is in charge, and who stands by.
fn slots(slots: &MotorSlots, value: &mut Value, lines: &mut Vec<String>) {
    for (role, who) in sentences::ROLE_NAMES.iter().enumerate() {
        let seats = SLOT_NAMES.iter().enumerate().map(|(slot, name)| {
            let seat = SLOTS * role + slot;
            let (phase, cause) = (slots.phase[seat], sentences::cause_phrase(role, slots.cause[seat]));
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

fn mission(plan: &PlanStatus, value: &mut Value, lines: &mut Vec<String>) {
    value["mission"] = json!({
        "state": mission_state(plan.state), "name": text_of(&plan.mission), "leg": plan.leg, "legs": plan.legs, "progress": plan.progress,
        "time_left_s": plan.time_left_s, "reason": text_of(&plan.reason),
    });
    lines.push(format!("mission    {}", mission_words(plan)));
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

/// What the planner does, on one line.
pub(crate) fn mission_words(plan: &PlanStatus) -> String {
    let (name, reason) = (text_of(&plan.mission), text_of(&plan.reason));
    let mut line = mission_state(plan.state).to_owned();
    if !name.is_empty() {
        line += &format!(": {name}");
    }
    if matches!(plan.state, PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED) {
        line += &format!(
            ", leg {} of {}, {:.0} %, {:.0} s left",
            plan.leg,
            plan.legs,
            100.0 * plan.progress,
            plan.time_left_s
        );
    }
    if !reason.is_empty() {
        line += &format!("; {reason}");
    }
    line
}

/// What the recorder does, in a word or two.
pub(crate) fn recording_words(state: u8) -> &'static str {
    match state {
        RecorderStatus::STATE_RECORDING => "recording",
        RecorderStatus::STATE_DISK_FULL => "NOT RECORDING: the disk is full",
        _ => "NOT RECORDING: it failed",
    }
}
