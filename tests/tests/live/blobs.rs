//! A camera is plugged in flight: its pictures are in the run file as they were sent, for readers that this project did
//! not write, each with the place at which it was taken.

use crate::robot::{GOAL, Robot, START, program, root};
use messages::blob::BlobType;
use messages::{MotorAuthority, Sample};
use nims_tests::python;
use rustix::process::Signal;
use std::fs;
use std::process::Command;

const LOGGER: &str = "\n[[process]]\nname = \"sensor-logger\"\ncommand = [\"sensor-logger\", \"--system\", \"{system}\"]\nrestart = true\n";

/// Content of a picture: readers do not look into it.
fn picture(number: u32) -> Vec<u8> {
    let bytes = 150_000 + 60_000 * number;
    (0..bytes).map(|at| at.wrapping_mul(2_654_435_761).wrapping_add(number).to_le_bytes()[3]).collect()
}

#[test]
fn the_pictures_of_a_camera_are_recorded_with_their_places() {
    let camera = program().with_file_name("examples").join("camera");
    are_recorded_with_their_places(&[camera.to_str().unwrap()], "ready");
}

#[test]
fn the_pictures_of_a_camera_in_python_are_recorded_with_their_places() {
    let (modules, camera, python) =
        (root().join("scripts/python"), root().join("scripts/templates/camera.py"), python());
    let path = format!("PYTHONPATH={}", modules.display());
    let command = ["env", &path, python.to_str().unwrap(), "-B", camera.to_str().unwrap()];
    are_recorded_with_their_places(&command, "running");
}

#[test]
fn python_has_the_same_messages() {
    let script = "import sys\nsys.path.insert(0, sys.argv[1])\nimport nims.blob as b\n\
        for one in (b.Pictures, b.Images, b.Scans, b.Grids): print(one.MESSAGE.type_name())";
    let output = Command::new(python()).args(["-B", "-c", script]).arg(root().join("scripts/python")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(said.lines().collect::<Vec<_>>(), BlobType::ALL.map(BlobType::type_name));
}

/// Plugs a camera in by this command, and flies.
fn are_recorded_with_their_places(command: &[&str], state: &str) {
    let folder = tempfile::tempdir().unwrap();
    for number in 0..4 {
        fs::write(folder.path().join(format!("{number}.jpg")), picture(number)).unwrap();
    }
    let mut robot = Robot::up(LOGGER);
    robot.arm();
    robot.until("the logger", |robot| robot.pid("sensor-logger").is_some());
    let pictures = folder.path().to_str().unwrap();
    robot.accepted(&[&["plug", "camera", "--"], command, &["--rate", "30", pictures]].concat());
    robot.until("the camera", |robot| robot.state("camera") == state);
    // It may be long on its way to the first picture.
    robot.until("a picture", |robot| robot.bus.tap("blob/camera").is_ok());
    robot.fly();
    robot.until("the end of the motion", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    robot.accepted(&["unplug", "camera"]);
    assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());

    let run = robot.run();
    let checked = Command::new(python())
        .arg(root().join("tests/python/check_pictures.py"))
        .args([&run, folder.path()])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(checked.status.success(), "{said}{}", String::from_utf8_lossy(&checked.stderr));
    let count: usize = said.split_whitespace().next().unwrap().parse().unwrap();
    assert!(count > 20, "{said}");
    let places = runlog::read_channel::<Sample>(&run, "sample/camera").unwrap();
    assert!(places.len() + 3 >= count, "{} places of {count} pictures", places.len());
    for (_, sample) in &places {
        let inside = (0..3).all(|k| (START[k] - 0.05..=GOAL[k] + 0.05).contains(&sample.position_m[k]));
        assert!(inside && sample.position_std_m.iter().all(|std_m| (1e-4..0.05).contains(std_m)), "{sample:?}");
    }
    let along = |(_, sample): &(_, Sample)| sample.position_m[0];
    assert!(along(places.last().unwrap()) - along(&places[0]) > 0.5, "the node moved");
}
