//! Follows the mission and reports at once, with its reason, when it is aborted.

use bus::{Bus, Subscriber};
use command::Answer;
use messages::{MotorAuthority, PlanStatus, text_of};
use robot_state::sentences;

/// Follows `plan/status`.
pub struct Missions {
    status: Subscriber<PlanStatus>,
    last: Option<PlanStatus>,
    /// Why the supervisor ends the run.
    ending: Option<String>,
}

/// Whether a mission is planned and not complete.
fn is_on(state: u8) -> bool {
    matches!(state, PlanStatus::STATE_READY | PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED)
}

impl Missions {
    /// Subscribes to the planner of that domain.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn new(bus: &Bus) -> Answer<Self> {
        Ok(Self { status: bus.subscriber("plan/status")?, last: None, ending: None })
    }

    /// Receives the planner's status; a sentence if a mission was aborted.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn poll(&mut self, authority: Option<&MotorAuthority>) -> Answer<Option<String>> {
        let mut sentence = None;
        while let Some(now) = self.status.receive()? {
            let before = self.last.replace(now).map(|before| before.state);
            if now.state == PlanStatus::STATE_ABORTED && before.is_some_and(is_on) {
                sentence = Some(abort_sentence(&now, authority, self.ending.as_deref()));
            }
        }
        Ok(sentence)
    }

    /// The run ends: a mission that is not complete is aborted for this reason.
    pub fn end(&mut self, because: &str) {
        if self.last.is_some_and(|last| is_on(last.state)) {
            self.ending = Some(because.to_owned());
        }
    }

    /// How the last mission ended, if it was aborted or is not complete.
    #[must_use]
    pub fn unfinished(&self, authority: Option<&MotorAuthority>) -> Option<String> {
        let last = self.last.as_ref().filter(|last| is_on(last.state) || last.state == PlanStatus::STATE_ABORTED)?;
        Some(abort_sentence(last, authority, self.ending.as_deref()))
    }
}

/// One sentence: the mission, its progress, and why it was aborted.
fn abort_sentence(status: &PlanStatus, authority: Option<&MotorAuthority>, ending: Option<&str>) -> String {
    let faults = authority.map(sentences::faults_of).unwrap_or_default();
    let reason = text_of(&status.reason);
    let why = match (ending, faults.first()) {
        (Some(because), _) => because.to_owned(),
        // The sentence of the fault includes a cure; the planner's reason does not.
        (None, Some(fault)) => fault.trim_end_matches('.').to_owned(),
        (None, None) if reason.is_empty() => "the run was ended".to_owned(),
        (None, None) => reason,
    };
    format!("mission \"{}\" was aborted at {:.0} %: {why}", text_of(&status.mission), 100.0 * status.progress)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::put_text;

    #[test]
    fn an_aborted_mission_has_a_name_a_progress_and_a_reason() {
        let mut status = PlanStatus { state: PlanStatus::STATE_ABORTED, progress: 0.43, ..PlanStatus::default() };
        put_text(&mut status.mission, "demo");
        put_text(&mut status.reason, "a fault stopped the robot: the supply voltage is low");
        let authority = MotorAuthority { faults: MotorAuthority::FAULT_SUPPLY, ..MotorAuthority::default() };
        let sentence = abort_sentence(&status, Some(&authority), None);
        assert!(sentence.contains("\"demo\"") && sentence.contains("43 %"), "{sentence}");
        let fault = sentences::faults_of(&authority).remove(0);
        assert!(sentence.ends_with(fault.trim_end_matches('.')), "{sentence}");
        assert!(abort_sentence(&status, None, None).ends_with(&text_of(&status.reason)));
        let ended = abort_sentence(&status, Some(&authority), Some("Ctrl-C"));
        assert!(ended.contains("43 %") && ended.ends_with("Ctrl-C") && !ended.contains(&fault), "{ended}");
    }
}
