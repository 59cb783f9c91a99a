//! Steps of a walk: operator requests, and events of processes.

use super::Walk;
use super::astray::Astray;
use anyhow::Result;
use messages::{
    CABLES, CONTROLLERS, ESTIMATORS, Header, MotorCommand, NodeEstimate, ROLES, Request, SLOTS, Slot, SlotRole,
};
use planner::mission::{Leg, Mission, PathShape, Polyline};
use robot_state::Reason;

/// Targets of motions, inside the reach of three and four cables, m.
const LOW_M: [f64; 3] = [4.0, 2.4, 0.3];
const HIGH_M: [f64; 3] = [5.8, 3.9, 1.1];

#[allow(clippy::result_large_err)] // the planner's refusals, passed on unchanged
impl Walk {
    /// Does one step, and runs some cycles after it.
    pub(super) fn step(&mut self) -> Result<()> {
        self.tally.steps += 1;
        match self.random.below(100) {
            0..22 => {
                let cycles = self.random.below(120);
                self.periods(cycles)?;
            }
            22..42 => self.goto_somewhere()?,
            42..45 => self.mission()?,
            45..70 => self.command()?,
            70..78 => self.start_random_process(),
            78..83 => self.end_random_process(),
            83..85 => self.planner_life(),
            85..88 => self.motor_io_life(),
            88..90 => {
                let lives = !self.robot.supervised();
                self.robot.supervise(lives);
                self.record(format!("supervisor lives: {lives}"));
            }
            90..92 => self.make_controller_faulty(),
            _ => self.forge(),
        }
        let cycles = 1 + self.random.below(12);
        self.periods(cycles)
    }

    fn place(&mut self) -> [f64; 3] {
        std::array::from_fn(|i| self.random.between(LOW_M[i], HIGH_M[i]))
    }

    fn goto_somewhere(&mut self) -> Result<()> {
        let to = self.place();
        let speed_m_s = self.random.choose(&[None, Some(0.05), Some(0.2), Some(0.3), Some(0.6)]);
        let shape = self.random.choose(&[PathShape::Line, PathShape::Line, PathShape::Line, PathShape::Parabola]);
        let mu = (shape == PathShape::Parabola).then_some(0.02);
        self.goto(to, speed_m_s, shape, mu).map(|_| ())
    }

    /// Sends a request to the planner; `None` without a planner.
    pub(super) fn goto(
        &mut self,
        to: [f64; 3],
        speed_m_s: Option<f64>,
        shape: PathShape,
        mu_per_m: Option<f64>,
    ) -> Result<Option<std::result::Result<String, String>>> {
        let answer = self.robot.ask_planner(|planner, seen| planner.goto(to, speed_m_s, shape, mu_per_m, seen));
        self.planned(&format!("goto {to:?} {speed_m_s:?} {shape:?}"), answer)
    }

    fn planned(
        &mut self,
        what: &str,
        answer: Option<std::result::Result<Reason, planner::Refusal>>,
    ) -> Result<Option<std::result::Result<String, String>>> {
        let Some(answer) = answer else { return Ok(None) };
        self.record(format!("{what}: {answer:?}"));
        Ok(Some(match answer {
            Ok(reason) => {
                self.tally.motions += 1;
                Ok(reason.to_string())
            }
            // A refusal of an impossible request names where, what and how much.
            Err(refusal) if refusal.is_bad_input() => Err(refusal.to_string()),
            Err(refusal) => Err(self.refusal(refusal.to_string())?),
        }))
    }

    fn mission(&mut self) -> Result<()> {
        let points_m = (0..3).map(|_| self.place().into()).collect();
        let mission = Mission {
            name: "walk".into(),
            speed_m_s: Some(0.2),
            acceleration_m_s2: None,
            path: PathShape::Line,
            time_weight_w: 0.0,
            relative: false,
            leg: vec![Leg::Polyline(Polyline { points_m, speed_m_s: None })],
        };
        let goes_on = self.random.once_in(3);
        let answer = self.robot.ask_planner(|planner, seen| match planner.progress() {
            Some(progress) if goes_on => planner.go_on(&progress.mission.clone(), seen),
            _ => planner.run(&mission, seen),
        });
        self.planned("run", answer).map(|_| ())
    }

    fn command(&mut self) -> Result<()> {
        let request = match self.random.below(30) {
            0..4 => Request::Arm,
            4 if self.random.once_in(2) => Request::Disarm,
            5 => return self.zero().map(|_| ()),
            6..8 if !self.powered_off => Request::ConfirmPosition,
            8..11 => Request::Pause,
            11..15 => Request::Resume,
            15..17 => Request::Stop,
            17 if self.random.once_in(2) => Request::Estop,
            17..21 => Request::Reset,
            21..23 => Request::Jog { cable: self.random.below(6) as u8, distance_m: self.random.between(-0.04, 0.04) },
            23 => Request::Speed { rate: self.random.choose(&[0.1, 0.5, 1.0, 1.0, 1.5]) },
            24 => Request::Admit { role: self.random.choose(&SlotRole::ALL), slot: self.random.choose(&Slot::ALL) },
            _ => Request::Swap { role: self.random.choose(&SlotRole::ALL), slot: self.random.choose(&Slot::ALL) },
        };
        self.ask(request).map(|_| ())
    }

    fn start_random_process(&mut self) {
        let (role, slot) = (self.random.below(ROLES), self.random.below(SLOTS));
        self.begin(role, slot);
    }

    /// Starts a process of a role in a slot, in place of an earlier one.
    pub(super) fn begin(&mut self, role: usize, slot: usize) {
        if role == CONTROLLERS {
            let law = self.random.below(self.parts.laws.len());
            let config = controller::ControllerConfig { law: self.parts.laws[law], ..self.parts.controller };
            self.robot.slots_mut().start_controller(slot, &config);
            self.astray[slot] = None;
            self.record(format!("controller {slot} starts with law {law}"));
        } else {
            let method = self.random.below(self.parts.methods.len());
            let config = self.parts.estimator;
            self.robot.slots_mut().start_estimator(slot, &config, self.parts.methods[method]);
            self.record(format!("estimator {slot} starts with method {method}"));
        }
    }

    /// Makes the controller in a slot faulty until its restart.
    fn make_controller_faulty(&mut self) {
        let slot = self.random.below(SLOTS);
        if !self.robot.slots().lives(CONTROLLERS, slot) {
            return;
        }
        let astray = Astray::by_chance(&mut self.random, self.robot.plant().cable_count() > 3);
        self.tally.astray += 1;
        self.record(format!("controller {slot} becomes faulty: {astray:?}"));
        self.astray[slot] = Some(astray);
    }

    fn end_random_process(&mut self) {
        let (role, slot, unheard) = (self.random.below(ROLES), self.random.below(SLOTS), self.random.once_in(2));
        self.robot.slots_mut().kill(role, slot, unheard);
        self.record(format!("role {role} slot {slot} dies, unheard {unheard}"));
    }

    fn planner_life(&mut self) {
        if self.robot.planner_lives() && self.random.once_in(2) {
            self.robot.kill_planner();
        } else {
            self.robot.start_planner(self.parts.planner);
        }
        self.record(format!("planner lives: {}", self.robot.planner_lives()));
    }

    fn motor_io_life(&mut self) {
        if self.robot.motor_io_lives() {
            self.robot.kill_motor_io();
            self.record("motor-io dies".into());
            if self.random.once_in(3) {
                return;
            }
        }
        self.begin_motor_io();
    }

    /// Starts a new life of motor-io, with or without a stored position, and with or without drives that had power.
    pub(super) fn begin_motor_io(&mut self) {
        let (restored, alive) = (!self.random.once_in(4), !self.random.once_in(4));
        self.powered_off |= !alive;
        self.robot.start_motor_io(self.parts.core.clone(), restored, alive);
        self.tally.lives += 1;
        self.last = None;
        self.checks.begin();
        self.record(format!("motor-io starts, restored {restored}, alive {alive}"));
    }

    /// Publishes a sample from outside the robot's processes, on a free slot.
    fn forge(&mut self) {
        let Some(last) = self.last else { return };
        let (role, slot) = (self.random.below(ROLES), self.random.below(SLOTS));
        let in_charge = usize::from(last.authority.in_charge[role]);
        if slot == in_charge || self.robot.slots().lives(role, slot) {
            return;
        }
        self.tally.forged += 1;
        let header = self.forged_header(&last.authority.header);
        if role == ESTIMATORS {
            let mut estimate = NodeEstimate { header, ..last.estimate };
            estimate.valid = self.random.choose(&[0, 1, 1, 1, 2]);
            estimate.incarnation = self.random.choose(&[0, 1, u32::MAX]);
            if self.random.once_in(2) {
                estimate.position_m = std::array::from_fn(|_| self.random.choose(&[f64::NAN, 1e300, -3.0, 0.0, 4.8]));
            }
            self.record(format!("forged estimate in slot {slot}: {header:?} {:?}", estimate.position_m));
            self.robot.slots_mut().forge_estimate(slot, estimate);
        } else {
            let mut command = MotorCommand { header, ..last.command };
            command.based_on_cycle = header.cycle;
            command.epoch = last.authority.epoch;
            command.incarnation = self.random.choose(&[0, 1, u32::MAX]);
            command.valid = [self.random.choose(&[0, 1, 2]); SLOTS];
            for velocity in command.velocity_m_s.iter_mut().take(SLOTS * CABLES) {
                *velocity = self.random.choose(&[f64::NAN, f64::INFINITY, 0.5, -0.5, 0.0]);
            }
            self.record(format!("forged command in slot {slot}: {header:?}"));
            self.robot.slots_mut().forge_command(slot, command);
        }
    }

    fn forged_header(&mut self, now: &Header) -> Header {
        let life =
            self.random.choose(&[now.life, now.life, now.life, now.life.wrapping_sub(1), now.life + 1, u64::MAX, 0]);
        let cycle = self.random.choose(&[now.cycle, now.cycle + 1, now.cycle + 3, now.cycle + 4, 1 << 63, u64::MAX, 0]);
        let stamp_ns = self.random.choose(&[now.stamp_ns, now.stamp_ns + 10_000_000, 0, u64::MAX]);
        Header { life, cycle, stamp_ns, oldest_input_ns: stamp_ns, ..*now }
    }
}
