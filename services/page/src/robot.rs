//! What the page knows of the robot: the newest samples in, plain data for browsers out. No clock, no I/O.

use crate::drives::Units;
use crate::freshness::{self, Missed, since_s};
use cable_robot::Path;
use messages::{
    Heartbeat, LogEvent, Message, MotorAuthority, MotorSlots, MotorState, NodeEstimate, OperatorRequest, PlanMotion,
    PlanSegment, PlanStatus, ProcessState, RecorderStatus, RequestBody, Rule, SLOT_NAMES, SLOTS, blended_estimate,
    text_of,
};
use robot_state::{Periods, sentences};
use serde_json::{Value, json};
use site_calibration::setup::captured::{Moving, UpAndDown, moving};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// The channels and the largest number of samples per second of each; `None`: every sample, because each is a row or an
/// event.
pub(crate) const CHANNELS: [(&str, Option<f64>); 11] = [
    ("motor/authority", Some(20.0)),
    ("motor/state", Some(20.0)),
    ("node/estimate/a", Some(20.0)),
    ("node/estimate/b", Some(20.0)),
    ("motor/slots", Some(2.0)),
    ("plan/status", Some(5.0)),
    ("plan/motion", Some(5.0)),
    ("recorder/status", Some(1.0)),
    ("system/process", None),
    (VERSION_OF, Some(1.0)),
    ("operator/request", None),
];
/// The heartbeat that states the version of the robot's programs.
const VERSION_OF: &str = "system/heartbeat/motor-io";
/// Name of the process that records.
const RECORDER: &str = "recorder";
/// Beginning of the names of the channels with the logs of processes.
pub(crate) const LOGS: &str = "system/log/";
/// Time for which a valid estimate is shown while newer ones are not valid, s.
const SHOWN_S: f64 = 0.5;
/// Time without an estimate after the first message of motor-io, after which it is not only late, s.
const FIRST_S: f64 = 5.0;
/// Time by which the newest status of the planner is older than that of motor-io, after which it tells nothing of the
/// present, s. It is received five times per second.
const SILENT_S: f64 = 1.0;
/// Samples of motions that are kept for the weighing of the node: five minutes of them.
const MOVING: usize = 6000;
/// Points along a drawn segment.
const POINTS: usize = 48;

/// The newest samples of a robot.
#[derive(Debug, Default)]
pub(crate) struct Robot {
    authority: Option<MotorAuthority>,
    /// When the first one was published, ns.
    first_ns: Option<u64>,
    state: Option<MotorState>,
    estimates: [Option<NodeEstimate>; SLOTS],
    /// The last valid one in charge: a cycle without readings has none.
    valid: Option<NodeEstimate>,
    slots: Option<MotorSlots>,
    plan: Option<PlanStatus>,
    motion: Option<PlanMotion>,
    recorder: Option<RecorderStatus>,
    /// State of the recorder's process.
    recorder_process: Option<u8>,
    missed: Missed,
    units: Units,
    /// The last samples in motion, with their times, ns.
    moving: VecDeque<(u64, Moving)>,
    processes: BTreeMap<String, ProcessState>,
    flyer: Option<OperatorRequest>,
    /// When another program than this page stopped the robot last, ns.
    stopped_ns: u64,
    version: Option<String>,
    /// Channels whose samples this program does not know.
    foreign: BTreeSet<String>,
    /// Sensors that publish.
    pub(crate) sensors: Vec<String>,
}

/// Something that happened once.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Happened(pub(crate) Value);

impl Robot {
    /// Notes the type of the samples of a channel, by its definition.
    pub(crate) fn define(&mut self, channel: &str, type_name: &str, size: usize) {
        let known = |name: &str| name == type_name;
        let row = messages::channel_of(channel).and_then(|row| row.type_name);
        if row.is_some_and(|row| known(row())) && size > 0 {
            self.foreign.remove(channel);
        } else {
            self.foreign.insert(channel.to_owned());
        }
    }

    /// Takes a sample; returns what happened, if it is an event.
    pub(crate) fn take(&mut self, channel: &str, bytes: &[u8]) -> Option<Happened> {
        if self.foreign.contains(channel) {
            return None;
        }
        match channel {
            "motor/authority" => {
                self.authority = read(bytes).or(self.authority);
                self.authority.iter().for_each(|authority| self.missed.take(authority));
                self.first_ns = self.first_ns.or(self.authority.map(|authority| authority.header.stamp_ns));
            }
            "motor/state" => self.motors_are(read(bytes)?),
            "node/estimate/a" => self.estimates[0] = read(bytes).or(self.estimates[0]),
            "node/estimate/b" => self.estimates[1] = read(bytes).or(self.estimates[1]),
            "motor/slots" => {
                let before = self.slots;
                self.slots = read(bytes).or(before);
                return swapped(&before?, &self.slots?);
            }
            "plan/status" => self.plan = read(bytes).or(self.plan),
            "plan/motion" => self.motion = read(bytes).or(self.motion),
            "recorder/status" => self.recorder = read(bytes).or(self.recorder),
            VERSION_OF => self.version = read::<Heartbeat>(bytes).map(|beat| text_of(&beat.version)),
            "system/process" => self.row(&read(bytes)?),
            "operator/request" => return self.request(read(bytes)?),
            _ if channel.starts_with(LOGS) => return Some(logged(&read(bytes)?)),
            _ => {}
        }
        self.valid = self.estimate().or(self.valid);
        None
    }

    fn motors_are(&mut self, state: MotorState) {
        // Without a position the velocity is not known either.
        let velocity_m_s = &state.node_command_m_s;
        if velocity_m_s.iter().all(|m_s| m_s.is_finite()) && velocity_m_s.iter().any(|m_s| *m_s != 0.0) {
            self.moving.truncate(MOVING - 1);
            self.moving.push_front((state.header.stamp_ns, moving(&state)));
        }
        self.units.take(&state);
        self.state = Some(state);
    }

    /// The motion after an instant, ns.
    pub(crate) fn moved(&self, after_ns: u64) -> UpAndDown {
        let mut motion = UpAndDown::default();
        for (_, sample) in self.moving.iter().filter(|(stamp_ns, _)| *stamp_ns > after_ns) {
            motion.take(sample);
        }
        motion
    }

    fn row(&mut self, row: &ProcessState) {
        let name = text_of(&row.name);
        if name == RECORDER {
            self.recorder_process = Some(row.state);
        }
        if row.state == ProcessState::STATE_GONE {
            self.processes.remove(&name);
        } else {
            self.processes.insert(name, *row);
        }
    }

    fn request(&mut self, request: OperatorRequest) -> Option<Happened> {
        if request.answered == 0 {
            return None;
        }
        if request.accepted == OperatorRequest::ACCEPTED && flies(request.body.verb) {
            self.flyer = Some(request);
        }
        // The stops of this page, and the ends of what its browsers hold, pass through the gateway. It compares them.
        if request.accepted == OperatorRequest::ACCEPTED && request.body.is_stop() && request.pid != std::process::id()
        {
            self.stopped_ns = self.stopped_ns.max(request.header.stamp_ns);
        }
        let value = json!({
            "type": "request", "stamp_ns": request.header.stamp_ns, "who": text_of(&request.requester),
            "accepted": request.accepted == OperatorRequest::ACCEPTED, "reason": request.reason,
            "sentence": text_of(&request.answer),
        });
        Some(Happened(value))
    }

    /// The estimate that is shown, which is valid.
    fn shown(&self, now_ns: u64) -> Option<NodeEstimate> {
        let is_known = self.authority.is_some_and(|authority| authority.position_known != MotorState::POSITION_UNKNOWN);
        self.valid.filter(|estimate| is_known && since_s(estimate.header.stamp_ns, now_ns) < SHOWN_S)
    }

    /// The estimate in charge, if it is valid.
    fn estimate(&self) -> Option<NodeEstimate> {
        let [a, b] = &self.estimates;
        blended_estimate(self.authority.as_ref(), [a.as_ref(), b.as_ref()], Rule::History)
            .filter(|estimate| estimate.valid == 1)
    }

    /// When another program than this page stopped the robot last, ns; 0: none did.
    pub(crate) fn stopped_ns(&self) -> u64 {
        self.stopped_ns
    }

    /// Number that changes with every sample of the state that is sent at the full rate.
    pub(crate) fn cycle(&self) -> u64 {
        self.authority.map_or(0, |authority| authority.header.cycle)
    }

    /// The state that changes all the time.
    pub(crate) fn live(&self, now_ns: u64) -> Value {
        let mut value = json!({ "type": "state", "age_s": self.age_s(now_ns), "mode": null });
        if let Some(authority) = &self.authority {
            let periods = Periods::from_authority(authority);
            value["mode"] = json!(sentences::mode_name(authority.mode));
            value["mode_sentence"] = json!(sentences::mode_sentence(authority.mode));
            value["faults"] = json!(sentences::faults_of(authority));
            value["position"] = json!(sentences::position_sentence(authority.position_known));
            value["position_known"] = json!(authority.position_known);
            value["rate"] = json!(authority.plan_rate);
            value["rate_target"] = json!(authority.plan_rate_target);
            value["segment"] = json!(authority.segment);
            let (hz, summary) = (1.0 / authority.period_s, periods.summary());
            value["cycle"] = json!({ "number": authority.header.cycle, "hz": hz, "summary": summary,
                "unsteered": periods.unsteered(), "missed": self.missed.last_minute(now_ns), "all": periods.all() });
            // Without an estimate at the beginning it is not known yet whether the position is known.
            let is_late = self.first_ns.is_some_and(|first_ns| since_s(first_ns, now_ns) > FIRST_S);
            let is_unknown = authority.position_known == MotorState::POSITION_UNKNOWN;
            value["located"] = json!(is_unknown || is_late || self.estimates.iter().any(Option::is_some));
        }
        if let Some(state) = &self.state {
            let (cables, units) = (count(state.cable_count, state.length_m.len()), usize::from(state.unit_count));
            value["lengths_m"] = json!(state.length_m[..cables]);
            value["currents_a"] = json!(state.current_a[..cables]);
            let read = state.supply_v.iter().take(units).copied().filter(|volts| *volts > 0.0);
            let lowest = read.fold(f64::INFINITY, f64::min);
            value["supply_v"] = json!(lowest.is_finite().then_some(lowest));
        }
        if let Some(estimate) = self.shown(now_ns) {
            let cables = count(estimate.cable_count, estimate.tension_n.len());
            let two_sigma = estimate.two_sigma_m();
            value["position_m"] = json!(estimate.position_m);
            value["velocity_m_s"] = json!(estimate.velocity_m_s);
            value["two_sigma_m"] = json!(two_sigma);
            value["within_m"] = json!(two_sigma.iter().map(|m| m * m).sum::<f64>().sqrt());
            value["tensions_n"] = json!(estimate.tension_n[..cables]);
            value["slack"] = json!(estimate.slack[..cables]);
        }
        if let Some(plan) = &self.plan {
            let last = self.authority.map(|authority| since_s(plan.header.stamp_ns, authority.header.stamp_ns));
            value["mission"] = json!({
                "state": sentences::mission_state(plan.state), "name": text_of(&plan.mission), "leg": plan.leg,
                "legs": plan.legs, "progress": plan.progress, "time_left_s": plan.time_left_s,
                "reason": text_of(&plan.reason), "reason_code": plan.reason_code, "target_m": plan.target_m,
                "silent_s": last.filter(|silent_s| *silent_s > SILENT_S).map(f64::floor),
            });
        }
        value
    }

    /// The figures of the charts, rounded to what can be seen.
    pub(crate) fn figures(&self, now_ns: u64) -> Value {
        let rounded = |value: f64, step: f64| (value.is_finite()).then(|| (value / step).round() * step);
        let all = |values: &[f64], step: f64| -> Vec<Option<f64>> {
            // As short decimals: a sum of steps has a long tail.
            let short = |value: f64| format!("{value:.4}").parse().unwrap_or(value);
            values.iter().map(|value| rounded(*value, step).map(short)).collect()
        };
        let live = self.live(now_ns);
        let numbers = |key: &str| -> Vec<f64> {
            let values = live[key].as_array().map_or(&[][..], Vec::as_slice);
            values.iter().map(|value| value.as_f64().unwrap_or(f64::NAN)).collect()
        };
        let one = |key: &str, step: f64| all(&[live[key].as_f64().unwrap_or(f64::NAN)], step)[0];
        json!({ "mode": live["mode"], "position_m": all(&numbers("position_m"), 1e-3), "within_m": one("within_m", 1e-3),
            "tensions_n": all(&numbers("tensions_n"), 0.1), "currents_a": all(&numbers("currents_a"), 0.01),
            "supply_v": one("supply_v", 0.1) })
    }

    /// The newest sample of the motors.
    pub(crate) fn motors(&self) -> Option<&MotorState> {
        self.state.as_ref()
    }

    /// Time since motor-io published, s; `None`: it never did.
    pub(crate) fn age_s(&self, now_ns: u64) -> Option<f64> {
        self.authority.map(|authority| since_s(authority.header.stamp_ns, now_ns))
    }

    /// The state that changes rarely.
    pub(crate) fn slow(&self, now_ns: u64) -> Value {
        let processes: Vec<Value> = self
            .processes
            .iter()
            .map(|(name, row)| {
                json!({ "name": name, "state": client::state_name(row.state), "pid": row.pid,
                    "restarts": row.restarts, "role": text_of(&row.role), "reason": text_of(&row.reason),
                    "well": well(row.state) })
            })
            .collect();
        // Counted by what was received, so that a robot that is not received is not judged.
        let seen = self.first_ns.zip(self.authority).map(|(first_ns, last)| since_s(first_ns, last.header.stamp_ns));
        let recorder =
            freshness::recorder(self.recorder.as_ref(), self.recorder_process, seen.unwrap_or_default(), now_ns);
        let flyer = self.flyer.as_ref().map(
            |request| json!({ "name": holder(&text_of(&request.requester)), "ago_s": since_s(request.header.stamp_ns, now_ns) }),
        );
        json!({ "type": "robot", "processes": processes, "recorder": recorder, "flyer": flyer,
            "slots": self.slots.as_ref().map(slots), "units": self.state.as_ref().map(|state| self.units.told(state)), "sensors": self.sensors, "version": self.version,
            "unknown_channels": self.foreign })
    }

    /// What the drawn plan depends on.
    pub(crate) fn plan_key(&self) -> (u32, u32, u32) {
        self.motion.map_or((0, 0, 0), |motion| (motion.motion, motion.current.id, motion.next.id))
    }

    /// The plan as lines to draw.
    pub(crate) fn drawn_plan(&self) -> Value {
        let segments: Vec<Value> = self
            .motion
            .iter()
            .flat_map(|motion| [&motion.current, &motion.next])
            .filter_map(|message| Some((message, points(message)?)))
            .map(|(message, points)| json!({ "id": message.id, "points_m": points }))
            .collect();
        json!({ "type": "plan", "segments": segments })
    }
}

/// Another controller or estimator is in charge.
fn swapped(before: &MotorSlots, now: &MotorSlots) -> Option<Happened> {
    let role = (0..now.in_charge.len()).find(|role| before.in_charge[*role] != now.in_charge[*role])?;
    let slot = SLOT_NAMES.get(usize::from(now.in_charge[role]))?;
    Some(Happened(
        json!({ "type": "swap", "stamp_ns": now.header.stamp_ns, "role": sentences::ROLE_NAMES[role], "slot": slot }),
    ))
}

/// The name of a requester without the address of the browser.
fn holder(requester: &str) -> &str {
    requester.split('@').next().unwrap_or(requester)
}

/// Requests of the person who flies: those that move the node or make it ready to move.
fn flies(verb: u8) -> bool {
    matches!(
        verb,
        RequestBody::VERB_ARM
            | RequestBody::VERB_ZERO_AT
            | RequestBody::VERB_ZERO_LENGTHS
            | RequestBody::VERB_CONFIRM
            | RequestBody::VERB_JOG
            | RequestBody::VERB_SOFT
            | RequestBody::VERB_RESUME
            | RequestBody::VERB_SPEED
            | RequestBody::VERB_GOTO
            | RequestBody::VERB_RUN
    )
}

fn well(state: u8) -> bool {
    !matches!(state, ProcessState::STATE_DIED | ProcessState::STATE_SILENT | ProcessState::STATE_GAVE_UP)
}

fn slots(slots: &MotorSlots) -> Value {
    let of = |role: usize| -> Vec<Value> {
        let state = |slot: usize| {
            let index = SLOTS * role + slot;
            let deviation = slots.deviation[index];
            json!({ "slot": SLOT_NAMES[slot], "phase": sentences::phase_name(slots.phase[index]),
                "good_cycles": slots.good_cycles[index], "qualify_cycles": slots.qualify_cycles,
                "deviation": (deviation >= 0.0).then_some(deviation), "failures": slots.failures[index],
                "cause": sentences::cause_phrase(role, slots.cause[index]),
                "in_charge": usize::from(slots.in_charge[role]) == slot })
        };
        (0..SLOTS).map(state).collect()
    };
    let roles = sentences::ROLE_NAMES.iter().enumerate();
    roles.map(|(role, name)| ((*name).to_owned(), Value::from(of(role)))).collect::<serde_json::Map<_, _>>().into()
}

fn logged(event: &LogEvent) -> Happened {
    let level = match event.level {
        LogEvent::LEVEL_ERROR => "error",
        LogEvent::LEVEL_WARN => "warning",
        _ => "info",
    };
    Happened(json!({ "type": "log", "stamp_ns": event.header.stamp_ns, "process": text_of(&event.process),
        "level": level, "sentence": text_of(&event.text) }))
}

/// Points along a segment, m; `None` if there is none.
fn points(message: &PlanSegment) -> Option<Vec<[f64; 3]>> {
    let segment = segments::segment_of(message)?;
    if matches!(segment.path, Path::Dwell(_)) {
        return None;
    }
    let (length, count) = (segment.path.length(), if segment.path.is_straight() { 1 } else { POINTS });
    Some((0..=count).map(|i| segment.path.point(length * i as f64 / count as f64).into()).collect())
}

fn count(given: u8, most: usize) -> usize {
    usize::from(given).min(most)
}

fn read<T: Message>(bytes: &[u8]) -> Option<T> {
    bytemuck::try_pod_read_unaligned(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Header, put_text};

    fn taken(robot: &mut Robot, channel: &str, sample: &impl Message) -> Option<Happened> {
        robot.take(channel, bytemuck::bytes_of(sample))
    }

    #[test]
    fn the_state_has_the_words_of_the_command_line_and_its_age() {
        let mut robot = Robot::default();
        assert_eq!(robot.live(0)["mode"], Value::Null);
        let header = Header { stamp_ns: 1_000_000_000, ..Header::default() };
        let authority = MotorAuthority {
            header,
            mode: MotorAuthority::MODE_FAULTED,
            faults: MotorAuthority::FAULT_SUPPLY,
            period_s: 0.01,
            ..MotorAuthority::default()
        };
        taken(&mut robot, "motor/authority", &authority);
        let state = robot.live(3_500_000_000);
        assert_eq!((&state["mode"], &state["age_s"]), (&json!("faulted"), &json!(2.5)));
        assert_eq!(state["faults"], json!(sentences::faults_of(&authority)));
    }

    #[test]
    fn what_is_not_received_yet_is_told_from_what_is_not_known() {
        let mut robot = Robot::default();
        let mut known =
            MotorAuthority { position_known: MotorState::POSITION_KNOWN, period_s: 0.01, ..Default::default() };
        taken(&mut robot, "motor/authority", &known);
        // The position is known, and no estimate has come so far.
        let state = robot.live(0);
        assert_eq!((&state["located"], &state["within_m"]), (&json!(false), &Value::Null));
        // An estimate that does not come is no longer late.
        assert_eq!(robot.live(4_000_000_000)["located"], false);
        assert_eq!(robot.live(6_000_000_000)["located"], true);
        known.position_known = MotorState::POSITION_UNKNOWN;
        taken(&mut robot, "motor/authority", &known);
        assert_eq!(robot.live(0)["located"], true);
        known.position_known = MotorState::POSITION_KNOWN;
        taken(&mut robot, "motor/authority", &known);
        taken(&mut robot, "node/estimate/a", &NodeEstimate::default());
        assert_eq!(robot.live(0)["located"], true);
        // Nothing was received of the recorder so far, which is no alarm.
        assert_eq!(robot.slow(0)["recorder"], Value::Null);
        known.header.stamp_ns = 16_000_000_000;
        taken(&mut robot, "motor/authority", &known);
        assert!(robot.slow(0)["recorder"]["problem"].as_str().unwrap().contains("16 s"));
    }

    #[test]
    fn a_recorder_that_is_stopped_or_gone_is_a_problem_at_once() {
        let mut robot = Robot::default();
        for (state, is_lost) in [
            (ProcessState::STATE_READY, false),
            (ProcessState::STATE_STOPPED, true),
            (ProcessState::STATE_STARTING, false),
            (ProcessState::STATE_GONE, true),
        ] {
            let mut row = ProcessState { state, ..ProcessState::default() };
            put_text(&mut row.name, RECORDER);
            taken(&mut robot, "system/process", &row);
            assert_eq!(robot.slow(0)["recorder"]["problem"].is_string(), is_lost, "{state}");
        }
    }

    #[test]
    fn the_mission_of_a_planner_that_is_silent_is_told_as_such() {
        let mut robot = Robot::default();
        let header = |ms: u64| Header { stamp_ns: ms * 1_000_000, ..Header::default() };
        let plan = PlanStatus { header: header(1000), state: PlanStatus::STATE_RUNNING, ..PlanStatus::default() };
        taken(&mut robot, "plan/status", &plan);
        let mut at = |ms: u64| {
            let authority = MotorAuthority { header: header(ms), period_s: 0.01, ..MotorAuthority::default() };
            taken(&mut robot, "motor/authority", &authority);
            robot.live(0)["mission"]["silent_s"].clone()
        };
        assert_eq!([at(900), at(1900), at(3100)], [Value::Null, Value::Null, json!(2.0)]);
    }

    #[test]
    fn a_robot_of_unknown_velocity_pushes_no_motion_out() {
        let mut robot = Robot::default();
        let mut at = |stamp_ns: u64, z_m_s: f64| {
            let header = Header { stamp_ns, ..Header::default() };
            taken(
                &mut robot,
                "motor/state",
                &MotorState { header, node_command_m_s: [0.0, 0.0, z_m_s], ..MotorState::default() },
            );
            robot.moving.len()
        };
        assert_eq!([at(1, 0.1), at(2, f64::NAN), at(3, 0.0), at(4, -0.1)], [1, 1, 1, 2]);
    }

    #[test]
    fn a_sample_of_another_type_or_size_changes_nothing() {
        let mut robot = Robot::default();
        robot.take("motor/authority", &[7; 12]);
        robot.define("motor/authority", "nims_msgs/Other/00000000", 8);
        taken(&mut robot, "motor/authority", &MotorAuthority::default());
        assert_eq!(robot.live(0)["mode"], Value::Null);
        assert_eq!(robot.slow(0)["unknown_channels"], json!(["motor/authority"]));
        robot.define("motor/authority", MotorAuthority::type_name(), size_of::<MotorAuthority>());
        taken(&mut robot, "motor/authority", &MotorAuthority::default());
        assert_eq!(robot.live(0)["mode"], json!("disarmed"));
    }

    #[test]
    fn the_stops_of_other_programs_are_noted() {
        let mut robot = Robot::default();
        let mut ask = |stamp_ns, verb, pid, accepted| {
            let (header, body) =
                (Header { stamp_ns, ..Header::default() }, RequestBody { verb, ..RequestBody::default() });
            let request = OperatorRequest { header, body, answered: 1, accepted, pid, ..OperatorRequest::default() };
            taken(&mut robot, "operator/request", &request);
            robot.stopped_ns()
        };
        let (other, yes) = (std::process::id() + 1, OperatorRequest::ACCEPTED);
        assert_eq!(ask(10, RequestBody::VERB_STOP, std::process::id(), yes), 0);
        assert_eq!(ask(20, RequestBody::VERB_GOTO, other, yes), 0);
        assert_eq!(ask(30, RequestBody::VERB_HOLD, other, OperatorRequest::REFUSED), 0);
        assert_eq!(ask(40, RequestBody::VERB_ESTOP, other, yes), 40);
        assert_eq!(ask(35, RequestBody::VERB_PAUSE, other, yes), 40);
    }

    #[test]
    fn who_flies_is_who_last_moved_the_robot() {
        let mut robot = Robot::default();
        let mut ask = |verb, who: &str, accepted| {
            let body = RequestBody { verb, ..RequestBody::default() };
            let mut request = OperatorRequest { body, answered: 1, accepted, ..OperatorRequest::default() };
            put_text(&mut request.requester, who);
            taken(&mut robot, "operator/request", &request);
            robot.slow(0)["flyer"]["name"].clone()
        };
        assert_eq!(ask(RequestBody::VERB_STOP, "ada", OperatorRequest::ACCEPTED), Value::Null);
        assert_eq!(ask(RequestBody::VERB_GOTO, "bob", OperatorRequest::ACCEPTED), json!("bob"));
        assert_eq!(ask(RequestBody::VERB_GOTO, "eve", OperatorRequest::REFUSED), json!("bob"));
        assert_eq!(ask(RequestBody::VERB_HOLD, "ada", OperatorRequest::ACCEPTED), json!("bob"));
    }
}
