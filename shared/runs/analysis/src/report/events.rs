//! Events of a run, one sentence each.

use crate::incidents::fault_of;
use messages::{LogEvent, MotorAuthority, OperatorRequest, PlanStatus, ProcessState, Request, RequestBody, text_of};
use robot_state::sentences::{fault_clauses, faults_of, mode_name, mode_sentence};
use serde::Serialize;
use std::collections::BTreeMap;

/// Maximum number of listed events; of a run with more, the first ones are listed.
const MAX_EVENTS: usize = 400;
/// Maximum number of further events that may explain a deviation, a few megabytes.
const MAX_CAUSES: usize = 10_000;

/// Time within which a repeated event is merged, s.
const REPEAT_S: f64 = 10.0;

/// Subject of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EventKind {
    /// Mode of the robot.
    Mode,
    /// Fault, or a stop with a cause.
    Fault,
    /// Operator request.
    Operator,
    /// Mark of an operator.
    Mark,
    /// Mission.
    Mission,
    /// Process.
    Process,
    /// Warning or error in the log.
    Log,
}

impl EventKind {
    /// Returns the name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mode => "mode",
            Self::Fault => "fault",
            Self::Operator => "operator",
            Self::Mark => "mark",
            Self::Mission => "mission",
            Self::Process => "process",
            Self::Log => "log",
        }
    }

    /// Returns whether such an event may be a cause of a deviation.
    fn may_explain(self) -> bool {
        matches!(self, Self::Fault | Self::Operator | Self::Process)
    }
}

/// An event.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Event {
    /// Time since the start of the run, s.
    pub time_s: f64,
    /// Subject.
    pub kind: EventKind,
    /// One sentence; of a request the answer after the name of its user.
    pub text: String,
    /// User of a request or a mark, or the process that made it.
    pub requester: Option<String>,
    /// Number of occurrences within ten seconds; only the first is listed.
    pub times: u32,
}

/// Events of a run.
#[derive(Debug, Clone, Default)]
pub struct Events {
    events: Vec<Event>,
    /// Those beyond the limit that may explain a deviation.
    causes: Vec<Event>,
    /// Number of events beyond the limit of the list.
    pub left_out: usize,
    /// Number of faults.
    pub faults: usize,
    /// Names of the processes that died, without repetition.
    pub died: Vec<String>,
    mode: Option<u8>,
    bits: u32,
    mission: Option<(u8, u32, String)>,
    processes: BTreeMap<String, ProcessEntry>,
    /// Time and name of each process that died.
    deaths: Vec<(f64, String)>,
    /// Time, bit and clause of each fault.
    clauses: Vec<(f64, u32, String)>,
    /// Requests without an answer so far, by the process that asks and its number: time, user and what was asked for.
    unanswered: BTreeMap<(u32, u64), (f64, Option<String>, String)>,
}

/// Last entry of a process in the process table.
#[derive(Debug, Clone)]
struct ProcessEntry {
    state: u8,
    restarts: u32,
    pid: u32,
    role: String,
}

/// Returns whether a process in this state ended unexpectedly.
fn is_dead(state: u8) -> bool {
    matches!(state, ProcessState::STATE_DIED | ProcessState::STATE_GAVE_UP)
}

/// Returns what a request asks for, by its verb and its names.
fn asked(request: &OperatorRequest) -> String {
    if request.body.verb == RequestBody::VERB_FAULT {
        return format!("asked for the fault \"{}\"", fault_of(request));
    }
    let asked = Request::decode(request).ok().and_then(|request| serde_json::to_value(request).ok());
    let verb = asked.as_ref().and_then(|asked| asked["verb"].as_str()).unwrap_or("a request of another version");
    let name = text_of(&request.name);
    let of = if name.is_empty() { name } else { format!(" of {name}") };
    format!("asked for {verb}{of}")
}

impl Events {
    /// Returns all events, sorted by time.
    #[must_use]
    pub fn all(&self) -> &[Event] {
        &self.events
    }

    /// Returns the events that may explain a deviation, also those that are not listed.
    pub fn causes(&self) -> impl Iterator<Item = &Event> {
        self.events.iter().filter(|event| event.kind.may_explain()).chain(&self.causes)
    }

    fn push(&mut self, time_s: f64, kind: EventKind, text: String) {
        self.push_of(time_s, kind, text, None);
    }

    fn push_of(&mut self, time_s: f64, kind: EventKind, text: String, requester: Option<String>) {
        let is_full = self.events.len() >= MAX_EVENTS;
        let (list, most) = if is_full { (&mut self.causes, MAX_CAUSES) } else { (&mut self.events, MAX_EVENTS) };
        // Repeated events are listed once and counted. Repetitions of the log and of missions differ only in numbers;
        // of requests the numbers are what was asked.
        let bare = |text: &str| text.chars().filter(|letter| !letter.is_ascii_digit()).collect::<String>();
        let same = |event: &Event| match kind {
            EventKind::Log | EventKind::Mission => bare(&event.text) == bare(&text),
            EventKind::Operator => event.text == text,
            _ => false,
        };
        let mut recent = list.iter_mut().rev().take(8).take_while(|event| (time_s - event.time_s).abs() < REPEAT_S);
        if let Some(event) = recent.find(|event| event.kind == kind && same(event)) {
            event.times += 1;
            return;
        }
        self.left_out += usize::from(is_full);
        if list.len() < most && (!is_full || kind.may_explain()) {
            list.push(Event { time_s, kind, text, requester, times: 1 });
        }
    }

    /// Records changes of mode and new faults.
    pub fn cycle(&mut self, time_s: f64, authority: &MotorAuthority) {
        let fresh = authority.faults & !self.bits;
        if fresh != 0 {
            let new = MotorAuthority { faults: fresh, ..*authority };
            for (text, (bit, clause)) in faults_of(&new).into_iter().zip(fault_clauses(&new)) {
                self.faults += 1;
                if self.clauses.len() < MAX_EVENTS {
                    self.clauses.push((time_s, bit, clause));
                }
                self.push(time_s, EventKind::Fault, text);
            }
        }
        self.bits = authority.faults;
        if self.mode != Some(authority.mode) {
            self.mode = Some(authority.mode);
            let name = mode_name(authority.mode);
            let text = format!("{}{}: {}", name[..1].to_uppercase(), &name[1..], mode_sentence(authority.mode));
            self.push(time_s, EventKind::Mode, text);
        }
    }

    /// Records requests: an answered one as it is answered, the others at the end.
    pub fn request(&mut self, time_s: f64, request: &OperatorRequest) {
        let requester = Some(text_of(&request.requester)).filter(|name| !name.is_empty());
        let key = (request.pid, request.id);
        if request.answered != 1 {
            if self.unanswered.len() < MAX_EVENTS {
                self.unanswered.insert(key, (time_s, requester, asked(request)));
            }
            return;
        }
        self.unanswered.remove(&key);
        if request.body.verb == RequestBody::VERB_MARK && request.accepted == OperatorRequest::ACCEPTED {
            self.push_of(time_s, EventKind::Mark, text_of(&request.text), requester);
            return;
        }
        let accepted = request.accepted == OperatorRequest::ACCEPTED;
        let answer = match text_of(&request.answer) {
            // The answer says only that it was done.
            _ if accepted && request.body.verb == RequestBody::VERB_FAULT => asked(request),
            answer if answer.is_empty() => asked(request),
            answer => answer,
        };
        let refused = if accepted { "" } else { "Refused: " };
        let of = requester.as_ref().map_or_else(String::new, |name| format!("{name}: "));
        self.push_of(time_s, EventKind::Operator, format!("{of}{refused}{answer}"), requester);
    }

    /// Records starts and ends of missions, and rejections. Returns whether the state of a mission changed.
    pub fn plan(&mut self, time_s: f64, status: &PlanStatus) -> bool {
        let mission = text_of(&status.mission);
        let now = (status.state, status.refused, mission.clone());
        let before = self.mission.replace(now.clone());
        if before.as_ref() == Some(&now) {
            return false;
        }
        let reason = text_of(&status.reason);
        let because = if reason.is_empty() { String::new() } else { format!(": {reason}") };
        let what = match status.state {
            PlanStatus::STATE_RUNNING
                if before
                    .as_ref()
                    .is_some_and(|(state, _, known)| *state == PlanStatus::STATE_PAUSED && *known == mission) =>
            {
                format!("The mission \"{mission}\" continues: {:.1} s left.", status.time_left_s)
            }
            PlanStatus::STATE_RUNNING => {
                format!("The mission \"{mission}\" started: {} legs, {:.1} s.", status.legs, status.time_left_s)
            }
            PlanStatus::STATE_PAUSED => format!("The mission \"{mission}\" is paused."),
            PlanStatus::STATE_DONE => format!("The mission \"{mission}\" is complete."),
            PlanStatus::STATE_ABORTED => format!("The mission \"{mission}\" was aborted{because}"),
            PlanStatus::STATE_REFUSED => format!("A motion was rejected{because}"),
            _ => return false,
        };
        self.push(time_s, EventKind::Mission, what);
        true
    }

    /// Records deaths and restarts of processes.
    pub fn process(&mut self, time_s: f64, process: &ProcessState) {
        let name = text_of(&process.name);
        let lives = |state: u8| {
            matches!(state, ProcessState::STATE_READY | ProcessState::STATE_RUNNING | ProcessState::STATE_SILENT)
        };
        // A new process that did not take over the name (`nims plug --replace`) is not the process of that name.
        let other = |known: &ProcessEntry| lives(known.state) && process.pid != 0 && known.pid != process.pid;
        if process.state == ProcessState::STATE_STOPPED && self.processes.get(&name).is_some_and(other) {
            return;
        }
        let ProcessState { state, restarts, pid, .. } = *process;
        let known = ProcessEntry { state, restarts, pid, role: text_of(&process.role) };
        let before = self.processes.insert(name.clone(), known);
        if before.as_ref().is_some_and(|before| (before.state, before.restarts) == (state, restarts)) {
            return;
        }
        let before = before.map(|before| before.restarts);
        let reason = text_of(&process.reason);
        let because = if reason.is_empty() { String::new() } else { format!(": {reason}") };
        if is_dead(state) {
            self.deaths.push((time_s, name.clone()));
            if !self.died.contains(&name) {
                self.died.push(name.clone());
            }
        }
        let what = match process.state {
            ProcessState::STATE_DIED => "died",
            ProcessState::STATE_SILENT => "sends no heartbeat",
            ProcessState::STATE_GAVE_UP => "died too often and is not restarted",
            ProcessState::STATE_READY if before.is_some_and(|before| before < restarts) => "was restarted",
            ProcessState::STATE_READY if process.restarts > 0 => "is ready again",
            _ => return,
        };
        self.push(time_s, EventKind::Process, format!("{name} {what}{because}"));
    }

    /// Records warnings and errors.
    pub fn log(&mut self, time_s: f64, event: &LogEvent) {
        if event.level >= LogEvent::LEVEL_WARN {
            let level = if event.level == LogEvent::LEVEL_WARN { "warns" } else { "reports an error" };
            self.push(time_s, EventKind::Log, format!("{} {level}: {}", text_of(&event.process), text_of(&event.text)));
        }
    }

    /// Returns a process of this role that last sent no heartbeat, without having died.
    #[must_use]
    pub fn silent(&self, role: &str) -> Option<&str> {
        let is = |known: &ProcessEntry| known.role == role && known.state == ProcessState::STATE_SILENT;
        self.processes.iter().find(|(_, known)| is(known)).map(|(name, _)| name.as_str())
    }

    /// Returns a process of this role that was dead at the end of the recording.
    #[must_use]
    pub fn dead(&self, role: &str) -> Option<&str> {
        let mut dead = self.processes.iter().filter(|(_, known)| known.role == role && is_dead(known.state));
        dead.next().map(|(name, _)| name.as_str())
    }

    /// Returns a process of this role that died between these times, s since the start of the run.
    #[must_use]
    pub fn died_between(&self, role: &str, from_s: f64, to_s: f64) -> Option<&str> {
        let is = |name: &String| self.processes.get(name).is_some_and(|known| known.role == role);
        let within = self.deaths.iter().rev().find(|(at_s, name)| *at_s >= from_s && *at_s <= to_s && is(name));
        within.map(|(_, name)| name.as_str())
    }

    /// Returns bit and clause of the last fault between these times, s since the start of the run.
    #[must_use]
    pub fn fault_between(&self, from_s: f64, to_s: f64) -> Option<(u32, String)> {
        let within = self.clauses.iter().filter(|(at_s, ..)| (from_s..=to_s).contains(at_s));
        within.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, bit, clause)| (*bit, clause.clone()))
    }

    /// Adds the requests that have no answer, and sorts the events by time.
    pub fn close(&mut self) {
        for (time_s, requester, asked) in std::mem::take(&mut self.unanswered).into_values() {
            let of = requester.as_ref().map_or_else(String::new, |name| format!("{name}: "));
            let text = format!("{of}{asked}; the run has no answer to it");
            self.push_of(time_s, EventKind::Operator, text, requester);
        }
        self.events.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot_state::answers::detail;
    use robot_state::sentences::fault_sentences;

    #[test]
    fn a_process_that_died_is_counted_once() {
        let mut events = Events::default();
        let mut row = ProcessState::default();
        messages::put_text(&mut row.name, "motor-io");
        for state in [ProcessState::STATE_READY, ProcessState::STATE_DIED, ProcessState::STATE_READY] {
            row.state = state;
            events.process(1.0, &row);
        }
        (row.state, row.restarts) = (ProcessState::STATE_DIED, 1);
        events.process(2.0, &row);
        assert_eq!(events.died, ["motor-io"]);
    }

    fn answer(requester: &str, text: &str) -> OperatorRequest {
        let mut request = OperatorRequest { answered: 1, accepted: OperatorRequest::ACCEPTED, ..Default::default() };
        messages::put_text(&mut request.requester, requester);
        messages::put_text(&mut request.answer, text);
        request
    }

    #[test]
    fn requests_have_their_users_and_only_equal_ones_are_merged() {
        let mut events = Events::default();
        for (time_s, requester, text) in [
            (1.0, "ada", "set feedback.gain to 1.5"),
            (2.0, "ada", "set feedback.gain to 1.6"),
            (3.0, "ada", "set feedback.gain to 1.6"),
            (4.0, "bob", "set feedback.gain to 1.6"),
            (5.0, "", "holds"),
        ] {
            events.request(time_s, &answer(requester, text));
        }
        let listed: Vec<(&str, u32)> = events.all().iter().map(|event| (event.text.as_str(), event.times)).collect();
        let wanted = [
            ("ada: set feedback.gain to 1.5", 1),
            ("ada: set feedback.gain to 1.6", 2),
            ("bob: set feedback.gain to 1.6", 1),
            ("holds", 1),
        ];
        assert_eq!(listed, wanted);
        assert_eq!(events.all()[2].requester.as_deref(), Some("bob"));
    }

    #[test]
    fn a_fault_on_request_and_what_was_never_answered_are_listed() {
        let mut events = Events::default();
        let mut fault = Request::Fault { text: "stop controller".to_owned() }.encode().unwrap();
        messages::put_text(&mut fault.requester, "ada");
        (fault.pid, fault.id) = (7, 1);
        events.request(1.0, &fault);
        fault.put_answer(&robot_state::Reason::FaultDone { fault: detail("stop controller") }.answer());
        events.request(1.1, &fault);
        let mut hold = Request::Hold.encode().unwrap();
        (hold.pid, hold.id) = (7, 2);
        events.request(2.0, &hold);
        events.close();
        let listed: Vec<(EventKind, &str)> =
            events.all().iter().map(|event| (event.kind, event.text.as_str())).collect();
        let wanted = [
            (EventKind::Operator, "ada: asked for the fault \"stop controller\""),
            (EventKind::Operator, "asked for hold; the run has no answer to it"),
        ];
        assert_eq!(listed, wanted);
    }

    #[test]
    fn what_may_explain_a_deviation_is_kept_beyond_the_list() {
        let mut events = Events::default();
        let mut line = LogEvent { level: LogEvent::LEVEL_WARN, ..Default::default() };
        for number in 0..MAX_EVENTS + 3 {
            messages::put_text(&mut line.text, &"x".repeat(number % 50 + 1));
            events.log(20.0 * number as f64, &line);
        }
        let last_s = 20.0 * MAX_EVENTS as f64 + 100.0;
        events.request(last_s, &answer("ada", "goes to 1, 2, 3"));
        assert_eq!((events.all().len(), events.left_out), (MAX_EVENTS, 4));
        let causes: Vec<(f64, &str)> = events.causes().map(|event| (event.time_s, event.text.as_str())).collect();
        assert_eq!(causes, [(last_s, "ada: goes to 1, 2, 3")]);
    }

    #[test]
    fn a_failed_replacement_is_not_a_death_of_the_running_process() {
        let mut events = Events::default();
        let mut row = ProcessState { state: ProcessState::STATE_READY, restarts: 1, pid: 7, ..ProcessState::default() };
        messages::put_text(&mut row.name, "wind");
        events.process(1.0, &row);
        let told = events.all().len();
        (row.state, row.restarts, row.pid) = (ProcessState::STATE_STOPPED, 2, 8);
        events.process(2.0, &row);
        (row.state, row.restarts, row.pid) = (ProcessState::STATE_READY, 1, 7);
        events.process(3.0, &row);
        assert_eq!((events.died.len(), events.all().len()), (0, told));
    }

    #[test]
    fn dead_processes_are_found_by_role() {
        let mut events = Events::default();
        let mut row = ProcessState { state: ProcessState::STATE_READY, ..ProcessState::default() };
        messages::put_text(&mut row.name, "estimator-a");
        messages::put_text(&mut row.role, "estimator");
        events.process(1.0, &row);
        assert_eq!(events.dead("estimator"), None);
        row.state = ProcessState::STATE_SILENT;
        events.process(1.5, &row);
        assert_eq!((events.silent("estimator"), events.dead("estimator")), (Some("estimator-a"), None));
        row.state = ProcessState::STATE_DIED;
        messages::put_text(&mut row.reason, "was ended by signal 9");
        events.process(2.0, &row);
        let event = &events.all()[1];
        assert_eq!((event.kind, event.time_s), (EventKind::Process, 2.0));
        assert!(event.text.starts_with("estimator-a") && event.text.ends_with(&text_of(&row.reason)), "{}", event.text);
        assert_eq!((events.dead("estimator"), events.dead("planner")), (Some("estimator-a"), None));
        (row.state, row.restarts) = (ProcessState::STATE_READY, 1);
        events.process(3.0, &row);
        assert_eq!(events.dead("estimator"), None, "it was restarted");
        assert_eq!(events.died_between("estimator", 1.5, 2.5), Some("estimator-a"));
        assert_eq!(events.died_between("estimator", 2.5, 9.0), None);
    }

    #[test]
    fn a_fault_and_its_mode_are_recorded_once_with_the_cable() {
        let mut events = Events::default();
        let mut authority = MotorAuthority { mode: MotorAuthority::MODE_FOLLOWING, ..Default::default() };
        events.cycle(1.0, &authority);
        authority.faults = MotorAuthority::FAULT_SLACK;
        authority.fault_cable[1] = 1;
        authority.mode = MotorAuthority::MODE_FAULTED;
        events.cycle(2.0, &authority);
        events.cycle(2.01, &authority);
        authority.faults |= MotorAuthority::FAULT_SUPPLY;
        events.cycle(3.0, &authority);
        let kinds: Vec<EventKind> = events.all().iter().map(|event| event.kind).collect();
        assert_eq!(kinds, [EventKind::Mode, EventKind::Fault, EventKind::Mode, EventKind::Fault]);
        for (event, fault) in [(1, MotorAuthority::FAULT_SLACK), (3, MotorAuthority::FAULT_SUPPLY)] {
            let sentence = fault_sentences(fault).next().unwrap();
            assert!(events.all()[event].text.starts_with(sentence.trim_end_matches('.')), "{:?}", events.all());
        }
        assert!(events.all()[1].text.contains("cable 2"));
        assert_eq!(events.faults, 2);
        let slack = (MotorAuthority::FAULT_SLACK, "a cable is slack or broken (cable 2)".to_owned());
        assert_eq!(events.fault_between(1.5, 2.5), Some(slack));
        let supply = (MotorAuthority::FAULT_SUPPLY, "the supply voltage is low".to_owned());
        assert_eq!(events.fault_between(1.5, 3.5), Some(supply));
        assert_eq!(events.fault_between(4.0, 9.0), None);
    }
}
