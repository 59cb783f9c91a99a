//! What happened at each fault: what failed, why, as far as the run shows it, and what the robot did, in one sentence.
//!
//! A fault of motor-io begins an incident. So does an emergency stop, and a process that died or sent no heartbeat
//! without a fault, such as a controller whose standby took over.

mod part;
mod reaction;

use crate::drive_units::{DriveUnit, drive_units};
use crate::run_time::RunTime;
use crate::tracker::{Cycle, Tracker};
use command::{Answer, Failure};
use messages::faults::{Faults, OF_CABLES, OF_UNITS, RELEASING};
use messages::{
    CONTROLLERS, ESTIMATORS, MotorAuthority, MotorState, OperatorRequest, ProcessState, RequestBody, SLOT_NAMES,
    text_of,
};
use part::{Failed, Target};
use reaction::{Aftermath, Timeline, during};
use robot_state::sentences::{FAULTS, ROLE_NAMES, named, verdict_sentence};
use runlog::{Attachment, RunReader};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

pub(crate) use part::fault_of;
pub use reaction::Step;

/// Largest number of incidents; a list of more is not read.
const MAX_INCIDENTS: usize = 100;
/// Largest number of facts of each kind that are kept, a few megabytes.
const MAX_FACTS: usize = 10_000;
/// Faults that come within this time after the first one belong to it, s.
const TOGETHER_S: f64 = 1.0;
/// Time before a fault in which a request for it was made, s: the slowest detection in the table of faults takes 250
/// cycles.
const ASKED_BEFORE_S: f64 = 3.0;
/// Time before a fault in which the process died that it names, s: that of a planner is noticed after two seconds.
const DIED_BEFORE_S: f64 = 3.0;
/// Time after a fault in which the supervisor reports its process, s: a silent one after two seconds.
const REPORTED_AFTER_S: f64 = 4.0;
/// Time after a fault in which the answer to the request for it is recorded, s.
const ANSWERED_S: f64 = 0.1;
/// Velocity below which a cable stands, m/s: two counts of an encoder in the 50 ms over which it is measured.
const STANDS_M_S: f64 = 0.005;
/// Time after an instant for which its incidents are read, s: that in which a robot brakes and a silent process is
/// reported.
const AFTERWARDS_S: f64 = 10.0;

/// A fault with what led to it and what followed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Incident {
    /// Time since the start of the run, s.
    pub time_s: f64,
    /// Control cycle; 0 for a process that failed without a fault of motor-io.
    pub cycle: u64,
    /// What failed, a clause for each fault.
    pub faults: Vec<String>,
    /// The processes, drive units and cables that failed.
    pub of: Vec<String>,
    /// What the run shows as the cause, a clause each; empty: nothing.
    pub causes: Vec<String>,
    /// What the robot did, in the order of time.
    pub did: Vec<Step>,
    /// All of it in one sentence.
    pub sentence: String,
}

/// Faults that began in one cycle.
#[derive(Debug, Clone)]
struct FaultFact {
    time_s: f64,
    /// The cycle, with the new faults only.
    authority: MotorAuthority,
    /// Which process, drive unit or cable each fault names. The processes are those of that time: another one may be
    /// in the slot later.
    subjects: Vec<(u32, String)>,
    /// Mode of the cycle before.
    before: u8,
    /// When all cables stood, s since the start of the run; `None`: they stood already, or it is not recorded.
    rest_s: Option<f64>,
}

/// A request that may be the cause of a fault.
#[derive(Debug, Clone)]
struct RequestFact {
    time_s: f64,
    /// Who asked for what.
    clause: String,
    is_estop: bool,
    target: Target,
}

/// How closely faults are linked to what a request let fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Link {
    /// The output of a process that they do not name.
    Remote,
    /// A part that they do not name. Cables pull on each other: where one breaks or is measured wrongly, another may be
    /// the first that is slack or pulls too hard.
    Possible,
    /// What they name.
    Named,
}

/// The end or the silence of a process.
#[derive(Debug, Clone)]
struct ProcessFact {
    time_s: f64,
    name: String,
    role: String,
    clause: String,
}

/// The facts of a run that incidents are made of.
#[derive(Debug, Clone, Default)]
pub struct Incidents {
    faults: Vec<FaultFact>,
    requests: Vec<RequestFact>,
    processes: Vec<ProcessFact>,
    timeline: Timeline,
    /// Name of the newest process of each role and slot.
    names: BTreeMap<(String, u8), String>,
    /// Role of each process.
    roles: BTreeMap<String, String>,
    /// State and restarts of each process.
    states: BTreeMap<String, (u8, u32)>,
    /// Drive units in the order in which faults number them; empty if unknown.
    units: Vec<DriveUnit>,
    last: Option<MotorAuthority>,
    /// A fault began while cables moved, and they did not stand since.
    moves: bool,
}

impl Incidents {
    /// Reads from the system file of a run which drive unit is which.
    pub fn name_units(&mut self, run: &Path, inside: &[Attachment]) {
        self.units = drive_units(run, inside);
    }

    /// Records a control cycle.
    pub fn cycle(&mut self, time_s: f64, authority: &MotorAuthority, state: Option<&MotorState>) {
        let last = self.last.replace(*authority);
        self.timeline.cycle(time_s, last.as_ref(), authority);
        let moving = state.map(|state| state.velocity_m_s.iter().any(|v| v.abs() > STANDS_M_S));
        let before = last.map_or(authority.mode, |last| last.mode);
        let fresh = authority.faults & !last.map_or(0, |last| last.faults);
        let stops = authority.mode == MotorAuthority::MODE_EMERGENCY_STOP && before != authority.mode;
        if self.moves && moving == Some(false) {
            self.moves = false;
            if let Some(fault) = self.faults.last_mut() {
                fault.rest_s = Some(time_s);
            }
        }
        if (fresh != 0 || stops) && self.faults.len() < MAX_FACTS {
            let authority = MotorAuthority { faults: fresh, ..*authority };
            let bits = FAULTS.iter().map(|fault| fault.bit).filter(|bit| fresh & bit != 0);
            let subjects = bits.filter_map(|bit| Some((bit, self.subject(&authority, bit)?))).collect();
            self.faults.push(FaultFact { time_s, authority, subjects, before, rest_s: None });
            self.moves = moving == Some(true);
        }
    }

    fn of_cycle(&mut self, time: &RunTime, cycle: &Cycle<'_>) {
        self.cycle(time.stamped_s(cycle.authority.header.stamp_ns), cycle.authority, cycle.state);
    }

    /// Records a request and its answer.
    pub fn request(&mut self, time_s: f64, request: &OperatorRequest) {
        let text = fault_of(request);
        let is_estop = request.body.verb == RequestBody::VERB_ESTOP;
        let begins = !["plug ", "continue "].iter().any(|word| text.starts_with(word)) && !text.ends_with(" off");
        let causes = is_estop || request.body.verb == RequestBody::VERB_FAULT && begins;
        let accepted = request.answered == 1 && request.accepted == OperatorRequest::ACCEPTED;
        if !(causes && accepted) || self.requests.len() >= MAX_FACTS {
            return;
        }
        let who = Some(text_of(&request.requester)).filter(|name| !name.is_empty());
        let who = who.unwrap_or_else(|| "an operator".to_owned());
        let what = if is_estop { "an emergency stop".to_owned() } else { format!("the fault \"{text}\"") };
        let target = if is_estop { Target::Other } else { Target::of_fault(&text) };
        self.requests.push(RequestFact { time_s, clause: format!("{who} asked for {what}"), is_estop, target });
    }

    /// Records a row of the process table.
    pub fn process(&mut self, time_s: f64, process: &ProcessState) {
        let (name, role) = (text_of(&process.name), text_of(&process.role));
        if process.pid != 0 {
            self.names.insert((role.clone(), process.slot), name.clone());
        }
        self.roles.insert(name.clone(), role.clone());
        let now = (process.state, process.restarts);
        let is_new = self.states.insert(name.clone(), now) != Some(now);
        let failed = match process.state {
            ProcessState::STATE_DIED | ProcessState::STATE_GAVE_UP => ending(&text_of(&process.reason)),
            ProcessState::STATE_SILENT => "sent no heartbeat".to_owned(),
            _ => return,
        };
        if is_new && self.processes.len() < MAX_FACTS {
            self.processes.push(ProcessFact { time_s, clause: format!("{name} {failed}"), name, role });
        }
    }

    /// Returns the incidents in the order of time, and the number of those beyond the limit.
    #[must_use]
    pub fn all(&self) -> (Vec<Incident>, usize) {
        let mut incidents = self.every();
        let left_out = incidents.len().saturating_sub(MAX_INCIDENTS);
        incidents.truncate(MAX_INCIDENTS);
        (incidents, left_out)
    }

    /// Returns the incidents in the order of time, also those beyond the limit of a list.
    fn every(&self) -> Vec<Incident> {
        let mut told = vec![false; self.processes.len()];
        let mut groups: Vec<Vec<&FaultFact>> = Vec::new();
        for fault in &self.faults {
            match groups.last_mut() {
                Some(group) if fault.time_s - group[0].time_s < TOGETHER_S => group.push(fault),
                _ => groups.push(vec![fault]),
            }
        }
        let ends = groups.iter().skip(1).map(|group| group[0].time_s).chain([f64::INFINITY]);
        let ends: Vec<f64> = ends.collect();
        let mut incidents: Vec<Incident> =
            groups.iter().zip(ends).map(|(group, end_s)| self.of_faults(group, end_s, &mut told)).collect();
        let alone = self.processes.iter().zip(told).filter(|(_, told)| !told);
        incidents.extend(alone.map(|(process, _)| self.of_process(process)));
        incidents.sort_by(|one, other| one.time_s.total_cmp(&other.time_s));
        incidents
    }

    /// Describes faults that came together, until the next ones; marks the processes that they name.
    fn of_faults(&self, group: &[&FaultFact], end_s: f64, told: &mut [bool]) -> Incident {
        let first = group[0];
        let (mut faults, mut of, mut causes) = (Vec::new(), Vec::new(), Vec::new());
        for fact in group {
            for fault in FAULTS.iter().filter(|fault| fact.authority.faults & fault.bit != 0) {
                let subject = fact.subjects.iter().find(|(bit, _)| *bit == fault.bit).map(|(_, name)| name.clone());
                let place = subject.as_ref().map_or_else(String::new, |subject| format!(" ({subject})"));
                faults.push(format!("{}{place}", fault.clause));
                of.extend(subject.filter(|subject| !of.contains(subject)));
                causes.extend(verdict(&fact.authority, fault.bit));
                let roles = roles_of(fault.bit);
                for (at, process) in self.processes.iter().enumerate() {
                    let within = first.time_s - DIED_BEFORE_S..=first.time_s + REPORTED_AFTER_S;
                    if roles.contains(&process.role.as_str()) && within.contains(&process.time_s) && !told[at] {
                        told[at] = true;
                        causes.push(process.clause.clone());
                    }
                }
            }
        }
        let is_estop = first.authority.faults == 0;
        if is_estop {
            faults.insert(0, "it was put into emergency stop".to_owned());
        }
        causes.extend(self.asked_for(group, !causes.is_empty()).map(|asked| asked.clause.clone()));
        causes.dedup();
        let rest_s = group.iter().rev().find_map(|fact| fact.rest_s).filter(|rest_s| *rest_s <= end_s);
        let released = self.released(group);
        let (from_s, before) = (first.time_s, first.before);
        let within_s = f64::INFINITY;
        let did = self.timeline.steps(&Aftermath { from_s, end_s, within_s, before, rest_s, released: &released });
        let cycle = first.authority.header.cycle;
        Incident { time_s: from_s, cycle, faults, of, causes, did, sentence: String::new() }.said(before)
    }

    /// Returns the request that is the cause of faults as far as the run shows it: the last one of those that are most
    /// closely linked to them.
    fn asked_for(&self, group: &[&FaultFact], is_explained: bool) -> Option<&RequestFact> {
        let (first_s, is_estop) = (group[0].time_s, group[0].authority.faults == 0);
        // The answer is recorded shortly after its effect.
        let after_s = if is_estop { TOGETHER_S } else { ANSWERED_S };
        let recent = first_s - ASKED_BEFORE_S..=first_s + after_s;
        let failed = Failed::of(group.iter().map(|fact| &fact.authority));
        let asked = self.requests.iter().filter(|it| it.is_estop == is_estop && recent.contains(&it.time_s));
        let linked = asked.filter_map(|asked| Some((self.link(&asked.target, group, &failed, is_explained)?, asked)));
        linked.max_by_key(|(link, _)| *link).map(|(_, asked)| asked)
    }

    /// Returns how closely faults are linked to what a request let fail; `None`: not at all. `is_explained`: the run
    /// shows another cause.
    fn link(&self, target: &Target, group: &[&FaultFact], failed: &Failed, is_explained: bool) -> Option<Link> {
        let is_named = match target {
            Target::Process(name) | Target::Output(Some(name)) => self.is_process_of(name, group, failed),
            Target::Output(None) => ROLE_NAMES.iter().any(|role| self.is_process_of(role, group, failed)),
            Target::Part(part) => part.is_in(failed, &self.units),
            Target::Other => false,
        };
        match target {
            _ if is_named => Some(Link::Named),
            // A suspended motor-io is late in everything.
            Target::Process(name) => (self.role_of(name) == "motor-io").then_some(Link::Possible),
            Target::Output(_) => (!is_explained).then_some(Link::Remote),
            Target::Part(_) | Target::Other => Some(Link::Possible),
        }
    }

    /// Returns whether faults name a process, or follow where one of its role fails.
    fn is_process_of(&self, name: &str, group: &[&FaultFact], failed: &Failed) -> bool {
        let (role, bits) = (self.role_of(name), failed.bits);
        let of_role = FAULTS.iter().any(|fault| bits & fault.bit != 0 && roles_of(fault.bit).contains(&role));
        let of_box = role == "motor-box" && bits & OF_UNITS != 0;
        let of_supervisor = role == "supervisor" && bits & MotorAuthority::FAULT_SUPERVISOR_LOST != 0;
        let process = format!("process {name}");
        let names = |subject: &str| {
            subject.strip_prefix(&process).is_some_and(|rest| rest.is_empty() || rest.starts_with(" in slot"))
        };
        let named = group.iter().flat_map(|fact| &fact.subjects).any(|(_, subject)| names(subject));
        of_role || of_box || of_supervisor || named
    }

    /// Returns the role of a process; its name if it has no row in the process table.
    fn role_of<'a>(&'a self, name: &'a str) -> &'a str {
        self.roles.get(name).map_or(name, String::as_str)
    }

    /// Describes a process that failed without a fault of motor-io.
    fn of_process(&self, process: &ProcessFact) -> Incident {
        let (from_s, before) = (process.time_s, self.timeline.mode_at(process.time_s));
        let recent = process.time_s - ASKED_BEFORE_S..=process.time_s;
        let of_it = |target: &Target| match target {
            Target::Process(name) | Target::Output(Some(name)) => *name == process.name,
            Target::Output(None) => false,
            // Only motor-io has to do with the motor box.
            Target::Part(_) => process.role == "motor-io",
            Target::Other => true,
        };
        let mut asked = self.requests.iter().rev().filter(|asked| !asked.is_estop && recent.contains(&asked.time_s));
        let asked = asked.find(|asked| of_it(&asked.target));
        let causes = asked.map(|asked| asked.clause.clone()).into_iter().collect();
        let next = self.faults.iter().find(|fault| fault.time_s > process.time_s);
        let end_s = next.map_or(f64::INFINITY, |fault| fault.time_s);
        // The drives stand until motor-io runs again, however long that takes; later changes of the mode have nothing
        // to do with the end of any other process.
        let within_s = if process.role == "motor-io" { f64::INFINITY } else { REPORTED_AFTER_S };
        let did = self.timeline.steps(&Aftermath { from_s, end_s, within_s, before, rest_s: None, released: &[] });
        let (faults, of) = (vec![process.clause.clone()], vec![format!("process {}", process.name)]);
        Incident { time_s: from_s, cycle: 0, faults, of, causes, did, sentence: String::new() }.said(before)
    }

    /// Returns which process, drive unit or cable a fault names.
    fn subject(&self, authority: &MotorAuthority, bit: u32) -> Option<String> {
        let inner = |text: String| Some(text.trim_matches([' ', '(', ')']).to_owned()).filter(|text| !text.is_empty());
        if bit & OF_CABLES != 0 {
            return inner(named(&authority.fault_cable, "cable"));
        }
        if bit & OF_UNITS != 0 {
            return inner(named(&authority.fault_unit, "drive unit"));
        }
        let role = match bit {
            MotorAuthority::FAULT_COMMAND_LOST | MotorAuthority::FAULT_COMMAND_REFUSED => CONTROLLERS,
            MotorAuthority::FAULT_ESTIMATE_LOST => ESTIMATORS,
            MotorAuthority::FAULT_PLANNER_LOST => return Some("process planner".to_owned()),
            MotorAuthority::FAULT_SUPERVISOR_LOST => return Some("process supervisor".to_owned()),
            _ => return None,
        };
        let slot = usize::from(authority.in_charge[role]).min(SLOT_NAMES.len() - 1);
        let name = self.names.get(&(ROLE_NAMES[role].to_owned(), slot as u8 + 1));
        let name = name.map_or(ROLE_NAMES[role], String::as_str);
        Some(format!("process {name} in slot {}", SLOT_NAMES[slot]))
    }

    /// Returns the numbers of the cables that the drives released.
    fn released(&self, group: &[&FaultFact]) -> Vec<usize> {
        let releases = |fact: &&&FaultFact| fact.authority.faults & RELEASING != 0;
        let marked = group.iter().filter(releases).map(|fact| Faults::from_authority(&fact.authority).cables);
        let mut cables: Vec<usize> =
            marked.flat_map(|cables| (1..).zip(cables)).filter_map(|(n, on)| on.then_some(n)).collect();
        cables.sort_unstable();
        cables.dedup();
        cables
    }
}

impl Incident {
    /// Adds the sentence; `before` is the mode in which the robot was.
    fn said(mut self, before: u8) -> Self {
        let because = match &self.causes[..] {
            [] => String::new(),
            causes => format!(", because {}", causes.join(" and ")),
        };
        let did: Vec<&str> = self.did.iter().map(|step| step.what.as_str()).collect();
        let did = match did.split_last() {
            Some((last, [])) => (*last).to_owned(),
            Some((last, others)) => format!("{} and {last}", others.join(", ")),
            None => "did nothing that the run shows".to_owned(),
        };
        let (during, faults) = (during(before), self.faults.join(", and "));
        self.sentence =
            format!("At {:.2} s, while the robot {during}, {faults}{because}: the robot {did}.", self.time_s);
        self
    }
}

/// Returns the roles of the processes whose end causes a fault.
fn roles_of(bit: u32) -> &'static [&'static str] {
    match bit {
        MotorAuthority::FAULT_COMMAND_LOST => &["controller", "estimator"],
        MotorAuthority::FAULT_COMMAND_REFUSED => &["controller"],
        MotorAuthority::FAULT_ESTIMATE_LOST => &["estimator"],
        MotorAuthority::FAULT_PLANNER_LOST => &["planner"],
        _ => &[],
    }
}

/// Returns why the command of the controller in charge was not used; `None` if it did not come, which the fault says.
fn verdict(authority: &MotorAuthority, bit: u32) -> Option<String> {
    let of_commands = MotorAuthority::FAULT_COMMAND_LOST | MotorAuthority::FAULT_COMMAND_REFUSED;
    let verdict = *authority.verdict.get(usize::from(authority.in_charge[CONTROLLERS]))?;
    let says = ![MotorAuthority::VERDICT_NONE, MotorAuthority::VERDICT_ACCEPTED, MotorAuthority::VERDICT_ABSENT]
        .contains(&verdict);
    let sentence = verdict_sentence(verdict).trim_end_matches('.');
    (bit & of_commands != 0 && says).then(|| sentence[..1].to_lowercase() + &sentence[1..])
}

/// Returns how a process ended, with its last words, from the supervisor's sentence.
fn ending(reason: &str) -> String {
    let (how, rest) = reason.split_once("; ").unwrap_or((reason, ""));
    let words = how.split_once(": ").or_else(|| rest.split_once(": ")).map(|(_, words)| words);
    let how = how.split(": ").next().filter(|how| !how.is_empty()).unwrap_or("died");
    words.map_or_else(|| how.to_owned(), |words| format!("{how} (its last words: {words})"))
}

/// Reads the incidents of a run that began by a UNIX time, ns, with what the robot did in the ten seconds after it.
///
/// # Errors
/// The run does not exist or cannot be read.
pub fn until(run: &Path, at_ns: u64) -> Answer<Vec<Incident>> {
    let mut reader = RunReader::open(run)?;
    let (mut incidents, mut tracker) = (Incidents::default(), Tracker::default());
    let mut time = RunTime::new(reader.begin_ns());
    let end_ns = at_ns.saturating_add((AFTERWARDS_S * 1e9) as u64);
    while let Some(recorded) = reader.next_sample().map_err(Failure::not_now)? {
        if recorded.log_time_ns > end_ns {
            break;
        }
        time.observe(&recorded);
        let time_s = time.logged_s(recorded.log_time_ns);
        match recorded.channel.name.as_str() {
            "operator/request" => recorded.decode().iter().for_each(|request| incidents.request(time_s, request)),
            "system/process" => recorded.decode().iter().for_each(|process| incidents.process(time_s, process)),
            _ => {}
        }
        tracker.record(&recorded, &mut |cycle: &Cycle<'_>| incidents.of_cycle(&time, cycle));
    }
    tracker.finish(&mut |cycle: &Cycle<'_>| incidents.of_cycle(&time, cycle));
    incidents.name_units(run, reader.attachments());
    let mut found = incidents.every();
    found.retain(|incident| incident.time_s <= time.logged_s(at_ns));
    Ok(found)
}

#[cfg(test)]
mod tests;
