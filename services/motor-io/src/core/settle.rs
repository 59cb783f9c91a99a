//! Jogging, the length limits, and the end of a stop, a jog or a motion.

use super::Core;
use super::follow::LATE_S;
use crate::mode::{Braking, Following, Jog, Mode, Stop};
use messages::faults::Faults;
use messages::{CABLES, MotorAuthority, MotorState};

/// Longest wait for the last millimetres of a controlled stop, s.
const REST_S: f64 = 1.0;
/// Excess over a length limit that a jog may have before it is a fault, m. Its end was checked, and
/// readings have steps.
const JOG_MARGIN_M: f64 = 0.01;
/// Remaining length at which a jog is done, m: far below a step of an encoder.
const JOGGED_M: f64 = 1e-6;
/// Delay from a command to its effect, s: drives react after up to 0.16 s, and readings are a cycle old.
pub(super) const REACTION_S: f64 = 0.2;

impl Core {
    pub(super) fn jogging(&mut self, mut jog: Jog) -> [f64; CABLES] {
        if self.who_is_lost() & MotorAuthority::FAULT_SUPERVISOR_LOST != 0 {
            self.safety.record_stop(MotorAuthority::FAULT_SUPERVISOR_LOST);
            jog.cancelled = true;
            self.safety.enter(Mode::Jogging(jog));
        }
        if !jog.cancelled && self.watch.late() > self.config.cycles(LATE_S) {
            // Lengths and borders are those of the last reading.
            self.safety.record_stop(MotorAuthority::FAULT_LONG_GAP);
            jog.cancelled = true;
            self.safety.enter(Mode::Jogging(jog));
        }
        if !jog.cancelled && self.border(jog.cable, jog.left_m).is_some() {
            self.safety.record_stop(MotorAuthority::FAULT_BORDER);
            jog.cancelled = true;
            self.safety.enter(Mode::Jogging(jog));
        }
        let Jog { cable, left_m, cancelled } = jog;
        let mut wanted = [0.0; CABLES];
        if !cancelled && left_m.abs() >= JOGGED_M {
            // Brakes with a quarter of the cable's acceleration limit.
            let near = (0.5 * self.config.cable_acceleration_m_s2 * left_m.abs()).sqrt();
            let speed = self.config.jog_speed_m_s.min(near).min(left_m.abs() / self.config.period_s);
            wanted[cable] = speed.copysign(left_m);
        }
        wanted
    }

    /// Returns false, with a fault, if a cable would run beyond its length limits.
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

    /// Ends a stop, a jog or a motion, once the velocities are fixed. `before_m_s` is the largest velocity of
    /// the previous cycle.
    pub(super) fn settle(&mut self, before_m_s: f64, sent_m_s: &[f64; CABLES]) {
        let speed_m_s = self.limits.last_speed();
        let mode = *self.safety.mode();
        if matches!(mode, Mode::Faulted | Mode::Stopping(Stop { braking: Braking::Open, .. })) {
            if before_m_s > 0.0 {
                self.clock.shrink(speed_m_s / before_m_s);
            }
            if speed_m_s == 0.0 {
                self.clock.stop_at_once();
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

    /// Ends the motion, or pauses it.
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
                    // The remaining velocity, at most one step, goes in the next cycle.
                    stop.braking = Braking::Open;
                }
            }
            _ => {}
        }
        self.safety.enter(Mode::Stopping(stop));
    }

    /// Returns true at standstill of the plan clock if the remaining velocity is at most one step, or the
    /// wait was too long.
    fn may_rest(&self, waited: u32) -> bool {
        self.limits.last_speed() <= self.limits.step() || waited > self.config.cycles(REST_S)
    }

    /// Enters Holding after Stopping.
    fn rest(&mut self, dropped: bool) {
        debug_assert!(self.limits.last_speed() == 0.0, "the robot holds before it is at rest");
        self.clock.stop_at_once();
        if dropped {
            self.motion.finish(self.clock.time_s());
            self.safety.start_epoch();
        }
        self.safety.enter(Mode::Holding);
    }
}
