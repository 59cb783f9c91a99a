//! What a run comes to in one sentence, and how good that is.

use super::gather::Gathered;
use messages::{MotorAuthority, PlanStatus};
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

    let mission = run.mission.as_ref().map(|(state, name)| (*state, name.as_str()));
    let flown = run.legs.flown_m();
    parts.push(match mission {
        Some((PlanStatus::STATE_DONE, name)) => format!("The mission \"{name}\" was flown to its end"),
        Some((PlanStatus::STATE_ABORTED, name)) => {
            at_least(Grade::Bad);
            format!("The mission \"{name}\" was given up")
        }
        Some((PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED, name)) => {
            at_least(Grade::Remarks);
            format!("The mission \"{name}\" had not come to its end when the recording ended")
        }
        _ if flown > 0.0 => "The robot moved".to_owned(),
        _ => "No mission was flown".to_owned(),
    });
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
        Some(last) if last.missed > 0 => {
            at_least(Grade::Remarks);
            rest.push(format!("{} cycles had no valid command", last.missed));
        }
        Some(_) => rest.push("no cycle was missed".to_owned()),
        None => at_least(Grade::Remarks),
    }
    match run.events.faults {
        0 => rest.push("nothing failed".to_owned()),
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
    if run.recording.healthy {
        rest.push("the recording is complete".to_owned());
    } else {
        at_least(Grade::Remarks);
        rest.push(format!("the recording is not whole ({})", run.recording.verdict.join("; ")));
    }
    let last = rest.pop().unwrap_or_default();
    let rest = if rest.is_empty() { last } else { format!("{} and {last}", rest.join(", ")) };
    Verdict { grade, sentence: format!("{}; {rest}.", parts.join(": ")) }
}
