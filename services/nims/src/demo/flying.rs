//! The flight of the demonstration: arms the robot, sets the position, flies the mission, and resumes it after stops
//! that were caused by a lack of CPU time.

use super::robot::Robot;
use crate::operate::MissionText;
use crate::progress::Progress;
use bus::clock;
use command::{Answer, Failure};
use messages::{MotorAuthority, NodeEstimate, PlanStatus, Request, text_of};
use robot_state::sentences::mode_name;
use std::path::PathBuf;
use std::time::Duration;

/// How long a request is repeated while the robot is not ready for it: the drives connect and the estimate settles.
const SETTLE: Duration = Duration::from_secs(15);
/// Time without progress after which the mission is aborted, s; longer than ramps and stalls of the machine.
const STUCK_S: f64 = 30.0;
/// Multiple of the planned time after which the mission is aborted.
const LATENESS: f64 = 5.0;
/// Time between two updates of the progress.
pub(super) const POLL: Duration = Duration::from_millis(100);
/// Time for the robot to hold after the last segment.
const REST: Duration = Duration::from_secs(15);
/// Faults after which the robot holds and keeps the motion, and which a lack of CPU time alone can cause.
const RESUMABLE_FAULTS: u32 = MotorAuthority::FAULT_LONG_GAP
    | MotorAuthority::FAULT_COMPUTER
    | MotorAuthority::FAULT_COMMAND_LOST
    | MotorAuthority::FAULT_ESTIMATE_LOST
    | MotorAuthority::FAULT_SUPERVISOR_LOST
    | MotorAuthority::FAULT_PLANNER_LOST;

/// Arms the robot, sets its position to `start`, flies the mission and waits for its end.
pub fn fly(robot: &mut Robot, mission: &MissionText, start: &[f64; 3], planned_s: f64) -> Answer {
    send_until_accepted(robot, client::MOTOR_IO, &Request::Arm)?;
    send_until_accepted(robot, client::MOTOR_IO, &Request::ZeroAt { position_m: *start })?;
    let mut estimates = robot.link().subscriber::<NodeEstimate>("node/estimate/a")?;
    wait(robot, SETTLE, "the estimator published no valid position", |_| {
        Ok(estimates.latest()?.is_some_and(|estimate| estimate.valid == 1))
    })?;
    let mut plans = robot.link().subscriber::<PlanStatus>("plan/status")?;
    let request = mission.request(&run_of(robot)?, false)?;
    send_until_accepted(robot, client::PLANNER, &request)?;

    let mut shown = Progress::begin();
    let mut limits = TimeLimits::new(planned_s, clock::now_ns());
    let (mut running, mut resumes) = (false, Resumes::default());
    loop {
        robot.poll_after(POLL)?;
        check_flyable(robot)?;
        if let Some(plan) = plans.latest()? {
            match plan.state {
                PlanStatus::STATE_RUNNING => running = true,
                PlanStatus::STATE_DONE if running => break,
                PlanStatus::STATE_ABORTED | PlanStatus::STATE_REFUSED => {
                    return Err(Failure::NotNow(abort_reason(robot, &plan)));
                }
                PlanStatus::STATE_PAUSED => resumes.resume(robot),
                _ => {}
            }
            limits.record(plan.progress, clock::now_ns());
            shown.show(&plan, clock::now_ns());
        }
        if let Some(why) = limits.exhausted(clock::now_ns()) {
            let obstacle = resumes.refused.map(|refused| format!(": {refused}")).unwrap_or_default();
            return Err(Failure::NotNow(format!("{why}{obstacle}")));
        }
    }
    shown.end();
    resumes.report_total();
    wait(robot, REST, "the robot did not come to rest", |robot| {
        Ok(robot.authority().is_some_and(|authority| authority.mode == MotorAuthority::MODE_HOLDING))
    })
}

/// Returns why a mission was aborted or refused: the faults if there are any, because the planner's reason does not
/// name their cures.
fn abort_reason(robot: &Robot, plan: &PlanStatus) -> String {
    let faults = robot.authority().map(robot_state::sentences::faults_of).unwrap_or_default();
    match faults.is_empty() {
        true => text_of(&plan.reason),
        false => faults.join(" "),
    }
}

/// Shortest time between two messages about a resumed mission, ns: an overloaded machine causes a stop every second.
const REPORT_NS: u64 = 10_000_000_000;

/// Resumes the mission after stops that no operator requested and no process death explains: the machine lacked CPU
/// time.
#[derive(Debug, Default)]
struct Resumes {
    count: u32,
    reported_ns: Option<u64>,
    /// Why motor-io last refused to resume.
    refused: Option<String>,
}

impl Resumes {
    fn resume(&mut self, robot: &mut Robot) {
        let faults = robot.authority().map(|authority| authority.faults & RESUMABLE_FAULTS);
        let Some(faults) = faults.filter(|bits| *bits != 0) else { return };
        if let Err(refusal) = client::send(robot.link(), client::MOTOR_IO, &Request::Resume) {
            self.refused = Some(refusal.to_string());
            return;
        }
        (self.count, self.refused) = (self.count + 1, None);
        let now_ns = clock::now_ns();
        if self.reported_ns.is_none_or(|reported_ns| now_ns >= reported_ns + REPORT_NS) {
            self.reported_ns = Some(now_ns);
            let sentence = robot_state::sentences::fault_sentences(faults).next().unwrap_or_default();
            let what = sentence.split(": ").next().unwrap_or_default();
            let times = match self.count {
                1 => String::new(),
                count => format!(", for the {count}th time"),
            };
            eprintln!("nims: {what}; all processes run, so the demonstration resumes the mission{times}");
        }
    }

    fn report_total(&self) {
        if self.count > 1 {
            let count = self.count;
            eprintln!(
                "nims: the robot held {count} times for lack of processor time; the demonstration resumed the mission"
            );
        }
    }
}

/// Time limits of a mission. A stalled machine only delays the mission, so the limit on the total time is generous; the
/// limit on the time without progress detects a mission that never ends.
#[derive(Debug)]
struct TimeLimits {
    planned_s: f64,
    began_ns: u64,
    progress: f64,
    progress_ns: u64,
}

impl TimeLimits {
    fn new(planned_s: f64, now_ns: u64) -> Self {
        Self { planned_s, began_ns: now_ns, progress: 0.0, progress_ns: now_ns }
    }

    fn record(&mut self, progress: f64, now_ns: u64) {
        if progress > self.progress {
            (self.progress, self.progress_ns) = (progress, now_ns);
        }
    }

    /// Returns which limit is exceeded, if any.
    fn exhausted(&self, now_ns: u64) -> Option<String> {
        let seconds = |from_ns: u64| now_ns.saturating_sub(from_ns) as f64 * 1e-9;
        let (planned_s, done) = (self.planned_s, 100.0 * self.progress);
        if seconds(self.progress_ns) > STUCK_S {
            Some(format!("the mission made no progress beyond {done:.0} % for {STUCK_S:.0} s"))
        } else if seconds(self.began_ns) > LATENESS * planned_s + STUCK_S {
            Some(format!(
                "the mission is planned to take {planned_s:.0} s, and is at {done:.0} % after {LATENESS:.0} times as long"
            ))
        } else {
            None
        }
    }
}

/// The run folder.
fn run_of(robot: &Robot) -> Answer<PathBuf> {
    let running = robot.link().running()?;
    running.map(|running| running.run).ok_or_else(|| Failure::NotNow("the supervisor has ended".to_owned()))
}

/// Repeats a request until it is accepted: just after the start a process may not be ready for it.
fn send_until_accepted(robot: &mut Robot, process: &str, request: &Request) -> Answer {
    let give_up = clock::now_ns() + SETTLE.as_nanos() as u64;
    loop {
        match client::send(robot.link(), process, request) {
            Ok(_) => return Ok(()),
            Err(failure) if clock::now_ns() >= give_up => return Err(failure),
            Err(_) => {
                robot.poll_after(POLL)?;
                check_flyable(robot)?;
            }
        }
    }
}

fn wait(robot: &mut Robot, timeout: Duration, what: &str, mut done: impl FnMut(&Robot) -> Answer<bool>) -> Answer {
    let give_up = clock::now_ns() + timeout.as_nanos() as u64;
    while !done(robot)? {
        if clock::now_ns() >= give_up {
            return Err(Failure::NotNow(format!("{what} within {} s", timeout.as_secs())));
        }
        robot.poll_after(POLL)?;
        check_flyable(robot)?;
    }
    Ok(())
}

/// Fails if the mission can no longer succeed: a signal, a faulted robot, or a dead process.
fn check_flyable(robot: &Robot) -> Answer {
    if robot.is_stopping() {
        return Err(Failure::NotNow(format!("stopped by {}", command::SIGNAL)));
    }
    if let Some(authority) = robot.authority()
        && matches!(authority.mode, MotorAuthority::MODE_FAULTED | MotorAuthority::MODE_EMERGENCY_STOP)
    {
        let faults = robot_state::sentences::faults_of(authority);
        // A requested emergency stop has no fault.
        let why = if faults.is_empty() { mode_name(authority.mode).to_owned() } else { faults.join(" ") };
        return Err(Failure::NotNow(format!("the robot has stopped: {why}")));
    }
    match robot.dead_required_process() {
        Some(name) => Err(Failure::NotNow(format!("{name} has died, and the mission needs it"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

    #[test]
    fn a_late_mission_continues_and_one_without_progress_is_ended() {
        let mut limits = TimeLimits::new(20.0, 0);
        for second in 1..=100_u32 {
            limits.record(f64::from(second) / 200.0, u64::from(second) * SECOND_NS);
            assert_eq!(limits.exhausted(u64::from(second) * SECOND_NS), None, "{second}");
        }
        assert_eq!(limits.exhausted(129 * SECOND_NS), None);
        assert!(limits.exhausted(131 * SECOND_NS).is_some(), "no progress for 31 s");
        let mut slow = TimeLimits::new(1.0, 0);
        slow.record(0.5, 34 * SECOND_NS);
        assert!(slow.exhausted(34 * SECOND_NS).is_none() && slow.exhausted(36 * SECOND_NS).is_some());
    }
}
