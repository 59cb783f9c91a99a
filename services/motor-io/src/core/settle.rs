//! Jogging, the length limits, and how a stop, a jog or a motion comes to its end.

use super::Core;
use crate::mode::{Braking, Following, Jog, Mode, Stop};
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
    pub(super) fn jogging(&mut self, mut jog: Jog) -> [f64; CABLES] {
        if self.who_is_lost() & MotorAuthority::FAULT_SUPERVISOR_LOST != 0 {
            self.safety.note_stop(MotorAuthority::FAULT_SUPERVISOR_LOST);
            jog.cancelled = true;
            self.safety.enter(Mode::Jogging(jog));
        }
        let Jog { cable, left_m, cancelled } = jog;
        let mut wanted = [0.0; CABLES];
        if !cancelled && left_m.abs() >= JOGGED_M {
            // Slows down as it comes near, gently: a quarter of what the cable may do.
            let near = (0.5 * self.config.cable_acceleration_m_s2 * left_m.abs()).sqrt();
            let speed = self.config.jog_speed_m_s.min(near).min(left_m.abs() / self.config.period_s);
            wanted[cable] = speed.copysign(left_m);
        }
        wanted
    }

    /// No cable runs beyond its length limits: where one would, the whole robot stops.
    pub(super) fn keep_lengths(&mut self, speed_m_s: &[f64; CABLES]) -> bool {
        if !self.safety.mode().moves() || self.odometry.position() == MotorState::POSITION_UNKNOWN {
            return true;
        }
        let jogging = matches!(self.safety.mode(), Mode::Jogging(_));
        let mut found = Faults::default();
        for (i, [low, high]) in self.config.robot.length_limits_m().iter().enumerate() {
            let (length, v) = (self.odometry.length_m(i), speed_m_s[i]);
            let braking = if jogging {
                -JOG_MARGIN_M
            } else {
                v * v / (2.0 * self.config.cable_acceleration_m_s2) + v.abs() * REACTION_S
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

    /// After the velocities are fixed: has a stop, a jog or a motion come to its end? `before_m_s` is the largest one of the
    /// cycle before.
    pub(super) fn settle(&mut self, before_m_s: f64, sent_m_s: &[f64; CABLES]) {
        let speed_m_s = self.limits.last_speed();
        let mode = *self.safety.mode();
        if matches!(mode, Mode::Faulted | Mode::Stopping(Stop { braking: Braking::Open, .. })) {
            if before_m_s > 0.0 {
                self.clock.shrink(speed_m_s / before_m_s);
            }
            if speed_m_s == 0.0 {
                self.clock.stand();
            }
        }
        match mode {
            Mode::Jogging(jog) => self.settle_jog(jog, sent_m_s),
            Mode::Following(following) => self.settle_motion(following),
            Mode::Stopping(stop) => self.settle_stop(stop),
            _ => {}
        }
    }

    fn settle_jog(&mut self, mut jog: Jog, sent_m_s: &[f64; CABLES]) {
        jog.left_m -= sent_m_s[jog.cable] * self.config.period_s;
        let over = self.limits.last_speed() == 0.0 && (jog.cancelled || jog.left_m.abs() < JOGGED_M);
        self.safety.enter(if over { Mode::Holding } else { Mode::Jogging(jog) });
    }

    /// A pause, or the end of the motion.
    fn settle_motion(&mut self, mut state: Following) {
        let at_end = state.settled >= self.config.cycles(self.config.settle_s);
        if self.clock.rate() == 0.0 && (state.pausing || at_end) {
            state.waited += 1;
            if self.may_rest(state.waited) {
                let short = !state.pausing && self.motion.cut_short(self.config.period_s);
                self.begin_stop(Stop::open(), if short { MotorAuthority::FAULT_PLANNER_LOST } else { 0 });
                if !state.pausing {
                    self.motion.finish(self.clock.time_s());
                }
                return;
            }
        } else if !state.pausing && state.settled == 0 {
            state.waited = 0;
        }
        self.safety.enter(Mode::Following(state));
    }

    fn settle_stop(&mut self, mut stop: Stop) {
        match &mut stop.braking {
            Braking::Open if self.limits.last_speed() == 0.0 => return self.rest(stop.dropped),
            Braking::OnPath { waited, .. } if self.clock.rate() == 0.0 => {
                *waited += 1;
                if self.may_rest(*waited) {
                    // What is left of the velocity, at most one step, goes in the next cycle.
                    stop.braking = Braking::Open;
                }
            }
            _ => {}
        }
        self.safety.enter(Mode::Stopping(stop));
    }

    /// With the plan clock at standstill: true if what is left of the velocity goes in one step, or was awaited long enough.
    fn may_rest(&self, waited: u32) -> bool {
        self.limits.last_speed() <= self.limits.step() || waited > self.config.cycles(REST_S)
    }

    /// At rest after Stopping.
    fn rest(&mut self, dropped: bool) {
        self.clock.stand();
        if dropped {
            self.motion.finish(self.clock.time_s());
            self.safety.bump();
        }
        self.safety.enter(Mode::Holding);
    }
}
