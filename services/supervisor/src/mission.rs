//! What becomes of missions: that one is broken off is said at once, with its reason.

use bus::{Bus, Subscriber};
use command::Answer;
use messages::{MotorAuthority, PlanStatus, text_of};
use robot_state::sentences;

/// Follows the planner's account.
pub struct Missions {
    status: Subscriber<PlanStatus>,
    last: Option<PlanStatus>,
    /// Why the supervisor itself brings it to its end.
    ending: Option<String>,
}

/// Whether a mission is on.
fn is_on(state: u8) -> bool {
    matches!(state, PlanStatus::STATE_READY | PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED)
}

impl Missions {
    /// Of the planner of that domain.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn new(bus: &Bus) -> Answer<Self> {
        Ok(Self { status: bus.subscriber("plan/status")?, last: None, ending: None })
    }

    /// Takes in what the planner says; a sentence if a mission was broken off.
    ///
    /// # Errors
    /// Shared memory fails.
    pub fn poll(&mut self, authority: Option<&MotorAuthority>) -> Answer<Option<String>> {
        let mut said = None;
        while let Some(now) = self.status.receive()? {
            let before = self.last.replace(now).map(|before| before.state);
            if now.state == PlanStatus::STATE_ABORTED && before.is_some_and(is_on) {
                said = Some(broken_off(&now, authority, self.ending.as_deref()));
            }
        }
        Ok(said)
    }

    /// Everything ends: a mission that is still on is broken off by that.
    pub fn end(&mut self, because: &str) {
        if self.last.is_some_and(|last| is_on(last.state)) {
            self.ending = Some(because.to_owned());
        }
    }

    /// How the last mission ended, if it was broken off or has not come to its end.
    #[must_use]
    pub fn unfinished(&self, authority: Option<&MotorAuthority>) -> Option<String> {
        let last = self.last.as_ref().filter(|last| is_on(last.state) || last.state == PlanStatus::STATE_ABORTED)?;
        Some(broken_off(last, authority, self.ending.as_deref()))
    }
}

/// One sentence: which mission, how far it came, and why it went no further.
fn broken_off(status: &PlanStatus, authority: Option<&MotorAuthority>, ending: Option<&str>) -> String {
    let faults = authority.map(sentences::faults_of).unwrap_or_default();
    let reason = text_of(&status.reason);
    let why = match (ending, faults.first()) {
        (Some(because), _) => because.to_owned(),
        // The planner knows its name, and not what helps.
        (None, Some(fault)) => fault.trim_end_matches('.').to_owned(),
        (None, None) if reason.is_empty() => "the run was ended".to_owned(),
        (None, None) => reason,
    };
    format!("mission \"{}\" was broken off at {:.0} %: {why}", text_of(&status.mission), 100.0 * status.progress)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::put_text;

    #[test]
    fn a_mission_that_was_broken_off_has_a_name_a_share_and_a_reason() {
        let mut status = PlanStatus { state: PlanStatus::STATE_ABORTED, progress: 0.43, ..PlanStatus::default() };
        put_text(&mut status.mission, "demo");
        put_text(&mut status.reason, "a fault stopped the robot: the supply voltage is low");
        let authority = MotorAuthority { faults: MotorAuthority::FAULT_SUPPLY, ..MotorAuthority::default() };
        let said = broken_off(&status, Some(&authority), None);
        assert!(said.contains("\"demo\" was broken off at 43 %: The supply voltage is low"), "{said}");
        assert!(broken_off(&status, None, None).contains("a fault stopped the robot"));
        assert!(broken_off(&status, Some(&authority), Some("Ctrl-C")).ends_with("at 43 %: Ctrl-C"));
    }
}
