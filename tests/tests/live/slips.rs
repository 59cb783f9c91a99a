//! Cables with two encoders, with all processes and virtual moteus units: the robot stops where a cable slips, says
//! which one, and flies again after the cure that it names.

use crate::robot::{Robot, steadily};
use messages::{MotorAuthority, MotorState, Request};
use robot_state::sentences::faults_of;

/// Two encoders on each of four cables.
const IDLERS: &str = "idler4";
/// The cable that slips, from 1: it moves at nearly the node's speed.
const SLIPS: usize = 3;
/// Largest distance of the node from its target after a flight, m: a slip that counts as motion is as long.
const THERE_M: f64 = 0.02;
/// Most that the encoders of a cable are apart without a slip, beyond what is explained, m.
const APART_M: f64 = 0.005;

/// Lets the cable slip in flight, until the robot stops for it.
fn slip(robot: &mut Robot, of: &str) {
    robot.fly();
    assert_eq!(robot.named & MotorAuthority::FAULT_SLIP, 0, "a false alarm");
    robot.fault(&format!("slip {SLIPS} 1 {of}"));
    robot.poll();
    let cycle = robot.last.header.cycle;
    robot.until("the slip is found", |robot| robot.last.faults & messages::faults::HARD != 0);
    let MotorAuthority { faults, mode, fault_cable, .. } = robot.last;
    println!("slip {of}: found after {} cycles, {faults:#x}", robot.last.header.cycle - cycle);
    let hard = faults & messages::faults::HARD;
    assert_eq!((hard, mode), (MotorAuthority::FAULT_SLIP, MotorAuthority::MODE_FAULTED));
    let named: Vec<usize> = (0..fault_cable.len()).filter(|cable| fault_cable[*cable] == 1).collect();
    assert_eq!(named, [SLIPS - 1]);
    // Counts do not tell which of the two is right.
    assert_eq!(robot.last.position_known, MotorState::POSITION_RESTORED);
    assert_eq!(robot.status()["faults"], serde_json::json!(faults_of(&robot.last)));
    robot.fault(&format!("slip {SLIPS} off {of}"));
}

/// Flies to the end of a move without a fault, and arrives there.
fn flies(robot: &mut Robot) {
    let mut states = robot.bus.deep_subscriber::<MotorState>("motor/state").unwrap();
    robot.fly();
    robot.arrive();
    assert_eq!(robot.named & messages::faults::HARD, 0);
    assert!(robot.distance_m(robot.goal) < THERE_M, "{} m off", robot.distance_m(robot.goal));
    while let Some(state) = states.receive().unwrap() {
        let apart_m = state.slip_m[..4].iter().fold(0.0, |most: f64, m| most.max(m.abs()));
        assert!(apart_m < APART_M, "{:?}", state.slip_m);
    }
}

#[test]
fn a_cable_that_slips_stops_the_robot_and_the_named_cure_makes_it_fly_again() {
    steadily(|| {
        let mut robot = Robot::up_with(IDLERS, "", |_| ());
        robot.arm();
        flies(&mut robot);

        // The idlers have counted what the cable did, so the position is true.
        slip(&mut robot, "drum");
        robot.reset();
        assert_eq!(robot.last.faults, 0);
        flies(&mut robot);

        // The cable went over the idler uncounted, so the position is not.
        slip(&mut robot, "");
        robot.ask("motor-io", Request::Reset);
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING && robot.last.faults == 0);
        robot.for_cycles(300);
        let position_m = robot.seen.position_m;
        robot.ask("motor-io", Request::ZeroAt { position_m });
        robot.until("a known position", |robot| robot.last.position_known == MotorState::POSITION_KNOWN);
        flies(&mut robot);
    });
}
