//! Jogging, the length limits, and how a stop, a jog or a motion comes to its end.

use super::{Core, Jog};
use crate::safety::Mode;
use messages::faults::Faults;
use messages::{CABLES, MotorAuthority, MotorState};

/// Longest wait for the last millimetres of a controlled stop, s.
const REST_S: f64 = 1.0;
/// How far a jog may come beyond a length limit before it is a fault: its end was checked, and readings have steps, m.
const JOG_MARGIN_M: f64 = 0.01;
/// What is left of a jog that is done, m: far below a step of an encoder.
const JOGGED_M: f64 = 1e-6;
/// Drives react after up to 0.16 s (delay and lag), and the readings are a cycle old, s.
const REACTION_S: f64 = 0.2;

impl Core {
    pub(super) fn jogging(&mut self) -> [f64; CABLES] {
        if self.who_is_lost() & MotorAuthority::FAULT_SUPERVISOR_LOST != 0 {
            self.safety.note_stop(MotorAuthority::FAULT_SUPERVISOR_LOST);
            self.cancel_jog();
        }
        let mut wanted = [0.0; CABLES];
        if let Some(Jog { cable, left_m, cancelled: false }) = self.jog
            && left_m.abs() >= JOGGED_M
        {
            // Slows down as it comes near, gently: a quarter of what the cable may do.
            let near = (0.5 * self.config.cable_acceleration_m_s2 * left_m.abs()).sqrt();
            let speed = self.config.jog_speed_m_s.min(near).min(left_m.abs() / self.config.period_s);
            wanted[cable] = speed.copysign(left_m);
        }
        wanted
    }

    /// No cable runs beyond its length limits: where one would, the whole robot stops.
    pub(super) fn keep_lengths(&mut self, speed_m_s: &[f64; CABLES]) -> bool {
        let mode = self.safety.mode();
        if !matches!(mode, Mode::Following | Mode::Stopping | Mode::Jogging)
            || self.odometry.position() == MotorState::POSITION_UNKNOWN
        {
            return true;
        }
        let mut found = Faults::default();
        for (i, [low, high]) in self.config.robot.length_limits_m().iter().enumerate() {
            let (length, v) = (self.odometry.length_m(i), speed_m_s[i]);
            let braking = match mode {
                Mode::Jogging => -JOG_MARGIN_M,
                _ => v * v / (2.0 * self.config.cable_acceleration_m_s2) + v.abs() * REACTION_S,
            };
            if (v > 0.0 && length + braking > *high) || (v < 0.0 && length - braking < *low) {
                found.cable(MotorAuthority::FAULT_LENGTH_LIMIT, i);
            }
        }
        if !found.is_empty() && self.safety.found(&found) {
            self.abandon();
        }
        found.is_empty()
    }

    /// After the velocities are fixed: has a stop, a jog or a motion come to its end?
    pub(super) fn settle(&mut self, before: f64, sent: &[f64; CABLES]) {
        let speed = self.limits.last_speed();
        let gentle = speed <= self.limits.step();
        let uncontrolled =
            self.safety.mode() == Mode::Faulted || (self.safety.mode() == Mode::Stopping && self.stop.open);
        if uncontrolled {
            if before > 0.0 {
                self.clock.shrink(speed / before);
            }
            if speed == 0.0 {
                self.clock.stand();
            }
        }
        match self.safety.mode() {
            Mode::Stopping if self.stop.open && speed == 0.0 => self.rest(),
            Mode::Stopping if !self.stop.open && self.clock.rate() == 0.0 => {
                self.stop.waited += 1;
                if gentle || self.stop.waited > self.config.cycles(REST_S) {
                    // What is left of the velocity, at most one step, goes in the next cycle.
                    self.stop.open = true;
                }
            }
            Mode::Following if self.pausing && self.clock.rate() == 0.0 => {
                self.stop.waited += 1;
                if gentle || self.stop.waited > self.config.cycles(REST_S) {
                    self.begin_stop(false, 0);
                    self.stop.open = true;
                }
            }
            Mode::Following if self.clock.rate() == 0.0 && self.settled >= self.config.cycles(self.config.settle_s) => {
                self.stop.waited += 1;
                if gentle || self.stop.waited > self.config.cycles(REST_S) {
                    let short = self.motion.cut_short(self.config.period_s);
                    self.begin_stop(false, if short { MotorAuthority::FAULT_PLANNER_LOST } else { 0 });
                    self.motion.finish(self.clock.time_s());
                    self.stop.open = true;
                }
            }
            Mode::Following if !self.pausing && self.settled == 0 => self.stop.waited = 0,
            Mode::Jogging => {
                let over = self.jog.as_mut().is_none_or(|jog| {
                    jog.left_m -= sent[jog.cable] * self.config.period_s;
                    speed == 0.0 && (jog.cancelled || jog.left_m.abs() < JOGGED_M)
                });
                if over {
                    self.jog = None;
                    self.safety.enter(Mode::Holding);
                }
            }
            _ => {}
        }
    }

    /// At rest after Stopping.
    fn rest(&mut self) {
        self.clock.stand();
        self.pausing = false;
        if self.stop.dropped {
            self.motion.finish(self.clock.time_s());
            self.safety.bump();
        } else {
            self.motion.suspend();
        }
        self.safety.enter(Mode::Holding);
    }
}
