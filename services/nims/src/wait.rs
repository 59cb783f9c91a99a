//! `--wait` of `nims goto` and `nims run`: follows a mission to its end, which decides the exit code.

use crate::progress::Progress;
use bus::clock;
use client::{RobotLink, Samples};
use command::{Answer, Failure, StopFlag};
use messages::{MotorAuthority, PlanStatus, text_of};
use robot_state::sentences::faults_of;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Time between two looks.
const POLL: Duration = Duration::from_millis(100);
/// The planner publishes ten times a second; after this time without a sample it does not run, ns.
const SILENT_NS: u64 = 10_000_000_000;

/// State of an accepted mission, from a status of the planner.
#[derive(Debug, PartialEq, Eq)]
enum Stage {
    /// It continues.
    Flying,
    /// Every leg was flown.
    Done,
    /// It has ended early: why.
    Ended(String),
}

/// Follows a mission from before its request.
pub struct Follower {
    plans: Samples<PlanStatus>,
    authority: Samples<MotorAuthority>,
    stop: StopFlag,
}

impl Follower {
    /// Subscribes. To be called before the mission is requested, so that no status is missed.
    ///
    /// # Errors
    /// The channels cannot be opened.
    pub fn begin(link: &RobotLink) -> Answer<Self> {
        let (plans, authority) = (link.subscriber("plan/status")?, link.subscriber("motor/authority")?);
        Ok(Self { plans, authority, stop: command::stop_flag()? })
    }

    /// Waits until the mission that was just accepted is done and the robot holds.
    ///
    /// # Errors
    /// The mission ended early, with the reason; or the wait ended, and the mission continues.
    pub fn wait(mut self) -> Answer {
        let accepted_ns = clock::now_ns();
        let (mut number, mut heard_ns) = (None, accepted_ns);
        let mut authority: Option<MotorAuthority> = None;
        let mut progress = Progress::begin();
        let ended = loop {
            clock::sleep_until(clock::now_ns() + POLL.as_nanos() as u64);
            authority = messages::newer(authority, self.authority.latest()?);
            let now_ns = clock::now_ns();
            // Statuses from before the answer are about an earlier mission.
            if let Some(plan) = self.plans.latest()?.filter(|plan| plan.header.published_ns >= accepted_ns) {
                heard_ns = now_ns;
                progress.show(&plan, now_ns);
                match stage(&plan, &mut number) {
                    Stage::Flying => {}
                    Stage::Done if authority.is_some_and(|now| now.mode == MotorAuthority::MODE_FOLLOWING) => {}
                    Stage::Done => break Ok(()),
                    Stage::Ended(why) => break Err(Failure::NotNow(with_faults(why, authority.as_ref()))),
                }
            }
            if self.stop.load(Ordering::Relaxed) {
                let sentence = "no longer waiting; the mission continues: `nims stop` ends it";
                break Err(Failure::NotNow(sentence.to_owned()));
            }
            if now_ns >= heard_ns + SILENT_NS {
                let sentence = "the planner has published nothing for 10 s; see `nims status`";
                break Err(Failure::NotNow(sentence.to_owned()));
            }
        };
        progress.end();
        ended
    }
}

/// Evaluates a status; `number` becomes that of the mission with its first motion.
fn stage(plan: &PlanStatus, number: &mut Option<u32>) -> Stage {
    if plan.mission_number != 0 && number.replace(plan.mission_number).is_some_and(|own| own != plan.mission_number) {
        return Stage::Ended("another motion has taken the place of this one".to_owned());
    }
    match plan.state {
        PlanStatus::STATE_READY | PlanStatus::STATE_RUNNING | PlanStatus::STATE_PAUSED => Stage::Flying,
        PlanStatus::STATE_DONE => Stage::Done,
        PlanStatus::STATE_IDLE => Stage::Ended("the planner was restarted and has lost the mission".to_owned()),
        _ => Stage::Ended(text_of(&plan.reason)),
    }
}

/// The reason with the faults of the robot, which name their cures.
fn with_faults(why: String, authority: Option<&MotorAuthority>) -> String {
    let faults = authority.map(faults_of).unwrap_or_default();
    if faults.is_empty() { why } else { format!("{why}: {}", faults.join(" ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(state: u8, mission_number: u32) -> PlanStatus {
        PlanStatus { state, mission_number, ..PlanStatus::default() }
    }

    #[test]
    fn a_mission_is_followed_to_its_end() {
        let mut number = None;
        for state in [PlanStatus::STATE_READY, PlanStatus::STATE_RUNNING, PlanStatus::STATE_PAUSED] {
            assert_eq!(stage(&status(state, 7), &mut number), Stage::Flying);
        }
        // At its end the planner has no motion.
        assert_eq!(stage(&status(PlanStatus::STATE_DONE, 0), &mut number), Stage::Done);
    }

    #[test]
    fn a_mission_that_does_not_come_to_its_end_has_failed() {
        let cases = [(PlanStatus::STATE_ABORTED, 0), (PlanStatus::STATE_IDLE, 0), (PlanStatus::STATE_RUNNING, 8)];
        for (state, other) in cases {
            let mut number = None;
            assert_eq!(stage(&status(PlanStatus::STATE_RUNNING, 7), &mut number), Stage::Flying);
            assert!(matches!(stage(&status(state, other), &mut number), Stage::Ended(_)), "{state}");
        }
    }
}
