//! The borders of obstacles and keep-out boxes, at which a jog ends.
//!
//! The position is motor-io's own, like that by which it judges motions, but also one that has to be confirmed. Without
//! any, a jog is not checked.

use super::Core;
use super::settle::REACTION_S;
use cable_robot::{Border, Held, Robot, Vector3};
use messages::CABLES;

/// Least radius of a path that is computed with, m: about that of a pulley, on which the axis of the path ends.
const LEAST_RADIUS_M: f64 = 0.05;

impl Core {
    /// Returns the body that node or cables would come too close to if a cable, counted from 0, got faster toward
    /// `sign` for a cycle and then came to rest.
    ///
    /// The node is expected where it is at rest with the lengths after this way, under the tensions there.
    pub(crate) fn border(&self, cable: usize, sign: f64) -> Option<Border> {
        let robot = &self.config.robot;
        if robot.keep_out().is_empty() && robot.obstacles().next().is_none() {
            return None;
        }
        // Deceleration of a cable that alone comes to rest, within the limits of cables and node.
        let by_node_m_s2 = self.config.node_acceleration_m_s2 / self.node.way_per_cable(cable)?.max(1e-9);
        let acceleration_m_s2 = self.config.cable_acceleration_m_s2.min(by_node_m_s2);
        let speed_m_s = self.config.jog_speed_m_s.min(self.limits.last_speed() + self.limits.step());
        let braking_m = speed_m_s * speed_m_s / (2.0 * acceleration_m_s2);
        let mut way_m = [0.0; CABLES];
        way_m[cable] = (braking_m + speed_m_s * (REACTION_S + 2.0 * self.config.period_s)).copysign(sign);
        let way = self.node.way(&way_m)?;
        let ((from_m, from_n), (to_m, to_n)) = (&way.from, &way.to);
        let from = Held { position_m: *from_m, tensions_n: from_n };
        let to = Held { position_m: *to_m, tensions_n: to_n };
        robot.approached(&from, &to, bend_m(robot, cable, from_m, to_m))
    }
}

/// Most by which the path of the node bends away from its tangent, and more than from its chord, while one cable moves,
/// m.
///
/// The node stays on the spheres around the other anchors, so on a circle around the line through two of them, or in
/// the plane around one. From the tangent of a circle of the radius ρ it bends away by s² / (2 ρ) within a way s.
pub(super) fn bend_m(robot: &Robot, cable: usize, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let anchors = robot.anchors();
    let others = || anchors.iter().enumerate().filter(|(other, _)| *other != cable);
    let mut radius_m = f64::INFINITY;
    for (i, a) in others() {
        if robot.is_planar() {
            radius_m = radius_m.min((from - a).norm());
        }
        for (_, b) in others().filter(|(j, _)| *j > i && !robot.is_planar()) {
            let (axis, off) = (b - a, from - a);
            // No two anchors are in the same place.
            let along = off.dot(&axis) / axis.norm_squared();
            radius_m = radius_m.min((off - axis * along).norm());
        }
    }
    (to - from).norm_squared() / (2.0 * radius_m.max(LEAST_RADIUS_M))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::{RobotParts, elastic};
    use proptest::prelude::*;

    fn rigid(anchors_m: Vec<[f64; 3]>, planar: bool) -> Robot {
        Robot::new(RobotParts {
            anchors_m,
            planar,
            node_mass_kg: 1.2,
            tension_limits_n: [1.0, 60.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            ..RobotParts::default()
        })
        .unwrap()
    }

    /// The circle of the node around the line through two anchors: the radius around it and a unit vector along it.
    fn circle(a: &Vector3<f64>, b: &Vector3<f64>, from: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let axis = (b - a).normalize();
        let center = a + axis * (from - a).dot(&axis);
        let radius = from - center;
        (center, axis.cross(&radius).normalize() * radius.norm())
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// With rigid cables the node runs on a circle, whatever the cable does: no point of its arc is farther from
        /// the tangent, or from the chord, than the bend.
        #[test]
        fn no_path_bends_more_than_the_bound(
            cable in 0..3usize,
            at in [1.0..8.0f64, 1.0..7.0f64, 0.2..2.9f64],
            turn in -0.5..0.5f64,
        ) {
            let robot = rigid(vec![[0.0, 0.0, 3.0], [9.8, 0.0, 3.1], [4.7, 8.6, 2.9]], false);
            let from = Vector3::from(at);
            let (a, b) = (robot.anchors()[(cable + 1) % 3], robot.anchors()[(cable + 2) % 3]);
            let (center, along) = circle(&a, &b, &from);
            prop_assume!(along.norm() > LEAST_RADIUS_M);
            let on = |angle: f64| center + (from - center) * angle.cos() + along * angle.sin();
            let to = on(turn);
            let bend_m = bend_m(&robot, cable, &from, &to);
            let off_m = |point: Vector3<f64>, way: Vector3<f64>| {
                let way = way.normalize();
                (point - from - way * (point - from).dot(&way)).norm()
            };
            for k in 1..=20 {
                let point = on(turn * f64::from(k) / 20.0);
                prop_assert!(off_m(point, along) <= bend_m + 1e-9, "{bend_m} m");
                prop_assert!(off_m(point, to - from) <= bend_m + 1e-9, "{bend_m} m");
            }
            prop_assert!((off_m(to, along) - bend_m).abs() < 1e-9, "exact at the end: {bend_m} m");
        }
    }

    /// The circle is the path of a node at rest, also where the bend is far more than by the length of its cables.
    #[test]
    fn a_node_at_rest_runs_on_the_circle() {
        let robot = rigid(vec![[0.0, 0.0, 3.0], [9.8, 0.0, 3.1], [4.7, 8.6, 2.9]], false);
        let from = Vector3::new(5.0, 0.4, 2.7);
        let lengths_m: Vec<f64> = robot.anchors().iter().map(|anchor| (from - anchor).norm()).collect();
        let mut moved_m = lengths_m.clone();
        moved_m[2] -= 0.02;
        let found = elastic::equilibrium(&robot, &moved_m, &Vector3::zeros(), Some(&from)).unwrap();
        let (center, _) = circle(&robot.anchors()[0], &robot.anchors()[1], &from);
        let (before, after) = (from - center, found.position - center);
        assert!((before.norm() - after.norm()).abs() < 1e-9);
        let bend_m = bend_m(&robot, 2, &from, &found.position);
        let exact_m = before.norm() - after.dot(&before.normalize());
        assert!((bend_m - exact_m).abs() < 1e-9, "{bend_m} {exact_m}");
        let by_length_m = (found.position - from).norm_squared() / lengths_m.iter().copied().fold(9.0, f64::min);
        assert!(bend_m > 3.0 * by_length_m, "{bend_m} {by_length_m}");
    }

    #[test]
    fn in_the_plane_the_node_runs_around_the_other_anchor() {
        let robot = rigid(vec![[0.0, 0.0, 3.0], [6.0, 0.0, 3.0]], true);
        let (from, to) = (Vector3::new(2.0, 0.0, 1.0), Vector3::new(2.1, 0.0, 1.0));
        let radius_m = (from - robot.anchors()[1]).norm();
        assert!((bend_m(&robot, 0, &from, &to) - 0.01 / (2.0 * radius_m)).abs() < 1e-12);
    }
}
