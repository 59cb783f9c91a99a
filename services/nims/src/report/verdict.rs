//! What a run comes to in one sentence, and how good that is.

use super::gather::Gathered;
use crate::counters::Periods;
use crate::runs::ENDS;
use messages::{MotorAuthority, PlanStatus};
use runlog::FileReport;
use serde::Serialize;

/// How good it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Grade {
    /// Everything went as it should.
    Good,
    /// Worth a look.
    Remarks,
    /// Something failed.
    Bad,
}

/// The sentence, and the grade.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Verdict {
    /// How good it is.
    pub grade: Grade,
    /// One sentence.
    pub sentence: String,
}

/// Judges a run.
pub fn verdict(run: &Gathered) -> Verdict {
    let mut grade = Grade::Good;
    let mut at_least = |worse: Grade| grade = grade.max(worse);
    let mut parts: Vec<String> = Vec::new();

    let flown = run.legs.flown_m();
    let (mission, worse) = mission(run, flown);
    at_least(worse);
    parts.push(mission);
    match &run.analysis {
        Some(analysis) => {
            let (error, by) = match &analysis.truth {
                Some(truth) => (truth, "by truth"),
                None => (&analysis.estimate, "by the estimate"),
            };
            parts.push(format!(
                "{flown:.1} m of path in {:.0} s of motion, {:.1} mm (RMS) and at most {:.1} mm from the set point {by}",
                analysis.moving_s,
                1000.0 * error.rms_m,
                1000.0 * error.max_m
            ));
        }
        None => parts.push("nothing moved".to_owned()),
    }
    let mut rest: Vec<String> = Vec::new();
    match &run.authority {
        Some(_) => {
            if run.periods.unsteered() > 0 {
                at_least(Grade::Remarks);
            }
            rest.extend(steering(&run.periods));
        }
        None => at_least(Grade::Remarks),
    }
    let died = &run.events.died;
    if !died.is_empty() {
        at_least(Grade::Remarks);
        rest.push(format!("{} died", died.join(" and ")));
    }
    match run.events.faults {
        0 if died.is_empty() => rest.push("nothing failed".to_owned()),
        0 => rest.push("there was no fault".to_owned()),
        1 => rest.push("there was one fault".to_owned()),
        many => rest.push(format!("there were {many} faults")),
    }
    if run.events.faults > 0 {
        at_least(Grade::Remarks);
    }
    if let Some(last) = &run.authority
        && matches!(last.mode, MotorAuthority::MODE_FAULTED | MotorAuthority::MODE_EMERGENCY_STOP)
    {
        at_least(Grade::Bad);
        rest.push("the robot was stopped by it at the end".to_owned());
    }
    let (recording, worse) = recording(run);
    at_least(worse);
    rest.push(recording);
    let last = rest.pop().unwrap_or_default();
    let rest = if rest.is_empty() { last } else { format!("{} and {last}", rest.join(", ")) };
    Verdict { grade, sentence: format!("{}; {rest}.", parts.join(": ")) }
}

/// What became of the mission.
fn mission(run: &Gathered, flown_m: f64) -> (String, Grade) {
    let Some(mission) = &run.mission else {
        let what = if flown_m > 0.0 { "The robot moved" } else { "No mission was flown" };
        return (what.to_owned(), Grade::Good);
    };
    let (name, done) = (&mission.name, 100.0 * mission.progress);
    // The cure is for the time of the flight.
    let why = mission.reason.split("; ").next().filter(|why| !why.is_empty());
    let because = why.map(|why| format!(" ({why})")).unwrap_or_default();
    match mission.state {
        PlanStatus::STATE_DONE => (format!("The mission \"{name}\" was flown to its end"), Grade::Good),
        PlanStatus::STATE_ABORTED => {
            (format!("The mission \"{name}\" was broken off at {done:.0} %{because}"), Grade::Bad)
        }
        PlanStatus::STATE_REFUSED if flown_m == 0.0 => {
            (format!("The mission \"{name}\" was refused{because}"), Grade::Remarks)
        }
        PlanStatus::STATE_RUNNING if flies(run) => {
            (format!("The mission \"{name}\" is being flown, {done:.0} % of it are done"), Grade::Good)
        }
        PlanStatus::STATE_READY | PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED => {
            let stood = if mission.state == PlanStatus::STATE_PAUSED { "paused" } else { "not at its end" };
            (format!("The mission \"{name}\" was {stood} at {done:.0} % when the recording ended"), Grade::Remarks)
        }
        _ if flown_m > 0.0 => ("The robot moved".to_owned(), Grade::Good),
        _ => ("No mission was flown".to_owned(), Grade::Good),
    }
}

/// Whether the run is still being recorded and its mission flown.
pub fn flies(run: &Gathered) -> bool {
    run.recording.recording && run.mission.as_ref().is_some_and(|mission| mission.state == PlanStatus::STATE_RUNNING)
}

/// What of the run is in its files.
fn recording(run: &Gathered) -> (String, Grade) {
    let report = &run.recording;
    let mut lacks = Vec::new();
    if report.unrecorded_s > 0.0 {
        lacks.push(format!("{:.1} s were not recorded", report.unrecorded_s));
    }
    for (seconds, which) in run.unrecorded_ends_s.iter().zip(ENDS).filter(|(seconds, _)| **seconds > 0.0) {
        lacks.push(format!("of the {which} {seconds:.1} s nothing was recorded"));
    }
    let lost: u64 = report.channels.iter().map(|channel| channel.lost).sum();
    if lost > 0 {
        let channels = report.channels.iter().filter(|channel| channel.lost > 0).count();
        lacks.push(format!("{lost} samples of {channels} channels are missing"));
    }
    lacks.extend(report.files.iter().filter_map(lack_of));
    match (lacks.is_empty(), report.recording) {
        (true, true) => ("the run is still being recorded".to_owned(), Grade::Good),
        (true, false) if report.healthy => ("the recording is complete".to_owned(), Grade::Good),
        (true, false) => (format!("the recording is not whole ({})", report.verdict.join("; ")), Grade::Remarks),
        (false, true) => (format!("the run is still being recorded, but {}", lacks.join("; ")), Grade::Remarks),
        (false, false) => (format!("the recording is not whole ({})", lacks.join("; ")), Grade::Remarks),
    }
}

/// What a file lacks, if anything.
fn lack_of(file: &FileReport) -> Option<String> {
    let name = file.path.file_name().unwrap_or_default().to_string_lossy();
    let holes = file.damage.iter().filter(|damage| !damage.torn_end).count();
    match file {
        FileReport { recording: true, .. } => None,
        _ if holes > 0 => Some(format!("{name} is damaged in {holes} places: run `nims recover`")),
        FileReport { finished: false, .. } => Some(format!("{name} was not closed: run `nims recover`")),
        FileReport { recovered: true, .. } => {
            Some(format!("{name} was recovered, and what its recorder held last is missing"))
        }
        _ => None,
    }
}

/// The number that leads, and its causes; nothing where there was no mission.
fn steering(periods: &Periods) -> Option<String> {
    match (periods.all(), periods.unsteered()) {
        (0, _) => None,
        (all, 0) => Some(format!("all {all} periods were steered")),
        _ => Some(periods.words()),
    }
}
