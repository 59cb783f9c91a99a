//! Moves of the robot, and where its node is.

use super::{GOAL, Robot, START};
use messages::{GotoPath, MotorAuthority, Request};

/// Faults of a robot whose machine delays the control chain for some cycles.
const STARVED: u32 = MotorAuthority::FAULT_COMMAND_LOST
    | MotorAuthority::FAULT_ESTIMATE_LOST
    | MotorAuthority::FAULT_LONG_GAP
    | MotorAuthority::FAULT_COMPUTER;

/// A straight move at that speed, m/s.
pub fn goto(to_m: [f64; 3], speed_m_s: f64) -> Request {
    Request::Goto { to_m, path: GotoPath::Line, speed_m_s: Some(speed_m_s) }
}

impl Robot {
    /// Starts a move of some seconds, there or back. If the machine stood still meanwhile and the robot stopped for it,
    /// the move starts again.
    pub fn fly(&mut self) {
        self.fly_at(0.12);
    }

    /// The same at that speed, m/s.
    pub fn fly_at(&mut self, speed_m_s: f64) {
        for _ in 0..5 {
            // Discards the rest of a move; without one the request is refused, which has the same effect.
            self.request("motor-io", &Request::Stop).unwrap();
            self.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
            // Wherever an earlier move was interrupted, the farther end is a move away.
            self.goal = if self.distance_m(START) < self.distance_m(GOAL) { GOAL } else { START };
            self.ask("planner", goto(self.goal, speed_m_s));
            self.until("the motion", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
            let cycle = self.last.header.cycle + 100;
            self.until("a second of it", |robot| robot.last.header.cycle > cycle);
            if (self.last.mode, self.last.faults) == (MotorAuthority::MODE_FOLLOWING, 0) {
                self.named = 0;
                return;
            }
        }
        panic!("this machine does not let the robot fly for a second: {:#x}", self.last.faults);
    }

    /// Waits for the end of the move. If the machine starved the robot and it stopped for that, requests a resume.
    pub fn arrive(&mut self) {
        for _ in 0..5 {
            self.until("the end of the move", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
            if self.last.faults & STARVED == 0 {
                return;
            }
            self.ask("motor-io", Request::Resume);
            self.until("it continues", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
        }
        panic!("this machine does not let the robot end its move: {:#x}", self.last.faults);
    }

    /// Polls, and requests a resume if the machine starved the robot and it stopped for that.
    pub fn keep_flying(&mut self) {
        self.poll();
        if self.last.mode == MotorAuthority::MODE_HOLDING && self.last.faults & STARVED != 0 {
            self.ask("motor-io", Request::Resume);
        }
    }

    /// Armed, at a known position.
    pub fn arm(&mut self) {
        self.ask("motor-io", Request::Arm);
        self.ask("motor-io", Request::ZeroAt { position_m: START });
    }

    /// Runs for so many cycles.
    pub fn for_cycles(&mut self, cycles: u64) {
        self.poll();
        let last = self.last.header.cycle + cycles;
        self.until("some cycles", |robot| robot.last.header.cycle >= last);
    }

    /// Speed of the node, m/s, by the truth.
    pub fn speed_m_s(&self) -> f64 {
        self.seen.velocity_m_s.iter().map(|value| value * value).sum::<f64>().sqrt()
    }

    /// Distance of the node from that point, m, by the truth.
    pub fn distance_m(&self, from: [f64; 3]) -> f64 {
        self.seen.position_m.iter().zip(from).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    }

    /// Returns the robot to holding at a known position.
    pub fn reset(&mut self) {
        self.ask("motor-io", Request::Reset);
        self.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING && robot.last.faults == 0);
        if self.last.position_known == messages::MotorState::POSITION_RESTORED {
            self.ask("motor-io", Request::ConfirmPosition);
        }
    }
}
