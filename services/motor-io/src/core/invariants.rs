//! What holds after each half of a cycle, whatever the input. Checked in development builds and tests only.

use super::Core;
use crate::limits::largest;
use crate::mode::Mode;

/// Rounding of a scaled velocity, m/s.
const ROUNDING_M_S: f64 = 1e-9;

/// State at the beginning of a cycle, for comparison.
#[derive(Debug, Clone, Copy)]
pub(super) struct Before {
    epoch: u32,
    plan_time_s: f64,
}

impl Core {
    pub(super) fn before(&self) -> Before {
        Before { epoch: self.safety.epoch(), plan_time_s: self.clock.time_s() }
    }

    /// After the first half. `before_m_s`: the largest cable velocity of the cycle before.
    pub(super) fn check_decision(&self, before: &Before, before_m_s: f64) {
        let (mode, sent) = (self.safety.mode(), &self.sent);
        let fastest_m_s = largest(&sent.speed_m_s);
        debug_assert!(sent.speed_m_s.iter().all(|v| v.is_finite()), "a velocity is not finite: {sent:?}");
        debug_assert!(
            fastest_m_s <= self.config.cable_speed_m_s + ROUNDING_M_S,
            "{fastest_m_s} m/s are beyond the limit of a cable"
        );
        debug_assert!(
            sent.speed_m_s[self.config.cable_count()..].iter().all(|v| *v == 0.0),
            "a cable that the robot does not have moves: {sent:?}"
        );
        debug_assert!(
            !matches!(mode, Mode::Disarmed | Mode::EmergencyStop | Mode::Holding) || sent.is_hold(),
            "the robot moves in {mode:?}: {sent:?}"
        );
        debug_assert!(
            matches!(mode, Mode::Soft(_)) == sent.current_a.is_some()
                && sent.current_a.is_none_or(|current_a| current_a.iter().all(|a| a.is_finite())),
            "currents in {mode:?}: {sent:?}"
        );
        debug_assert!(
            *mode != Mode::Faulted || fastest_m_s <= before_m_s + ROUNDING_M_S,
            "a robot with a fault gets faster: from {before_m_s} to {fastest_m_s} m/s"
        );
        debug_assert!(
            !self.decision.fresh || mode.on_motion(),
            "a controller's command is used in {mode:?}, without a motion"
        );
        self.check_state(before);
    }

    /// After either half.
    pub(super) fn check_state(&self, before: &Before) {
        let (mode, epoch) = (self.safety.mode(), self.safety.epoch());
        debug_assert!(
            epoch >= before.epoch || before.epoch == u32::MAX,
            "the epoch went back from {} to {epoch}",
            before.epoch
        );
        debug_assert!(
            self.clock.time_s() >= before.plan_time_s,
            "the plan clock went back from {} to {} s",
            before.plan_time_s,
            self.clock.time_s()
        );
        debug_assert!(self.safety.energised() || !(mode.moves() || *mode == Mode::Holding), "{mode:?} without power");
        debug_assert!(!self.safety.energised() || *mode != Mode::Disarmed, "the drives are on in {mode:?}");
        debug_assert!(
            self.motion.id() == 0 || mode.on_motion() || *mode == Mode::Holding,
            "a motion is kept in {mode:?}"
        );
        debug_assert!(!matches!(mode, Mode::Following(_)) || self.motion.id() != 0, "no motion to follow");
    }
}
