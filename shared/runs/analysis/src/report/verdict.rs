//! Assessment of a run in one sentence, with a grade.

use super::completeness::recording;
use super::gather::{Mission, RunData};
use messages::{MotorAuthority, PlanStatus};
use robot_state::answers::without_cure;
use robot_state::sentences::fault_clauses;
use robot_state::{Periods, Reason};
use runlog::RunReport;
use serde::Serialize;

/// Maximum time between a fault and the planner's abort of the mission because of it, s.
const FAULT_WINDOW_S: f64 = 3.0;
/// Maximum time between the death of motor-io and the planner's detection of the restarted one, s.
const RESTART_WINDOW_S: f64 = 30.0;
/// Tolerance for the same instant in samples of different channels, s.
const SAME_INSTANT_S: f64 = 0.5;

/// Grade of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// No problems.
    Good,
    /// Remarks that deserve attention.
    Remarks,
    /// Something failed.
    Bad,
}

/// Assessment of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Verdict {
    /// Grade.
    pub grade: Grade,
    /// One sentence.
    pub sentence: String,
}

/// Assesses a run.
pub fn verdict(run: &RunData) -> Verdict {
    let mut grade = Grade::Good;
    let mut worsen = |worse: Grade| grade = grade.max(worse);
    let mut parts: Vec<String> = Vec::new();

    let flown = run.legs.flown_m();
    let Outcome { sentence, grade: worse, faults: named } = mission(run, flown);
    worsen(worse);
    parts.push(sentence);
    match &run.analysis {
        Some(analysis) => {
            let (error, by) = match &analysis.truth {
                Some(truth) => {
                    (truth, run.world.as_ref().map_or("(truth)".to_owned(), |world| format!("(truth; world: {world})")))
                }
                None => (&analysis.estimate, "(estimate)".to_owned()),
            };
            let least = at_least(run);
            parts.push(format!(
                "{least}{flown:.1} m of path in {least}{:.0} s of motion, {:.1} mm RMS and at most {:.1} mm from the setpoint {by}",
                analysis.moving_s,
                1000.0 * error.rms_m,
                1000.0 * error.max_m
            ));
        }
        None if flown >= 0.05 => {
            parts.push(format!("{}{flown:.1} m of path without an estimate", at_least(run)));
        }
        None => parts.push("nothing moved".to_owned()),
    }
    let mut rest: Vec<String> = Vec::new();
    match &run.authority {
        Some(_) => {
            if run.periods.unsteered() > 0 {
                worsen(Grade::Remarks);
            }
            rest.extend(steering_text(&run.periods));
        }
        None => worsen(Grade::Remarks),
    }
    let died = &run.events.died;
    if !died.is_empty() {
        worsen(Grade::Remarks);
        rest.push(format!("{} died", died.join(" and ")));
    }
    let stopped = final_stop(run, named);
    let well = died.is_empty() && stopped.is_none() && worse < Grade::Bad && run.recording.silent_s == 0;
    match run.events.faults {
        0 if well => rest.push("nothing failed".to_owned()),
        0 => rest.push("there was no fault".to_owned()),
        1 => rest.push("there was one fault".to_owned()),
        many => rest.push(format!("there were {many} faults")),
    }
    if run.events.faults > 0 {
        worsen(Grade::Remarks);
    }
    if let Some(stopped) = stopped {
        worsen(Grade::Bad);
        rest.push(stopped);
    }
    let (recording, is_complete) = recording(run);
    worsen(if is_complete { Grade::Good } else { Grade::Remarks });
    rest.push(recording);
    let last = rest.pop().unwrap_or_default();
    let rest = if rest.is_empty() { last } else { format!("{} and {last}", rest.join(", ")) };
    Verdict { grade, sentence: format!("{}; {rest}.", parts.join(": ")) }
}

/// Outcome of the mission.
struct Outcome {
    sentence: String,
    grade: Grade,
    /// Bits of the faults that the sentence names.
    faults: u32,
}

/// Describes the outcome of the mission.
fn mission(run: &RunData, flown_m: f64) -> Outcome {
    let outcome = |sentence: String, grade: Grade| Outcome { sentence, grade, faults: 0 };
    let moved = if flown_m > 0.0 { "The robot moved" } else { "No mission was flown" };
    let Some(mission) = &run.mission else { return outcome(moved.to_owned(), Grade::Good) };
    let (name, done) = (&mission.name, 100.0 * mission.progress);
    match mission.state {
        PlanStatus::STATE_DONE => outcome(format!("The mission \"{name}\" was completed"), Grade::Good),
        PlanStatus::STATE_ABORTED => {
            let (because, faults) = in_brackets(abort_reason(run, mission));
            let sentence = format!("The mission \"{name}\" was aborted at {done:.0} %{because}");
            Outcome { sentence, grade: Grade::Bad, faults }
        }
        PlanStatus::STATE_REFUSED if flown_m == 0.0 => {
            let (because, faults) = in_brackets(abort_reason(run, mission));
            let sentence = format!("The mission \"{name}\" was rejected{because}");
            Outcome { sentence, grade: Grade::Remarks, faults }
        }
        PlanStatus::STATE_READY | PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED => {
            unfinished_mission(run, mission)
        }
        _ => outcome(moved.to_owned(), Grade::Good),
    }
}

/// A cause as a clause, with the bits of the faults that it names.
struct Cause {
    clause: String,
    faults: u32,
}

impl Cause {
    fn new(clause: impl Into<String>) -> Self {
        Self { clause: clause.into(), faults: 0 }
    }

    fn from_fault((faults, clause): (u32, String)) -> Self {
        Self { clause, faults }
    }
}

/// Formats a cause in brackets; returns also the bits of its faults.
fn in_brackets(cause: Option<Cause>) -> (String, u32) {
    cause.map(|cause| (format!(" ({})", cause.clause), cause.faults)).unwrap_or_default()
}

/// Returns the reason for an abort or a rejection.
fn abort_reason(run: &RunData, mission: &Mission) -> Option<Cause> {
    let at_s = mission.since_s;
    let known = match mission.why {
        Some(Reason::EndedByFault { faults }) if faults.is_empty() => {
            run.events.fault_between(at_s - FAULT_WINDOW_S, at_s + SAME_INSTANT_S).map(Cause::from_fault)
        }
        Some(Reason::EndedByRestart) => {
            let died = run.events.died_between("motor-io", at_s - RESTART_WINDOW_S, at_s + SAME_INSTANT_S);
            died.map(|name| Cause::new(format!("{name} died")))
        }
        _ => None,
    };
    let faults = match mission.why {
        Some(Reason::EndedByFault { faults } | Reason::EndedAfterFault { faults }) => faults.bits,
        Some(Reason::EndedByEmergencyStop { faults }) => faults.bits & MotorAuthority::FAULT_EMERGENCY_INPUT,
        _ => 0,
    };
    // The cure only applies during the flight.
    let stated = mission.why.map_or_else(|| without_cure(&mission.sentence).to_owned(), |why| why.clause());
    known.or(Some(Cause { clause: stated, faults })).filter(|cause| !cause.clause.is_empty())
}

/// Returns whether the run is being recorded, so that its last samples describe the present.
fn is_live(run: &RunData) -> bool {
    run.recording.recording && run.recording.silent_s == 0
}

/// Returns whether the robot followed its motion at the end. The last sample of a dead motor-io precedes its end and
/// does not count.
fn is_following(run: &RunData) -> bool {
    let ended = |role| run.events.dead(role).or_else(|| run.events.silent(role));
    let last = run.authority.as_ref().filter(|_| ended("motor-io").is_none());
    last.is_some_and(|last| last.mode == MotorAuthority::MODE_FOLLOWING)
}

/// Returns why an unfinished mission does not continue, as far as the run shows.
fn cause(run: &RunData, mission: &Mission) -> Option<Cause> {
    let dead = |role: &str| run.events.dead(role).map(|name| Cause::new(format!("{name} died")));
    let died = |role: &str, from_s: f64| {
        let died = run.events.died_between(role, from_s, f64::INFINITY);
        died.map(|name| Cause::new(format!("{name} died"))).or_else(|| dead(role))
    };
    if let Some(died) = dead("motor-io") {
        return Some(died);
    }
    if let Some(name) = run.events.silent("motor-io") {
        return Some(Cause::new(format!("{name} sent no heartbeat")));
    }
    if is_following(run) {
        // While the robot follows a motion, a fault in motor-io's status is over, except for a lost planner.
        return dead("planner");
    }
    let last = run.authority.as_ref()?;
    if last.mode == MotorAuthority::MODE_EMERGENCY_STOP {
        return Some(Cause::new("emergency stop"));
    }
    let answers = [
        (MotorAuthority::FAULT_ESTIMATE_LOST, "estimator"),
        (MotorAuthority::FAULT_COMMAND_LOST, "controller"),
        (MotorAuthority::FAULT_PLANNER_LOST, "planner"),
    ];
    let mut lost = answers.into_iter().filter(|(bit, _)| last.faults & bit != 0);
    let process = lost.find_map(|(_, role)| died(role, mission.since_s - RESTART_WINDOW_S));
    process.or_else(|| current_fault(last)).or_else(|| died("planner", mission.since_s))
}

/// Returns the first fault of a cycle.
fn current_fault(authority: &MotorAuthority) -> Option<Cause> {
    fault_clauses(authority).into_iter().next().map(Cause::from_fault)
}

/// Describes a mission that was neither completed nor aborted.
fn unfinished_mission(run: &RunData, mission: &Mission) -> Outcome {
    let (name, done) = (&mission.name, 100.0 * mission.progress);
    let cause = cause(run, mission);
    if is_live(run) {
        let grade = if cause.is_some() { Grade::Bad } else { Grade::Good };
        let state = match mission.state {
            PlanStatus::STATE_PAUSED => format!("is paused at {done:.0} %"),
            PlanStatus::STATE_READY => "was accepted but has not started".to_owned(),
            _ if cause.is_some() && !is_following(run) => format!("is stopped at {done:.0} %"),
            _ => format!("is running, {done:.0} % complete"),
        };
        let (because, faults) = in_brackets(cause);
        return Outcome { sentence: format!("The mission \"{name}\" {state}{because}"), grade, faults };
    }
    let grade = if cause.is_some() { Grade::Bad } else { Grade::Remarks };
    let state = match mission.state {
        PlanStatus::STATE_PAUSED => format!("was paused at {done:.0} %"),
        PlanStatus::STATE_READY => "had not started".to_owned(),
        _ => format!("was unfinished at {done:.0} %"),
    };
    let when = if run.recording.recording { "at the last write of its recorder" } else { "when the recording ended" };
    let (because, faults) = in_brackets(cause.or_else(|| run.end_reason.clone().map(Cause::new)));
    Outcome { sentence: format!("The mission \"{name}\" {state} {when}{because}"), grade, faults }
}

/// Returns the current activity on the last leg of a run that is being recorded, if that leg is unfinished.
pub fn current_activity(run: &RunData) -> Option<&'static str> {
    let mission = run.mission.as_ref().filter(|_| is_live(run))?;
    match mission.state {
        PlanStatus::STATE_PAUSED => Some("paused"),
        PlanStatus::STATE_RUNNING if is_following(run) || cause(run, mission).is_none() => Some("running"),
        PlanStatus::STATE_RUNNING => Some("stopped"),
        _ => None,
    }
}

/// Returns the prefix for path and time of motion if parts of the run were not recorded.
pub fn at_least(run: &RunData) -> &'static str {
    let cycles = run.recording.channels.iter().filter(|channel| channel.name == "motor/authority");
    let unrecorded_s = cycles.map(|channel| channel.unrecorded_s).fold(0.0, f64::max);
    let short = unrecorded_s >= RunReport::LEAST_S || run.unrecorded_ends_s.iter().any(|seconds| *seconds > 0.0);
    if short { "at least " } else { "" }
}

/// Describes a robot that is stopped at the end; names the fault unless it is one of `named`, which were named before.
fn final_stop(run: &RunData, named: u32) -> Option<String> {
    let last = run.authority.as_ref()?;
    let (is, end) = if is_live(run) { ("is", "") } else { ("was", " at the end") };
    match last.mode {
        MotorAuthority::MODE_EMERGENCY_STOP => Some(format!("the robot {is} in emergency stop{end}")),
        MotorAuthority::MODE_FAULTED => Some(match current_fault(last) {
            Some(fault) if fault.faults & named != 0 => format!("the robot {is} stopped by this fault{end}"),
            fault => format!("the robot {is} stopped by a fault{end}{}", in_brackets(fault).0),
        }),
        _ => None,
    }
}

/// Returns the steered periods and the causes of the others; `None` without a mission.
fn steering_text(periods: &Periods) -> Option<String> {
    match (periods.all(), periods.unsteered()) {
        (0, _) => None,
        (all, 0) => Some(format!("all {all} periods were steered")),
        _ => Some(periods.summary()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::gather::blank;
    use crate::runs::tests::whole_file as file;
    use messages::{ProcessState, put_text};
    use runlog::{ChannelReport, FileReport};

    /// A run with a mission at 43 % and a robot in `mode`.
    fn run(state: u8, mode: u8) -> RunData {
        let (name, why, sentence) = ("demo".to_owned(), None, String::new());
        let mut run = blank();
        run.mission = Some(Mission { state, name, progress: 0.43, why, sentence, since_s: 10.0 });
        run.authority = Some(MotorAuthority { mode, ..MotorAuthority::default() });
        run.recording = RunReport { healthy: true, files: vec![file("run.mcap")], ..RunReport::default() };
        run
    }

    fn records(run: &mut RunData, silent_s: u64) {
        (run.recording.recording, run.recording.silent_s, run.recording.healthy) = (true, silent_s, false);
        run.recording.files = vec![FileReport { finished: false, recording: true, silent_s, ..file("run.mcap.part") }];
    }

    fn dies(run: &mut RunData, name: &str, role: &str) {
        let mut row = ProcessState { state: ProcessState::STATE_DIED, ..ProcessState::default() };
        put_text(&mut row.name, name);
        put_text(&mut row.role, role);
        run.events.process(9.0, &row);
    }

    /// The verdicts of these tests, which one test compares with the file of sentences.
    #[derive(Default)]
    struct Verdicts(Vec<(String, String)>);

    impl Verdicts {
        fn grade(&mut self, name: &str, run: &RunData) -> Grade {
            let verdict = verdict(run);
            self.0.push((format!("{name} ({:?})", verdict.grade), verdict.sentence));
            verdict.grade
        }
    }

    #[test]
    fn the_sentences_are_those_of_the_file() {
        let mut given = Verdicts::default();
        an_unfinished_mission_has_a_cause(&mut given);
        an_aborted_mission_names_the_fault_and_the_process(&mut given);
        an_earlier_run_shows_the_recorded_reason(&mut given);
        a_run_in_progress_is_described_in_the_present_tense(&mut given);
        a_recovered_file_is_incomplete_only_if_samples_are_missing(&mut given);
        sentences::compare(env!("CARGO_MANIFEST_DIR"), given.0.into_iter().chain(crate::runs::tests::without_end()));
    }

    fn an_unfinished_mission_has_a_cause(given: &mut Verdicts) {
        type M = MotorAuthority;
        type P = PlanStatus;
        // An emergency stop, after which the planner published nothing.
        let stopped = run(P::STATE_RUNNING, M::MODE_EMERGENCY_STOP);
        assert_eq!(given.grade("unfinished, emergency stop", &stopped), Grade::Bad);
        // The supervisor is gone.
        let mut alone = run(P::STATE_PAUSED, M::MODE_HOLDING);
        alone.authority.as_mut().unwrap().faults = M::FAULT_SUPERVISOR_LOST;
        given.grade("paused, no supervisor", &alone);
        records(&mut alone, 0);
        assert_eq!(given.grade("paused, no supervisor, still recorded", &alone), Grade::Bad);
        // A process died: motor-io, whose last sample does not show it, or the estimator, whose loss motor-io reports.
        let mut dead = run(P::STATE_RUNNING, M::MODE_FOLLOWING);
        dies(&mut dead, "motor-io", "motor-io");
        given.grade("unfinished, no motor-io", &dead);
        records(&mut dead, 0);
        given.grade("unfinished, no motor-io, still recorded", &dead);
        assert_eq!(current_activity(&dead), Some("stopped"));
        let mut blind = run(P::STATE_PAUSED, M::MODE_HOLDING);
        blind.authority.as_mut().unwrap().faults = M::FAULT_ESTIMATE_LOST;
        dies(&mut blind, "estimator-a", "estimator");
        given.grade("paused, no estimator", &blind);
        // Nothing failed: the run was ended.
        let mut ended = run(P::STATE_PAUSED, M::MODE_HOLDING);
        ended.end_reason = Some("Ctrl-C".to_owned());
        given.grade("paused, run ended", &ended);
    }

    fn an_aborted_mission_names_the_fault_and_the_process(given: &mut Verdicts) {
        type M = MotorAuthority;
        let mut faulted = run(PlanStatus::STATE_ABORTED, M::MODE_FAULTED);
        let faults = messages::faults::Faults::default();
        faulted.mission.as_mut().unwrap().why = Some(Reason::EndedByFault { faults });
        let mut last = faulted.authority.unwrap();
        last.faults = M::FAULT_SLACK;
        last.fault_cable[1] = 1;
        faulted.authority = Some(last);
        faulted.events.cycle(9.9, &last);
        assert_eq!(given.grade("aborted, fault of motor-io", &faulted), Grade::Bad);
        let faults = messages::faults::Faults::from_authority(&last);
        faulted.mission.as_mut().unwrap().why = Some(Reason::EndedByFault { faults });
        given.grade("aborted, fault of the planner's reason", &faulted);
        faulted.authority.as_mut().unwrap().faults = M::FAULT_SUPPLY;
        given.grade("aborted, another fault at the end", &faulted);
        let mut again = run(PlanStatus::STATE_ABORTED, M::MODE_DISARMED);
        again.mission.as_mut().unwrap().why = Some(Reason::EndedByRestart);
        given.grade("aborted, motor-io restarted", &again);
        dies(&mut again, "motor-io", "motor-io");
        given.grade("aborted, motor-io died", &again);
        // A cure is left out.
        again.mission.as_mut().unwrap().why = Some(Reason::EndedNotTakenUp { within_s: 5.0 });
        given.grade("aborted, not taken up", &again);
    }

    /// A run of an earlier version has the sentence alone, which is shown and decides nothing.
    fn an_earlier_run_shows_the_recorded_reason(given: &mut Verdicts) {
        let mut earlier = run(PlanStatus::STATE_ABORTED, MotorAuthority::MODE_DISARMED);
        dies(&mut earlier, "motor-io", "motor-io");
        let sentence = "the robot was disarmed or motor-io restarted; see nims status".to_owned();
        earlier.mission.as_mut().unwrap().sentence = sentence;
        given.grade("earlier version, with a reason", &earlier);
        earlier.mission.as_mut().unwrap().sentence = String::new();
        given.grade("earlier version, without a reason", &earlier);
    }

    fn a_run_in_progress_is_described_in_the_present_tense(given: &mut Verdicts) {
        let mut flown = run(PlanStatus::STATE_RUNNING, MotorAuthority::MODE_FOLLOWING);
        records(&mut flown, 0);
        assert_eq!(given.grade("running", &flown), Grade::Good);
        assert_eq!(current_activity(&flown), Some("running"));
        let mut paused = run(PlanStatus::STATE_PAUSED, MotorAuthority::MODE_HOLDING);
        records(&mut paused, 0);
        given.grade("paused", &paused);
        assert_eq!(current_activity(&paused), Some("paused"));
        // A hanging recorder keeps its file open and writes nothing.
        records(&mut flown, 12);
        assert_eq!(given.grade("running, silent recorder", &flown), Grade::Remarks);
        assert_eq!(current_activity(&flown), None);
    }

    fn a_recovered_file_is_incomplete_only_if_samples_are_missing(given: &mut Verdicts) {
        let mut run = run(PlanStatus::STATE_DONE, MotorAuthority::MODE_HOLDING);
        let recovered = FileReport { recovered: true, ..file("run.mcap") };
        run.recording.files = vec![recovered.clone(), file("run-0002.mcap")];
        run.recording.healthy = false;
        assert_eq!(given.grade("done, first file recovered", &run), Grade::Remarks);
        run.recording.files = vec![recovered];
        given.grade("done, last file recovered", &run);
        // Losses below the resolution of the sentence are not mentioned.
        run.recording.unrecorded_s = 0.04;
        given.grade("done, 0.04 s missing", &run);
        run.recording.unrecorded_s = 0.06;
        given.grade("done, 0.06 s missing", &run);
        assert_eq!(at_least(&run), "", "the loss is in another channel");
        let channel = ChannelReport {
            name: "motor/authority".to_owned(),
            schema: String::new(),
            messages: 1,
            bytes: 1,
            rate_hz: None,
            first_s: 0.0,
            last_s: 0.0,
            longest_silence_s: 0.0,
            lost: 6,
            gaps: 1,
            unrecorded_s: 0.06,
            refused: None,
        };
        run.recording.channels.push(channel);
        assert!(!at_least(&run).is_empty());
    }
}
