//! Checks by motor-io's own lengths: the node's speed and acceleration, where a motion begins, and whether commands
//! lead to the setpoint.
//!
//! They use motor-io's own lengths and the setpoint in its input. Without a known position only the limits
//! of the cables apply.

use super::Core;
use crate::limits::NodeLimit;
use cable_robot::Vector3;
use messages::faults::Faults;
use messages::{CABLES, MotorAuthority, MotorInput};

/// Growth of a distance below which it counts as constant, because encoders have steps, m/s.
const GROWS_M_S: f64 = 0.001;

impl Core {
    /// Bounds on the node's speed and acceleration in this cycle.
    pub(super) fn node_limit(&self) -> Option<NodeLimit<'_>> {
        Some(NodeLimit {
            sensitivity: self.node.sensitivity()?,
            speed_m_s: self.config.node_speed_m_s(),
            step_m_s: self.config.node_acceleration_m_s2 * self.config.period_s,
        })
    }

    /// Setpoint at the present plan time, and its velocity at the present rate; `None` unless a controller steers.
    fn setpoint(&self, input: &MotorInput) -> Option<(Vector3<f64>, Vector3<f64>)> {
        if self.safety.mode().steering().is_none() || input.setpoint_known == 0 {
            return None;
        }
        let (position, velocity) = (Vector3::from(input.setpoint_m), Vector3::from(input.setpoint_velocity_m_s));
        let finite = position.iter().chain(velocity.iter()).all(|x| x.is_finite());
        finite.then_some((position, velocity * self.clock.rate()))
    }

    /// Limits the controller's correction to the setpoint's own velocity.
    pub(super) fn keep_correction(&self, input: &MotorInput, wanted: [f64; CABLES]) -> [f64; CABLES] {
        let Some((_, planned_m_s)) = self.setpoint(input) else { return wanted };
        let (Some(node_m_s), Some(base)) = (self.node.velocity_of(&wanted), self.node.cables_for(&planned_m_s)) else {
            return wanted;
        };
        let correction_m_s = (node_m_s - planned_m_s).norm();
        if correction_m_s <= self.config.correction_limit_m_s {
            return wanted;
        }
        let share = self.config.correction_limit_m_s / correction_m_s;
        std::array::from_fn(|i| base[i] + share * (wanted[i] - base[i]))
    }

    /// Returns false, with a fault, if commands have moved the node away from a distant setpoint for too long.
    pub(super) fn judge(&mut self, input: &MotorInput, wanted: &[f64; CABLES]) -> bool {
        let away = self.setpoint(input).zip(self.node.position_m()).zip(self.node.velocity_of(wanted));
        let grows = away.is_some_and(|(((setpoint_m, planned_m_s), node_m), node_m_s)| {
            let off = node_m - setpoint_m;
            let distance_m = off.norm();
            distance_m > self.config.divergence_m && off.dot(&(node_m_s - planned_m_s)) > GROWS_M_S * distance_m
        });
        // A cycle without readings shows nothing.
        let Some(steering) = self.safety.mode_mut().steering_mut() else { return true };
        if !self.unit_trouble {
            steering.diverging = if grows { steering.diverging.saturating_add(1) } else { 0 };
        }
        if steering.diverging < self.config.cycles(self.config.divergence_s) {
            return true;
        }
        let mut found = Faults::default();
        found.robot(MotorAuthority::FAULT_DIVERGING);
        if self.safety.found(&found) {
            self.abandon();
        }
        false
    }

    /// Returns true if the offered motion begins where the node is. Otherwise the authority shows the reason.
    pub(crate) fn begins_here(&mut self, input: &MotorInput) -> bool {
        let Some(node_m) = self.node.position_m().filter(|_| input.motion_start_known == 1) else { return true };
        let off_m = (Vector3::from(input.motion_start_m) - node_m).norm();
        // False for NaN.
        let here = off_m <= self.config.start_bound_m;
        if !here {
            self.safety.record_stop(MotorAuthority::FAULT_OFF_START);
        }
        here
    }

    /// Distance from the node to the setpoint, m; `None` without one.
    pub(crate) fn setpoint_distance_m(&self, input: &MotorInput) -> Option<f64> {
        let node_m = self.node.position_m().filter(|_| input.setpoint_known == 1)?;
        Some((Vector3::from(input.setpoint_m) - node_m).norm())
    }
}
