//! The package `nims` for Python at a running robot.

use crate::rig::{Gateway, OWNER};
use crate::robot::{GOAL, Robot, root};
use std::process::Command;

#[test]
fn a_robot_is_flown_and_watched_from_python() {
    let mut robot = Robot::up("");
    let gateway = Gateway::joined(&robot, OWNER);
    robot.arm();
    let goal = GOAL.map(|coordinate| coordinate.to_string()).join(",");
    let output = Command::new(nims_tests::python())
        .env("PYTHONPATH", root().join("scripts/python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .arg(root().join("tests/python/check_robot.py"))
        .arg(&gateway.socket)
        .arg(goal)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}{}", String::from_utf8_lossy(&output.stderr), robot.printed());
    robot.for_cycles(20);
}

#[test]
fn a_timeout_within_a_sample_loses_nothing_in_python() {
    let output = Command::new(nims_tests::python())
        .env("PYTHONPATH", root().join("scripts/python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .arg(root().join("tests/python/check_link.py"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
