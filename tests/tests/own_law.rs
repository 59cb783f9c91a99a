//! A law of one's own, in its own program, flies by configuration alone: the template, compiled beside the others.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod live;

use live::{GOAL, Robot, START, steadily};
use messages::ControlStatus;

/// How far the node swings on its lines after a stop, m.
const SWING_M: f64 = 0.01;

#[test]
fn a_law_of_ones_own_flies_by_configuration_alone() {
    steadily(|| {
        let mut robot = Robot::up("\n[[process]]\nname = \"my-law\"\nrole = \"controller\"\ncommand = [\"my-law\"]\n");
        let mut statuses = robot.bus.subscriber::<ControlStatus>("control/status/a").unwrap();
        robot.arm();
        robot.fly();
        let status = statuses.latest().unwrap().unwrap();
        assert_eq!((status.law, status.valid), (ControlStatus::LAW_OTHER, 1));
        robot.arrive();
        robot.for_cycles(50);
        let off_m = robot.distance_m(if robot.there { GOAL } else { START });
        assert!(off_m < SWING_M, "{off_m} m from the goal");
    });
}
