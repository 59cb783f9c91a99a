//! The robot, its state and the missions of these tests.

use cable_robot::{Distribution, Robot, RobotParts, Segment};
use messages::{Header, MotorAuthority, MotorState, NodeEstimate, PlanMotion};
use planner::mission::Mission;
use planner::plan::SHORTEST_S;
use planner::{Inputs, PlannerConfig};
use proptest::prelude::*;

pub const SECOND_NS: u64 = 1_000_000_000;

pub fn parts() -> RobotParts {
    RobotParts {
        anchors_m: vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
        node_mass_kg: 1.2,
        tension_limits_n: [2.0, 60.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        keep_out_m: vec![[[6.5, 1.0, 0.0], [7.0, 1.5, 1.0]]],
        ..RobotParts::default()
    }
}

pub fn config() -> PlannerConfig {
    config_of(parts())
}

pub fn config_of(parts: RobotParts) -> PlannerConfig {
    PlannerConfig {
        robot: Robot::new(parts).unwrap(),
        distribution: Distribution::Unique,
        speed_m_s: 0.2,
        acceleration_m_s2: 0.3,
        check_step_m: 0.02,
        swing_limit_m: 0.005,
    }
}

/// A robot that holds, ready for a mission, at a plan time.
pub struct World {
    pub authority: MotorAuthority,
    pub estimate: NodeEstimate,
}

impl World {
    pub fn ready() -> Self {
        let header = Header { cycle: 1000, seq: 1000, ..Header::at(10 * SECOND_NS) };
        let authority = MotorAuthority {
            header,
            plan_time_s: 3.5,
            period_s: 0.01,
            epoch: 6,
            mode: MotorAuthority::MODE_HOLDING,
            position_known: MotorState::POSITION_KNOWN,
            cable_count: 3,
            ..MotorAuthority::default()
        };
        let estimate =
            NodeEstimate { header, position_m: [4.8, 3.0, 0.3], valid: 1, cable_count: 3, ..NodeEstimate::default() };
        Self { authority, estimate }
    }

    pub fn seen(&self) -> Inputs<'_> {
        let now_ns = self.authority.header.stamp_ns + 1_000_000;
        Inputs { now_ns, authority: Some(&self.authority), estimate: Some(&self.estimate), map: None }
    }

    /// motor-io follows the motion, at a plan time.
    pub fn follow(&mut self, motion: &PlanMotion, plan_time_s: f64) {
        self.authority.mode = MotorAuthority::MODE_FOLLOWING;
        self.authority.motion = motion.motion;
        (self.authority.plan_rate, self.authority.plan_rate_target) = (1.0, 1.0);
        self.pass(plan_time_s - self.authority.plan_time_s);
        self.authority.plan_time_s = plan_time_s;
    }

    pub fn pass(&mut self, seconds: f64) {
        self.authority.header.stamp_ns += (seconds.max(0.0) * 1e9) as u64;
    }
}

pub fn mission(text: &str) -> Mission {
    Mission::parse(&format!("name = \"test\"\n{text}")).unwrap()
}

pub fn three_lines() -> Mission {
    mission(
        "[[leg]]\npolyline = { points_m = [[5.2, 3.0, 0.3], [5.2, 3.4, 0.5]] }\n[[leg]]\nline = { to_m = [4.8, 3.0, 0.4] }\n",
    )
}

/// Contiguous, at rest at every border, none too short, and every one passes the check.
pub fn sound(segments: &[Segment], config: &PlannerConfig) -> Result<(), TestCaseError> {
    for segment in segments {
        let check = segment.check(&config.robot, config.distribution, config.check_step_m);
        prop_assert!(check.is_ok(), "{check:?}");
        prop_assert!(segment.profile.duration() >= SHORTEST_S * (1.0 - 1e-9));
    }
    for pair in segments.windows(2) {
        let [before, after] = pair else { unreachable!() };
        prop_assert!((before.path.end() - after.path.start()).norm() < 1e-9);
        prop_assert!((before.end_s() - after.start_s).abs() < 1e-9);
        prop_assert!(before.id + 1 == after.id);
        let (end, start) = (before.setpoint(before.end_s()), after.setpoint(after.start_s));
        prop_assert!((end.position - start.position).norm() < 1e-9);
        prop_assert!(end.velocity.norm() < 1e-6 && start.velocity.norm() < 1e-6);
    }
    Ok(())
}
