//! `nims setup` takes the lengths of a running robot.

use crate::robot::{GOAL, Robot, START, THREE_CABLES, goto, program, steadily};
use messages::{MotorAuthority, MotorState};
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// The site of the robot's own anchors, up to the first point.
const SITE: &str = "3\n9.80\n9.80\n10.00\nl\n3.05\n3.10\n2.98\n\n3\n";

/// Largest difference of two readings of a cable at rest, m.
const SAME_M: f64 = 0.002;

/// Continues the setup with these lines; returns what it says. It never comes to its end here.
fn setup(robot: &Robot, lines: &str) -> String {
    let mut command = Command::new(program());
    command.args(["--domain", robot.domain.name(), "setup", "site.toml"]).current_dir(robot.folder());
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(lines.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn site(robot: &Robot) -> String {
    std::fs::read_to_string(robot.folder().join("site.toml")).unwrap()
}

fn points(robot: &Robot) -> Vec<Vec<f64>> {
    let file: toml::Table = site(robot).parse().unwrap();
    let lengths = |point: &toml::Value| -> Vec<f64> {
        point["lengths_m"].as_array().unwrap().iter().map(|m| m.as_float().unwrap()).collect()
    };
    file.get("point").and_then(toml::Value::as_array).into_iter().flatten().map(lengths).collect()
}

#[test]
fn captured_lengths_are_those_of_the_robot_at_rest() {
    steadily(|| {
        let mut robot = Robot::up("");
        let mut states = robot.bus.subscriber::<MotorState>("motor/state").unwrap();
        let said = setup(&robot, &format!("{SITE}capture\n"));
        assert!(said.contains("nims zero"), "{said}");
        assert!(points(&robot).is_empty());
        robot.arm();
        for at_m in [START, GOAL] {
            while robot.distance_m(at_m) > 0.05 {
                robot.fly();
                let before = site(&robot);
                let moving = setup(&robot, "capture\n");
                assert!(site(&robot) == before || robot.speed_m_s() < 0.01, "{moving}");
                robot.arrive();
            }
            robot.for_cycles(100);
            let before = points(&robot).len();
            // Enter: the node is not at the place of the plan.
            let said = setup(&robot, "capture\n\n");
            let state = states.latest().unwrap().unwrap();
            let all = points(&robot);
            assert_eq!(all.len(), before + 1, "{said}");
            for (cable, m) in all[before].iter().enumerate() {
                assert!((m - state.length_m[cable]).abs() < SAME_M, "cable {}: {m} {:?}", cable + 1, state.length_m);
            }
        }
        let file = site(&robot);
        assert!(file.contains("counts_per_m") && file.contains("sigma_offset_m = 0.05"), "{file}");
    });
}

/// The floor is 15 cm below the start, where the robot does not expect it.
#[test]
fn lengths_are_taken_when_the_robot_sets_its_node_down() {
    steadily(|| {
        let lower = |configs: &Path| {
            let path = configs.join("robots/lab3.toml");
            let text = std::fs::read_to_string(&path).unwrap();
            std::fs::write(&path, text.replace("\nground_m = 0.0", "\nground_m = -1.0")).unwrap();
        };
        let mut robot = Robot::up_with(THREE_CABLES, "\n[motor_box.truth]\nground_m = 0.15\n", lower);
        robot.arm();
        let said = robot.folder().join("said.txt");
        let mut command = Command::new(program());
        command.args(["--domain", robot.domain.name(), "setup", "site.toml"]).current_dir(robot.folder());
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(std::fs::File::create(&said).unwrap());
        let mut child = command.spawn().unwrap();
        let mut keys = child.stdin.take().unwrap();
        keys.write_all(format!("{SITE}touch\n").as_bytes()).unwrap();
        let text = || std::fs::read_to_string(&said).unwrap();
        robot.until("it waits", |_| text().contains("Lower the node"));
        robot.ask("planner", goto([START[0], START[1], -0.4], 0.05));
        robot.until("the touch-down", |_| text().contains("Captured"));
        let height_m = robot.seen.position_m[2];
        assert!((height_m - 0.15).abs() < 0.005, "{height_m}");
        // It stops, by the request of the setup or for its slack cables.
        robot.until("it stops", |robot| robot.last.mode != MotorAuthority::MODE_FOLLOWING);
        // Enter: the node is not at the place of the plan.
        keys.write_all(b"\n").unwrap();
        drop(keys);
        assert_eq!(child.wait().unwrap().code(), Some(1));
        let point = points(&robot).pop().unwrap();
        let pulleys = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.1], [4.7, 8.6, 2.98]];
        let expected = |anchor: [f64; 3]| -> f64 {
            let node = [START[0], START[1], 0.15];
            (0..3).map(|k| (anchor[k] - node[k]).powi(2)).sum::<f64>().sqrt()
        };
        for (m, expected_m) in point.iter().zip(pulleys.map(expected)) {
            assert!((m - expected_m).abs() < 0.005, "{point:?} {expected_m}");
        }
        // After Enter without anything else to wait for, the wait ends without lengths.
        let said = setup(&robot, "touch\n\n");
        assert!(said.contains("No touch-down was seen") && points(&robot).len() == 1, "{said}");
    });
}
