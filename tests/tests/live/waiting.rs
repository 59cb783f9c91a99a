//! `nims goto --wait` and `nims run --wait`: they end with the motion, and their exit code states how it ended.

use crate::robot::{GOAL, Robot, START, program, steadily};
use messages::MotorAuthority;
use rustix::process::{Pid, Signal, kill_process};
use std::process::{Child, Command, Stdio};

/// Starts a command and does not wait for its end.
fn begin(robot: &Robot, args: &[&str]) -> Child {
    let mut command = Command::new(program());
    command.args(["--domain", robot.domain.name()]).args(args).current_dir(robot.folder());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Starts a move and waits until the node follows it.
fn set_off(robot: &mut Robot, to: [f64; 3]) -> Child {
    let mut child = begin(robot, &["goto", &goto(to), "--wait", "--speed", "0.1"]);
    loop {
        robot.for_cycles(1);
        if robot.last.mode == MotorAuthority::MODE_FOLLOWING {
            return child;
        }
        if child.try_wait().unwrap().is_some() {
            panic!("no motion: {:?}", ended(child));
        }
    }
}

/// Returns exit code and stderr of a command that has ended.
fn ended(child: Child) -> (Option<i32>, String) {
    let output = child.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn goto(to: [f64; 3]) -> String {
    to.map(|value| value.to_string()).join(",")
}

#[test]
fn a_command_that_waits_ends_with_the_motion_and_tells_how() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.arm();
        robot.until_reported("the robot is ready", |robot| robot.nims(&["goto", &goto(START)]).status.code().is_some());
        // Arrived: the node is there and the robot holds when the command ends.
        let (code, said) = ended(begin(&robot, &["goto", &goto(GOAL), "--wait", "--speed", "0.3"]));
        robot.for_cycles(5);
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains("s left"), "no progress: {said}");
        assert!(robot.distance_m(GOAL) < 0.02 && robot.last.mode == MotorAuthority::MODE_HOLDING);

        // Stopped by another requester: the reason, and exit code 1.
        let child = set_off(&mut robot, START);
        robot.accepted(&["stop"]);
        let (code, said) = ended(child);
        assert_eq!(code, Some(1), "{said}");
        assert!(robot.distance_m(START) > 0.02, "it was stopped on the way");

        // A wait that is ended leaves the motion alone.
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        let child = set_off(&mut robot, START);
        kill_process(Pid::from_child(&child), Signal::INT).unwrap();
        let (code, said) = ended(child);
        assert!(code == Some(1) && said.contains("continues"), "{said}");
        robot.for_cycles(20);
        assert_eq!(robot.last.mode, MotorAuthority::MODE_FOLLOWING);

        // What is refused is refused as without waiting.
        robot.accepted(&["stop"]);
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        assert_eq!(robot.refused(&["goto", "5.0,3.2,9.5", "--wait"], &["9.5"]), Some(2));
    });
}
