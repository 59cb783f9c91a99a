//! A held motion ends with its gateway, in whatever way that ends.

use crate::rig::{Client, Gateway, OWNER};
use crate::robot::{GOAL, Robot, goto};
use gateway_protocol::{Accepted, Call};
use messages::{MotorAuthority, OperatorRequest, Request, RequestBody};
use robot_state::Reason;
use rustix::process::{Pid, Signal, kill_process};
use std::cell::RefCell;

/// Begins a motion that is held, and holds it until it is under way.
fn held(robot: &mut Robot, gateway: &Gateway, request: &Request, mode: u8) -> Client {
    let mut client = gateway.client();
    robot.until("it rests", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    let ask = Call::Ask { id: 1, request: request.clone(), process: None, held: true, at_ns: None, pressed_ns: None };
    let begun = crate::rig::answer(&client.call(&ask));
    assert_eq!(begun.1, Accepted::Accepted, "{begun:?}");
    let holding = RefCell::new(&mut client);
    robot.until_reported("it moves", |robot| {
        holding.borrow_mut().send(&Call::Beat { at_ns: None }, &[]);
        robot.last.mode == mode
    });
    client
}

#[test]
fn a_held_motion_ends_when_its_gateway_is_killed_hangs_or_ends() {
    let mut robot = Robot::up("");
    robot.arm();
    let mut requests = robot.bus.subscriber::<OperatorRequest>("operator/request").unwrap();
    // Both take more than ten seconds, so they do not end by themselves meanwhile.
    let slow = goto(GOAL, 0.05);
    let jog = Request::Jog { cable: 1, distance_m: -0.5 };
    for (request, mode, verb, reason) in [
        (&slow, MotorAuthority::MODE_FOLLOWING, RequestBody::VERB_STOP, Reason::Stopping),
        (&jog, MotorAuthority::MODE_JOGGING, RequestBody::VERB_HOLD, Reason::JogEnds),
    ] {
        for signal in [Signal::KILL, Signal::STOP, Signal::TERM] {
            let gateway = Gateway::joined(&robot, OWNER);
            let _client = held(&mut robot, &gateway, request, mode);
            while requests.receive().unwrap().is_some() {}
            kill_process(Pid::from_child(&gateway.child), signal).unwrap();
            robot.until("it ends", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
            // The stop is in the run, under the name of who held the motion, and was the cause.
            let stops = std::iter::from_fn(|| requests.receive().unwrap()).filter(|one| {
                one.answered == 1 && one.body.verb == verb && one.uid == rustix::process::geteuid().as_raw()
            });
            let reasons: Vec<u16> = stops.map(|stop| stop.reason).collect();
            assert_eq!(reasons.first(), Some(&reason.code()), "{signal:?}: {reasons:?}");
            if signal == Signal::STOP {
                kill_process(Pid::from_child(&gateway.child), Signal::CONT).unwrap();
            }
        }
    }
}
