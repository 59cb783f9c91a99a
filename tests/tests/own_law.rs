//! A law of one's own, in its own program, flies by configuration alone: the template, compiled beside the others.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod live;

use live::Robot;
use messages::{ControlStatus, MotorAuthority, OperatorRequest};

/// How far the node swings on its lines after a stop, m.
const SWING_M: f64 = 0.01;

#[test]
fn a_law_of_ones_own_flies_by_configuration_alone() {
    let mut robot = Robot::up("\n[[process]]\nname = \"my-law\"\nrole = \"controller\"\ncommand = [\"my-law\"]\n");
    let mut statuses = robot.bus.subscriber::<ControlStatus>("control/status/a").unwrap();
    robot.ask("motor-io", OperatorRequest::VERB_ARM, &[]);
    robot.ask("motor-io", OperatorRequest::VERB_ZERO_AT, &[4.8, 3.0, 0.3]);
    robot.fly();
    let status = statuses.latest().unwrap().unwrap();
    assert_eq!((status.law, status.valid), (ControlStatus::LAW_OTHER, 1));
    robot.until("the end of the motion", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    assert_eq!(robot.last.faults & motor_io::faults::HARD, 0, "{:#x}", robot.last.faults);
    if robot.last.faults == 0 {
        let goal = if robot.there { [5.4, 3.6, 0.7] } else { [4.8, 3.0, 0.3] };
        let settled = robot.last.header.cycle + 50;
        robot.until("rest", |robot| robot.last.header.cycle > settled);
        let mut last = None;
        while let Some(truth) = robot.truth.receive().unwrap() {
            last = Some(truth);
        }
        let off: f64 = last.unwrap().position_m.iter().zip(goal).map(|(is, to)| (is - to) * (is - to)).sum();
        assert!(off.sqrt() < SWING_M, "{} m from the goal", off.sqrt());
    }
}
