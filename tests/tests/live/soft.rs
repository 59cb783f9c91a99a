//! Soft mode with all processes and virtual moteus units: the robot flies, yields, holds, and flies again.

use crate::robot::{GOAL, Robot, START, goto, steadily};
use messages::{MotorAuthority, MotorState, Request};
use robot_state::answers::Reason;

/// Winches that can be driven back, on units that take torque.
const LED: &str = "led4";
/// Time hands off, in control cycles.
const HANDS_OFF: u64 = 500;
/// Speed at which the node may sink, m/s.
const SINK_M_S: f64 = 0.05;
/// Way by which it may settle, m.
const SETTLES_M: f64 = 0.03;
/// Largest distance from the target of a move, m.
const THERE_M: f64 = 0.02;

/// Flies to a place and arrives there.
fn flies(robot: &mut Robot, to_m: [f64; 3]) {
    robot.ask("planner", goto(to_m, 0.15));
    robot.until("the motion", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
    robot.arrive();
    assert!(robot.distance_m(to_m) < THERE_M, "{} m off", robot.distance_m(to_m));
}

#[test]
fn a_node_that_was_let_go_stays_and_the_robot_flies_from_there() {
    steadily(|| {
        let mut robot = Robot::up_with(LED, "", |_| ());
        robot.arm();
        flies(&mut robot, GOAL);
        // Only once the drives' loops hold the node at rest.
        robot.ask("motor-io", Request::Soft);
        robot.until("soft", |robot| robot.last.mode == MotorAuthority::MODE_SOFT);
        let from_m = robot.seen.position_m;
        let until = robot.last.header.cycle + HANDS_OFF;
        let (mut sinks_m_s, mut moved_m) = (0.0_f64, 0.0_f64);
        while robot.last.header.cycle < until {
            robot.for_cycles(1);
            assert_eq!((robot.last.mode, robot.last.faults), (MotorAuthority::MODE_SOFT, 0));
            sinks_m_s = sinks_m_s.max(-robot.seen.velocity_m_s[2]);
            moved_m = moved_m.max(robot.distance_m(from_m));
        }
        println!("hands off: sinks at {:.1} mm/s, moved by {:.1} mm at most", 1e3 * sinks_m_s, 1e3 * moved_m);
        assert!(sinks_m_s <= SINK_M_S && moved_m <= SETTLES_M);

        assert_eq!(robot.rejected(&["disarm"]), Reason::NotDisarmedMoving);
        assert_eq!(robot.reason("planner", &goto(START, 0.15)), Some(Reason::RobotSoft));
        robot.poll();
        assert_eq!(robot.last.mode, MotorAuthority::MODE_SOFT, "a refusal changes nothing");

        robot.ask("motor-io", Request::Hold);
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        assert_eq!((robot.last.faults, robot.last.position_known), (0, MotorState::POSITION_KNOWN));
        flies(&mut robot, START);
    });
}
