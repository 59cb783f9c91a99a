//! The flight of the demonstration: armed, zeroed, flown to its end, also where the machine pauses.

use super::robot::Robot;
use crate::operate::MissionText;
use bus::clock;
use command::{Answer, Failure};
use indicatif::{ProgressBar, ProgressStyle};
use messages::{MotorAuthority, NodeEstimate, PlanStatus, Request, text_of};
use robot_state::sentences::mode_name;
use std::io::IsTerminal;
use std::time::Duration;

/// How long a request is repeated while the robot is not ready for it: drives answer, an estimate settles.
const SETTLE: Duration = Duration::from_secs(15);
/// A mission that makes no progress for this long is broken off, s: ramps, and stalls of the machine.
const STUCK_S: f64 = 30.0;
/// And one that takes so many times as long as planned.
const LATENESS: f64 = 5.0;
/// How often progress is shown.
const LOOK: Duration = Duration::from_millis(100);
/// Time for the robot to hold after the last segment.
const REST: Duration = Duration::from_secs(15);
/// Stops after which the robot holds and the motion is kept, and for which a machine without time is reason enough.
const BY_ITSELF: u32 = MotorAuthority::FAULT_LONG_GAP
    | MotorAuthority::FAULT_COMPUTER
    | MotorAuthority::FAULT_COMMAND_LOST
    | MotorAuthority::FAULT_ESTIMATE_LOST
    | MotorAuthority::FAULT_SUPERVISOR_LOST
    | MotorAuthority::FAULT_PLANNER_LOST;

/// Arms, says where the node is, flies the mission and waits for its end.
pub fn fly(robot: &mut Robot, mission: &MissionText, start: &[f64; 3], planned_s: f64) -> Answer {
    insist(robot, client::MOTOR_IO, &Request::Arm)?;
    insist(robot, client::MOTOR_IO, &Request::ZeroAt { position_m: *start })?;
    let mut estimates = robot.bus().subscriber::<NodeEstimate>("node/estimate/a")?;
    wait(robot, SETTLE, "the estimator gives no position", |_| {
        Ok(estimates.latest()?.is_some_and(|estimate| estimate.valid == 1))
    })?;
    let mut plans = robot.bus().subscriber::<PlanStatus>("plan/status")?;
    let request = mission.request(robot.bus(), false)?;
    insist(robot, client::PLANNER, &request)?;

    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(1000) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template("{msg:40} {wide_bar} {percent:>3} %")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    bar.set_style(style);
    let mut patience = Patience::new(planned_s, clock::now_ns());
    let (mut running, mut resumes) = (false, Resumes::default());
    loop {
        robot.look(LOOK)?;
        going_on(robot)?;
        if let Some(plan) = plans.latest()? {
            match plan.state {
                PlanStatus::STATE_RUNNING => running = true,
                PlanStatus::STATE_DONE if running => break,
                PlanStatus::STATE_ABORTED | PlanStatus::STATE_REFUSED => {
                    return Err(Failure::NotNow(broken_off(robot, &plan)));
                }
                PlanStatus::STATE_PAUSED => resumes.look(robot),
                _ => {}
            }
            patience.note(plan.progress, clock::now_ns());
            bar.set_position((1000.0 * plan.progress) as u64);
            bar.set_message(format!(
                "{}, leg {} of {}, {:.0} s left",
                text_of(&plan.mission),
                plan.leg,
                plan.legs,
                plan.time_left_s
            ));
        }
        if let Some(why) = patience.over(clock::now_ns()) {
            let hindrance = resumes.refused.map(|refused| format!(": {refused}")).unwrap_or_default();
            return Err(Failure::NotNow(format!("{why}{hindrance}")));
        }
    }
    bar.finish_and_clear();
    resumes.tell_all();
    wait(robot, REST, "the robot does not come to rest", |robot| {
        Ok(robot.authority().is_some_and(|authority| authority.mode == MotorAuthority::MODE_HOLDING))
    })
}

/// Why a mission was broken off or refused: the faults say more than the planner, which only knows that there is one.
fn broken_off(robot: &Robot, plan: &PlanStatus) -> String {
    let faults = robot.authority().map(robot_state::sentences::faults_of).unwrap_or_default();
    match faults.is_empty() {
        true => text_of(&plan.reason),
        false => faults.join(" "),
    }
}

/// How often a stop that the machine caused is told, ns: a machine with too much to do causes one a second.
const TELL_NS: u64 = 10_000_000_000;

/// Going on after stops for which nobody asked and whose processes are all there: this machine had no time for the robot.
#[derive(Debug, Default)]
struct Resumes {
    count: u32,
    told_ns: Option<u64>,
    /// Why the robot cannot go on yet.
    refused: Option<String>,
}

impl Resumes {
    fn look(&mut self, robot: &mut Robot) {
        let Some(faults) = robot.authority().map(|authority| authority.faults & BY_ITSELF).filter(|bits| *bits != 0)
        else {
            return;
        };
        if let Err(refusal) = client::send(robot.bus(), client::MOTOR_IO, &Request::Resume) {
            self.refused = Some(refusal.to_string());
            return;
        }
        (self.count, self.refused) = (self.count + 1, None);
        let now_ns = clock::now_ns();
        if self.told_ns.is_none_or(|told_ns| now_ns >= told_ns + TELL_NS) {
            self.told_ns = Some(now_ns);
            let sentence = robot_state::sentences::fault_sentences(faults).next().unwrap_or_default();
            let what = sentence.split(": ").next().unwrap_or_default();
            let times = match self.count {
                1 => String::new(),
                count => format!(", for the {count}th time"),
            };
            eprintln!("nims: {what}; all processes are there, so the demonstration goes on by itself{times}");
        }
    }

    fn tell_all(&self) {
        if self.count > 1 {
            let count = self.count;
            eprintln!("nims: the robot held {count} times for want of time, and the demonstration went on by itself");
        }
    }
}

/// How long the end of a mission is waited for: a machine that stands still makes it late, and that is no reason to break it off, but
/// without progress it has no end.
#[derive(Debug)]
struct Patience {
    planned_s: f64,
    began_ns: u64,
    progress: f64,
    progress_ns: u64,
}

impl Patience {
    fn new(planned_s: f64, now_ns: u64) -> Self {
        Self { planned_s, began_ns: now_ns, progress: 0.0, progress_ns: now_ns }
    }

    fn note(&mut self, progress: f64, now_ns: u64) {
        if progress > self.progress {
            (self.progress, self.progress_ns) = (progress, now_ns);
        }
    }

    /// Why the end is not waited for any longer.
    fn over(&self, now_ns: u64) -> Option<String> {
        let seconds = |from_ns: u64| now_ns.saturating_sub(from_ns) as f64 * 1e-9;
        let (planned_s, done) = (self.planned_s, 100.0 * self.progress);
        if seconds(self.progress_ns) > STUCK_S {
            Some(format!("the mission stands at {done:.0} % for {STUCK_S:.0} s"))
        } else if seconds(self.began_ns) > LATENESS * planned_s + STUCK_S {
            Some(format!(
                "the mission should have taken {planned_s:.0} s, and is at {done:.0} % after {LATENESS:.0} times as long"
            ))
        } else {
            None
        }
    }
}

/// Asks until it is accepted: just after the start a process may not be ready for it yet.
fn insist(robot: &mut Robot, process: &str, request: &Request) -> Answer {
    let give_up = clock::now_ns() + SETTLE.as_nanos() as u64;
    loop {
        match client::send(robot.bus(), process, request) {
            Ok(_) => return Ok(()),
            Err(failure) if clock::now_ns() >= give_up => return Err(failure),
            Err(_) => {
                robot.look(LOOK)?;
                going_on(robot)?;
            }
        }
    }
}

fn wait(robot: &mut Robot, patience: Duration, what: &str, mut done: impl FnMut(&Robot) -> Answer<bool>) -> Answer {
    let give_up = clock::now_ns() + patience.as_nanos() as u64;
    while !done(robot)? {
        if clock::now_ns() >= give_up {
            return Err(Failure::NotNow(format!("{what} within {} s", patience.as_secs())));
        }
        robot.look(LOOK)?;
        going_on(robot)?;
    }
    Ok(())
}

/// Whether there is still a point in waiting.
fn going_on(robot: &Robot) -> Answer {
    if robot.is_stopping() {
        return Err(Failure::NotNow(format!("it was stopped by {}", command::SIGNAL)));
    }
    if let Some(authority) = robot.authority()
        && matches!(authority.mode, MotorAuthority::MODE_FAULTED | MotorAuthority::MODE_EMERGENCY_STOP)
    {
        let faults = robot_state::sentences::faults_of(authority);
        // Nobody calls an emergency stop a fault.
        let why = if faults.is_empty() { mode_name(authority.mode).to_owned() } else { faults.join(" ") };
        return Err(Failure::NotNow(format!("the robot has stopped: {why}")));
    }
    match robot.dead_and_vital() {
        Some(name) => Err(Failure::NotNow(format!("{name} has died, and the mission cannot be done without it"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

    #[test]
    fn a_mission_that_is_late_is_waited_for_and_one_that_stands_is_not() {
        let mut patience = Patience::new(20.0, 0);
        for second in 1..=100_u32 {
            patience.note(f64::from(second) / 200.0, u64::from(second) * SECOND_NS);
            assert_eq!(patience.over(u64::from(second) * SECOND_NS), None, "{second}");
        }
        assert_eq!(patience.over(129 * SECOND_NS), None);
        assert!(patience.over(131 * SECOND_NS).is_some(), "no progress for 31 s");
        let mut slow = Patience::new(1.0, 0);
        slow.note(0.5, 34 * SECOND_NS);
        assert!(slow.over(34 * SECOND_NS).is_none() && slow.over(36 * SECOND_NS).is_some());
    }
}
