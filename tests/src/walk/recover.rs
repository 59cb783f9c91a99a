//! Recovery: requests a motion and applies the cures that refusals name, until the motion is finished.

use super::Walk;
use super::cures::{Cure, cures, is_settled};
use anyhow::{Result, bail, ensure};
use cable_robot::Vector3;
use messages::{CONTROLLERS, ESTIMATORS, PlanStatus, Request, SLOTS, Slot, SlotRole, text_of};
use planner::mission::PathShape;
use robot_state::sentences::faults_of;

/// Target position of a recovery, m.
const HOME_M: [f64; 3] = [4.8, 3.0, 0.6];
/// Tolerance of the target, m; stretch and drum radii are not known better.
const THERE_M: f64 = 0.03;
/// Cures after which a recovery counts as failed.
const PATIENCE: usize = 60;
/// Cycles without progress after which a motion counts as failed; at a tenth of its speed it may take long.
const STANDS: usize = 3_000;
/// Cycles at rest after which a motion waits for the operator.
const RESTING: usize = 150;

impl Walk {
    /// Recovers the robot to a finished motion by the cures that refusals name.
    pub(super) fn recover(&mut self) -> Result<()> {
        let goal = HOME_M.map(|x| x + self.random.between(-0.1, 0.1));
        // A law that is wrong in every cycle is replaced before other cures are tried.
        for slot in 0..SLOTS {
            if self.astray[slot].is_some() && self.robot.slots().lives(CONTROLLERS, slot) {
                self.begin(CONTROLLERS, slot);
            }
        }
        for _ in 0..PATIENCE {
            let sentence = match self.goto(goal, Some(0.3), PathShape::Line, None)? {
                None => "the planner does not answer; start the robot with nims up".to_owned(),
                Some(Err(sentence)) if is_settled(&sentence) => return self.arrived(goal),
                Some(Err(sentence)) => sentence,
                Some(Ok(_)) => match self.await_end()? {
                    None => return self.arrived(goal),
                    Some(sentence) => sentence,
                },
            };
            self.tally.cures += 1;
            self.cure(&sentence)?;
        }
        bail!("the robot is not brought back to {goal:?} by what its refusals say")
    }

    fn arrived(&mut self, goal: [f64; 3]) -> Result<()> {
        self.tally.returns += 1;
        self.record("brought back".into());
        let off_m = (Vector3::from(self.robot.plant().position_m()) - Vector3::from(goal)).norm();
        ensure!(off_m < THERE_M, "the node is {off_m:.3} m from where the finished motion ends");
        Ok(())
    }

    /// `None` at the end of the motion; else the reason why it was aborted, or for which it waits.
    fn await_end(&mut self) -> Result<Option<String>> {
        let (mut resting, mut standing, mut progress) = (0, 0, f64::NAN);
        while standing < STANDS {
            self.period()?;
            let status = self.robot.plan_status();
            standing = if status.progress == progress { standing + 1 } else { 0 };
            progress = status.progress;
            match status.state {
                PlanStatus::STATE_DONE => return Ok(None),
                PlanStatus::STATE_ABORTED => {
                    let reason = text_of(&status.reason);
                    self.record(format!("given up: {reason}"));
                    return Ok(Some(format!("{reason}; start a new motion, see nims status")));
                }
                PlanStatus::STATE_PAUSED => resting += 1,
                _ if !self.robot.motor_io_lives() || !self.robot.planner_lives() => resting += 1,
                _ => resting = 0,
            }
            if resting > RESTING {
                let said = self.faults();
                return Ok(Some(match said.is_empty() {
                    true => "the mission is paused; resume it with nims resume, or give it up with nims stop".into(),
                    false => said,
                }));
            }
        }
        let status = self.robot.plan_status();
        let rate = self.last.map_or(f64::NAN, |last| last.authority.plan_rate);
        bail!("a motion does not end: state {}, {:.1} s left, plan rate {rate}", status.state, status.time_left_s)
    }

    /// Faults as `nims status` shows them.
    fn faults(&self) -> String {
        self.last.map_or(String::new(), |last| faults_of(&last.authority).join(" "))
    }

    /// Applies one of the cures that a sentence names.
    fn cure(&mut self, sentence: &str) -> Result<()> {
        let named = cures(sentence);
        ensure!(!named.is_empty(), "the sentence names no cure: {sentence}");
        let cure = self.random.choose(&named);
        self.record(format!("cure {cure:?} for: {sentence}"));
        self.carry_out(cure)
    }

    fn carry_out(&mut self, cure: Cure) -> Result<()> {
        match cure {
            Cure::Arm => self.request(Request::Arm),
            Cure::Reset => self.request(Request::Reset),
            Cure::Stop => self.request(Request::Stop),
            Cure::Resume => match self.ask(Request::Resume)? {
                Some(Ok(_)) => self.await_end().map(|_| ()),
                _ => Ok(()),
            },
            Cure::Confirm if !self.powered_off => self.request(Request::ConfirmPosition),
            // An operator who looks sees that the node is elsewhere.
            Cure::Confirm | Cure::Zero => match self.zero()? {
                Some(_) => Ok(()),
                None => self.start_what_is_missing(),
            },
            Cure::Admit => Slot::ALL.into_iter().try_for_each(|slot| {
                self.ask(Request::Admit { role: SlotRole::Estimator, slot })?;
                self.ask(Request::Admit { role: SlotRole::Controller, slot }).map(|_| ())
            }),
            Cure::Wait => self.periods(110),
            Cure::AskOtherwise => Ok(()),
            Cure::Up => {
                self.up();
                self.periods(150)
            }
            Cure::Status => {
                self.up();
                self.periods(150)?;
                // Then the cures of the faults in status, unless they only refer to status again.
                let named: Vec<Cure> = cures(&self.faults()).into_iter().filter(|cure| *cure != Cure::Status).collect();
                if named.is_empty() { Ok(()) } else { self.carry_out(self.random.clone().choose(&named)) }
            }
            Cure::Restart => {
                let slot = self.last.map_or(0, |last| usize::from(last.authority.in_charge[ESTIMATORS]));
                self.begin(ESTIMATORS, slot);
                self.periods(150)
            }
            Cure::OtherController => {
                let slot = self.last.map_or(0, |last| 1 - usize::from(last.authority.in_charge[CONTROLLERS]).min(1));
                if self.astray[slot].is_some() || !self.robot.slots().lives(CONTROLLERS, slot) {
                    self.begin(CONTROLLERS, slot);
                }
                self.request(Request::Reset)?;
                self.periods(150)?;
                self.ask(Request::Swap { role: SlotRole::Controller, slot: Slot::ALL[slot] })?;
                self.periods(60)
            }
            Cure::JogTaut => {
                self.request(Request::Reset)?;
                let slack = self.last.map_or([0; 8], |last| last.authority.fault_cable);
                let cable = slack.iter().position(|named| *named == 1).unwrap_or(0) as u8 + 1;
                self.ask(Request::Jog { cable, distance_m: -0.02 })?;
                self.periods(100)
            }
        }
    }

    fn request(&mut self, request: Request) -> Result<()> {
        match self.ask(request)? {
            Some(_) => self.periods(60),
            None => self.start_what_is_missing(),
        }
    }

    /// A request without an answer: `nims` reports that motor-io is not running and how to start it.
    fn start_what_is_missing(&mut self) -> Result<()> {
        self.carry_out(Cure::Up)
    }

    /// Starts the missing processes in their slots, as `nims up` and `nims start` do.
    fn up(&mut self) {
        self.robot.supervise(true);
        if !self.robot.planner_lives() {
            self.robot.start_planner(self.parts.planner);
        }
        if !self.robot.motor_io_lives() {
            self.begin_motor_io();
        }
        let in_charge = self.last.map_or([0; 2], |last| last.authority.in_charge);
        for role in [CONTROLLERS, ESTIMATORS] {
            let slot = usize::from(in_charge[role]);
            if !self.robot.slots().lives(role, slot) {
                self.begin(role, slot);
            }
        }
    }
}
