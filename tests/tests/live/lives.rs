//! Lives of motor-io on a running robot: samples that a dead estimator, a dead motor-io or a foreign process left in a
//! channel move nothing and stop nothing.

use crate::robot::{Robot, samples_of, steadily};
use messages::{
    ESTIMATORS, GotoPath, Header, MotorAuthority, MotorSlots, NodeEstimate, Request, SLOTS, Sample, TruthNode,
};
use rustix::process::Signal;
use std::cell::RefCell;
use std::path::Path;

/// Limit of the robot file, m/s, and by how much the node may exceed it because it swings on its cables.
const SPEED_LIMIT_M_S: f64 = 0.4;
const MARGIN: f64 = 1.1;
/// Largest distance of the node from the commanded straight line, m.
const NEAR_M: f64 = 0.03;
const LOGGER: &str = "\n[[process]]\nname = \"sensor-logger\"\ncommand = [\"sensor-logger\", \"--system\", \"{system}\"]\nrestart = true\n";

/// Moves to a height above the start, until the end of the move.
fn fly_to(robot: &mut Robot, z: f64) {
    let before = robot.last.motion;
    robot.ask("planner", Request::Goto { to_m: [4.8, 3.0, z], path: GotoPath::Line, speed_m_s: None });
    robot.until("the motion is taken up", |robot| robot.last.motion != 0 && robot.last.motion != before);
    robot.until("the end of the move", |robot| {
        robot.last.mode == MotorAuthority::MODE_HOLDING && robot.last.motion == 0
    });
}

/// motor-io dies while the robot holds, and restarts.
fn another_life(robot: &mut Robot) {
    let life = robot.last.header.life;
    robot.accepted(&["fault", "kill", "motor-io"]);
    robot.until_reported("motor-io has ended", |robot| robot.row("motor-io").is_some_and(|row| row["state"] == "DIED"));
    robot.accepted(&["start", "motor-io"]);
    robot.until("another life", |robot| robot.last.header.life != life && robot.last.header.cycle > 20);
    robot.accepted(&["arm"]);
    robot.accepted(&["confirm-position"]);
}

/// By truth: down between the two heights, near the straight line, and within the speed limit.
fn goes_down(run: &Path, begun_ns: u64, from_z: f64, to_z: f64) {
    let truth: Vec<TruthNode> = samples_of(run, "truth/node");
    let flown: Vec<&TruthNode> = truth.iter().filter(|sample| sample.header.stamp_ns > begun_ns).collect();
    assert!(flown.len() > 50, "{} samples of the truth", flown.len());
    for sample in &flown {
        let [x, y, z] = sample.position_m;
        let speed = sample.velocity_m_s.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!(speed <= SPEED_LIMIT_M_S * MARGIN, "{speed} m/s");
        assert!((to_z - NEAR_M..=from_z + NEAR_M).contains(&z), "target height {to_z} m, node at {z} m");
        assert!((x - 4.8).abs() < NEAR_M && (y - 3.0).abs() < NEAR_M, "{:?}", sample.position_m);
    }
    assert!((flown.last().unwrap().position_m[2] - to_z).abs() < NEAR_M);
}

fn a_dead_estimator_is_not_believed(restart: bool) {
    let mut robot = Robot::up(LOGGER);
    robot.arm();
    robot.accepted(&["plug", "soil", "--", "my-sensor"]);
    fly_to(&mut robot, 0.8);
    robot.swapped(&["swap", "estimator", "kalman"]);
    fly_to(&mut robot, 0.6);
    another_life(&mut robot);
    if restart {
        robot.accepted(&["restart", "controller"]);
    }
    let samples = RefCell::new(robot.bus.subscriber::<Sample>("sample/soil").unwrap());
    let begun_ns = bus::clock::now_ns();
    fly_to(&mut robot, 0.5);
    robot.until("samples of this life", |_| {
        std::iter::from_fn(|| samples.borrow_mut().receive().unwrap()).any(|sample| sample.header.stamp_ns > begun_ns)
    });
    // A process was killed, which is a failure at the end.
    assert_eq!(robot.down(Signal::INT), Some(1), "{}", robot.printed());
    goes_down(&robot.run(), begun_ns, 0.6, 0.5);
}

#[test]
fn after_another_life_of_motor_io_the_node_goes_where_it_is_told() {
    steadily(|| a_dead_estimator_is_not_believed(true));
}

#[test]
fn controllers_that_outlive_motor_io_follow_the_next_one_at_once() {
    steadily(|| a_dead_estimator_is_not_believed(false));
}

/// Cycle numbers that a foreign process may claim.
const FORGED: [u64; 3] = [1 << 63, u64::MAX, 0];

#[test]
fn a_stranger_on_the_free_slot_does_nothing_to_the_robot_in_flight() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.arm();
        robot.fly();
        let begun = robot.last;
        let mut own = robot.bus.subscriber::<NodeEstimate>("node/estimate/a").unwrap();
        let like = loop {
            if let Some(estimate) = own.latest().unwrap() {
                break estimate;
            }
            robot.for_cycles(1);
        };
        {
            let mut stranger = robot.bus.publisher::<NodeEstimate>("node/estimate/b").unwrap();
            for (i, life) in [begun.header.life, u64::MAX, 0].into_iter().enumerate() {
                for cycle in FORGED {
                    let header = Header { life, cycle, stamp_ns: u64::MAX >> i, ..like.header };
                    let mut forged = NodeEstimate { header, position_m: [1.0; 3], incarnation: 77, ..like };
                    stranger.send(&mut forged).unwrap();
                    robot.for_cycles(10);
                }
            }
        }
        robot.arrive();
        assert_eq!((robot.named, robot.last.in_charge), (0, begun.in_charge));
        assert_ne!(robot.slots.phase[SLOTS * ESTIMATORS + 1], MotorSlots::PHASE_QUALIFIED);
        // The next process in that slot is accepted: forged samples do not block a later, valid sample.
        robot.swapped(&["swap", "estimator", "kalman"]);
        robot.fly();
        robot.arrive();
        assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
    });
}
