//! The borders of obstacles and keep-out boxes, at which a jog ends.
//!
//! The position is motor-io's own, like that by which it judges motions. Without a known one, a jog is not checked.

use super::Core;
use super::settle::REACTION_S;
use cable_robot::{Border, Held};
use messages::CABLES;

impl Core {
    /// Returns the body that node or cables would come too close to if a cable, counted from 0, got faster toward
    /// `sign` for a cycle and then came to rest.
    ///
    /// The node is expected on the tangent of its path. What the path bends away from it in a way s is at most s² / L,
    /// with the length L of the shortest cable, on whose sphere the node moves.
    pub(crate) fn border(&self, cable: usize, sign: f64) -> Option<Border> {
        let robot = &self.config.robot;
        if robot.keep_out().is_empty() && robot.obstacles().next().is_none() {
            return None;
        }
        let (from, tensions_n) = self.node.held()?;
        let acceleration_m_s2 = self.braking_m_s2(cable)?;
        let speed_m_s = self.config.jog_speed_m_s.min(self.limits.last_speed() + self.limits.step());
        let braking_m = speed_m_s * speed_m_s / (2.0 * acceleration_m_s2);
        let mut way_m = [0.0; CABLES];
        way_m[cable] = (braking_m + speed_m_s * (REACTION_S + 2.0 * self.config.period_s)).copysign(sign);
        let to = from + self.node.velocity_of(&way_m)?;
        let shortest_m = robot.anchors().iter().map(|anchor| (from - anchor).norm()).fold(f64::INFINITY, f64::min);
        let at = |position_m| Held { position_m, tensions_n };
        robot.approached(&at(from), &at(to), (to - from).norm_squared() / shortest_m.max(1e-3))
    }

    /// Deceleration of a cable that alone comes to rest, within the limits of cables and node, m/s².
    fn braking_m_s2(&self, cable: usize) -> Option<f64> {
        let mut unit = [0.0; CABLES];
        unit[cable] = 1.0;
        let node = self.node.velocity_of(&unit)?.norm();
        let by_node_m_s2 = self.config.node_acceleration_m_s2 / node.max(1e-9);
        Some(self.config.cable_acceleration_m_s2.min(by_node_m_s2))
    }
}
