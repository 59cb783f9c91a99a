//! The robot under a service manager: what it is told, and what remains after the supervisor's death.

use crate::robot::{Robot, THREE_CABLES, alone, copy_configs, program, root, samples_of, steadily};
use bus::{Domain, clock};
use messages::MotorAuthority;
use rustix::process::Signal;
use serde_json::Value;
use std::cell::RefCell;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

/// Messages of the service that have not been read yet.
fn messages(manager: &UnixDatagram) -> Vec<String> {
    let mut buffer = [0; 4096];
    let mut found = Vec::new();
    while let Ok(bytes) = manager.recv(&mut buffer) {
        found.push(String::from_utf8_lossy(&buffer[..bytes]).into_owned());
    }
    found
}

/// Waits until the service has sent a message that begins like this; returns all since the last call.
fn until(manager: &UnixDatagram, wanted: &str) -> Vec<String> {
    let give_up = clock::now_ns() + 60_000_000_000;
    let mut found = Vec::new();
    while !found.iter().any(|message: &String| message.starts_with(wanted)) {
        found.extend(messages(manager));
        assert!(clock::now_ns() < give_up, "no {wanted}: {found:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
    found
}

fn signs(messages: &[String]) -> usize {
    messages.iter().filter(|message| *message == "WATCHDOG=1").count()
}

/// Starts `nims up` of a robot whose drives are on that port, as a service or on the command line.
fn start_with_port(folder: &Path, port: &str, is_service: bool, domain: &Domain) -> Child {
    let system = folder.join("configs/systems/demo3.toml");
    let text = std::fs::read_to_string(root().join("configs/systems/demo3.toml")).unwrap();
    // Without a virtual motor box, which refuses such a port before motor-io has tried it.
    let of_hardware = text.split("\n[motor_box]").next().unwrap();
    std::fs::write(&system, of_hardware.replace("{domain}/drive0", port)).unwrap();
    let mut command = Command::new(program());
    command.args(["up", "--domain", domain.name(), "--for", "1"]).arg(system).env_remove("NOTIFY_SOCKET");
    if is_service {
        command.env("NOTIFY_SOCKET", folder.join("notify"));
    }
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// What it says until it ends.
fn up_with_port(folder: &Path, port: &str, is_service: bool) -> Output {
    start_with_port(folder, port, is_service, &Domain::for_test()).wait_with_output().unwrap()
}

/// Number of runs in the folder of the runs.
fn runs(folder: &Path) -> usize {
    std::fs::read_dir(folder.join("runs")).map_or(0, Iterator::count)
}

#[test]
fn a_service_whose_drives_are_missing_is_started_again_and_leaves_no_run_per_attempt() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    copy_configs(folder.path());
    // A device that is there and is no drive.
    let output = up_with_port(folder.path(), "/dev/null", true);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), runs(folder.path())), (Some(1), 0), "{said}");
    // Its log was in the run.
    assert!(said.lines().any(|line| line.starts_with("nims: motor-io: ") && line.contains("/dev/null")), "{said}");
    // A person looks into the run.
    let output = up_with_port(folder.path(), "/dev/null", false);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), runs(folder.path())), (Some(1), 1), "{said}");
    assert!(said.contains("/runs/"), "{said}");
}

#[test]
fn a_service_waits_for_a_device_that_appears_later() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    copy_configs(folder.path());
    let manager = UnixDatagram::bind(folder.path().join("notify")).unwrap();
    manager.set_nonblocking(true).unwrap();
    let device = folder.path().join("drives");
    let port = device.to_str().unwrap();
    let domain = Domain::for_test();
    let start = || {
        let up = start_with_port(folder.path(), port, true, &domain);
        until(&manager, "STATUS=waiting: port 1");
        up
    };
    // The end of the wait is no bad input, after which the manager would not start the service again.
    let up = start();
    rustix::process::kill_process(rustix::process::Pid::from_child(&up), Signal::INT).unwrap();
    let output = up.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), runs(folder.path())), (Some(1), 0), "{said}");
    assert!(said.contains(port), "{said}");
    // It appears, and is no drive.
    let up = start();
    std::os::unix::fs::symlink("/dev/null", &device).unwrap();
    let output = up.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), runs(folder.path())), (Some(1), 0), "{said}");
    assert!(said.lines().any(|line| line.starts_with("nims: motor-io: ") && line.contains(port)), "{said}");
}

#[test]
fn a_service_reports_while_it_supervises_and_its_remains_end_at_rest() {
    steadily(|| {
        let manager = RefCell::new(None);
        let mut robot = Robot::up_with(THREE_CABLES, "", |configs| {
            let socket = UnixDatagram::bind(configs.with_file_name("notify")).unwrap();
            socket.set_nonblocking(true).unwrap();
            *manager.borrow_mut() = Some(socket);
        });
        let manager = manager.take().unwrap();
        let start = until(&manager, "READY=1");
        assert!(start.iter().any(|message| message.starts_with("STATUS=starting: waiting for ")), "{start:?}");
        let ready = start.iter().position(|message| message == "READY=1").unwrap();
        assert_eq!(signs(&start[..ready]), 0, "{start:?}");
        until(&manager, "WATCHDOG=1");

        robot.arm();
        robot.fly();
        until(&manager, "STATUS=following; ");
        robot.nims(&["status"]);
        // A stopped supervisor supervises nothing; motor-io stops the robot, and only the manager can end it.
        let supervisor = rustix::process::Pid::from_raw(robot.supervisor_pid().cast_signed()).unwrap();
        rustix::process::kill_process(supervisor, Signal::STOP).unwrap();
        messages(&manager);
        robot.until("the robot holds", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        assert_eq!(messages(&manager), Vec::<String>::new());
        rustix::process::kill_process(supervisor, Signal::CONT).unwrap();
        until(&manager, "WATCHDOG=1");

        robot.fly();
        robot.down(Signal::KILL);
        let ended = Command::new(program())
            .args(["--domain", robot.domain.name(), "--json", "up", "--end-remaining"])
            .arg(robot.system_file())
            .output()
            .unwrap();
        assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
        let value: Value = serde_json::from_slice(&ended.stdout).unwrap();
        let names: Vec<&str> = value["ended"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
        assert_eq!((names.first(), names.last()), (Some(&"motor-io"), Some(&"recorder")), "{names:?}");
        assert!(names.len() >= 6 && robot.pid("motor-io").is_none() && robot.pid("recorder").is_none(), "{names:?}");
        // The recorder, which ended last, has the whole stop.
        let modes: Vec<MotorAuthority> = samples_of(&robot.run(), "motor/authority");
        let last = modes.last().unwrap();
        assert!(
            modes.iter().rev().take(200).any(|sample| sample.mode == MotorAuthority::MODE_FOLLOWING),
            "it was in flight"
        );
        assert!([MotorAuthority::MODE_HOLDING, MotorAuthority::MODE_DISARMED].contains(&last.mode), "{last:?}");
    });
}
