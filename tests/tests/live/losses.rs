//! Losses of the recording: they are reported at once, missions are not started, and `nims up` exits with 1. A hung
//! process is replaced.

use crate::robot::{Robot, THREE_CABLES, copy_configs, program, root, steadily};
use messages::{MotorAuthority, RecorderStatus, Request};
use robot_state::Reason;
use rustix::process::Signal;
use std::process::Command;

/// A standby beside the controller, which is restarted when it dies.
const STANDBY: &str =
    "\n[[process]]\nname = \"spare\"\nrole = \"controller\"\nslot = \"b\"\nstandby = true\nrestart = true\n";

fn restarts(robot: &Robot, process: &str) -> u64 {
    robot.row(process).and_then(|row| row["restarts"].as_u64()).unwrap_or(0)
}

/// Names of the entries of a folder.
fn names_of(folder: &std::path::Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
}

#[test]
fn without_room_nothing_is_recorded_and_no_mission_begins() {
    steadily(|| {
        // More space than any disk has.
        let mut robot = Robot::up("\n[recorder]\nmin_free_bytes = 1000000000000000\n");
        robot.until_recorder(RecorderStatus::STATE_DISK_FULL);
        robot.arm();
        let mission = root().join("configs/missions/demo.toml");
        let mission = mission.to_str().unwrap();
        // The option that flies without a recording is named.
        assert_eq!(robot.refused(&["run", mission], &["--unrecorded"]), Some(1));
        robot.for_cycles(100);
        assert_eq!(robot.last.mode, MotorAuthority::MODE_HOLDING, "the mission has begun");
        // The way home is always allowed, but the answer reports that the motion is not recorded.
        let home = robot.nims(&["goto", "5.0,3.2,0.5"]);
        assert!(home.status.success() && !home.stderr.is_empty(), "{home:?}");
        robot.ask("motor-io", Request::Stop);
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        robot.accepted(&["run", "--unrecorded", mission]);
        robot.until("it flies", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
        assert_eq!(robot.down(Signal::INT), Some(1), "{}", robot.printed());
        let answer = robot.answer();
        assert_eq!(answer["unrecorded"].as_array().map(Vec::len), Some(1), "{answer}");
        assert!(answer["unfinished"].is_string(), "{answer}");
    });
}

#[test]
fn a_run_folder_that_is_removed_is_no_full_disk() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.for_cycles(400);
        let mut before = names_of(&robot.run());
        std::fs::remove_dir_all(robot.run()).unwrap();
        robot.until_reported("recording continues", |robot| {
            names_of(&robot.run()).iter().any(|name| name.ends_with(".mcap.part"))
        });
        // The configuration is in the folder again, and the new file begins with it.
        before.retain(|name| name.ends_with(".toml") || name == "manifest.json");
        robot.until_reported("it stands there again", |robot| {
            let now = names_of(&robot.run());
            before.iter().all(|name| now.contains(name))
        });
        // A process that starts now finds a folder for its log.
        robot.accepted(&["restart", "planner"]);
        assert_eq!(robot.down(Signal::INT), Some(1), "{}", robot.printed());
        assert_eq!(robot.answer()["unrecorded"].as_array().map(Vec::len), Some(1), "{}", robot.answer());
        let report = runlog::info(&robot.run()).unwrap();
        assert!(report.channels.iter().any(|channel| channel.name == "motor/state"), "{report}");
        let mut reader = runlog::RunReader::open(&robot.run()).unwrap();
        while reader.next_sample().unwrap().is_some() {}
        for name in ["system.toml", "robot.toml", "resolved.toml"] {
            assert!(reader.attachments().iter().any(|file| file.name == name), "{name} is not in the run file");
        }
        assert!(!report.healthy, "the first file is missing: {report}");
        let value = analysis::report::report(&[robot.run()], None).unwrap().value;
        assert_eq!(value["runs"][0]["recording"]["healthy"], false);
    });
}

#[test]
fn a_recorder_that_hangs_is_replaced() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.for_cycles(200);
        robot.signal("recorder", Signal::STOP);
        robot.until_reported("it is replaced", |robot| {
            restarts(robot, "recorder") == 1 && robot.state("recorder") == "ready"
        });
        robot.for_cycles(200);
        assert_eq!(robot.down(Signal::INT), Some(1), "{}", robot.printed());
        let report = runlog::info(&robot.run()).unwrap();
        assert!(report.files.iter().all(|file| file.finished) && report.files[0].recovered, "{report}");
        assert!(!report.healthy, "{report}");
        let value = analysis::report::report(&[robot.run()], None).unwrap().value;
        assert_eq!(value["runs"][0]["recording"]["healthy"], false);
    });
}

#[test]
fn a_standby_that_hangs_is_replaced() {
    steadily(|| {
        let mut robot = Robot::up(STANDBY);
        robot.until_reported("the standby is ready", |robot| robot.state("controller-b") == "ready");
        robot.signal("controller-b", Signal::STOP);
        robot.until_reported("it is replaced", |robot| {
            restarts(robot, "controller-b") == 1 && robot.state("controller-b") == "ready"
        });
        assert_eq!(restarts(&robot, "controller"), 0, "the slot in charge is unchanged");
        assert_eq!(robot.down(Signal::INT), Some(1), "a process has ended: {}", robot.printed());
    });
}

/// Number of programs `sleep` that the supervisor has started.
fn sleepers(robot: &Robot) -> usize {
    let of_supervisor = format!("(sleep) S {} ", robot.supervisor_pid());
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    let stats = processes.filter_map(|entry| std::fs::read_to_string(entry.path().join("stat")).ok());
    stats.filter(|stat| stat.contains(&of_supervisor)).count()
}

/// A pipe without a reader takes the place of a log: opening it waits, as on a disk that does not answer.
#[test]
fn a_disk_that_does_not_answer_stops_no_supervision() {
    steadily(|| {
        let mut robot = Robot::up(STANDBY);
        robot.until_reported("the standby is ready", |robot| robot.state("controller-b") == "ready");
        robot.arm();
        let log = robot.run().join("log/wind.txt");
        assert!(Command::new("mkfifo").arg(&log).status().unwrap().success());
        let (name, folder, command) = ("wind".to_owned(), "/".to_owned(), vec!["sleep".to_owned(), "1000".to_owned()]);
        let plug = Request::Plug { name, folder, command, replace: false };
        for _ in 0..2 {
            let reason = robot.reason("nims", &plug);
            assert!(matches!(reason, Some(Reason::ProcessNotStarted { .. })), "{reason:?}");
        }
        robot.signal("controller-b", Signal::KILL);
        robot.until_reported("it is replaced", |robot| {
            restarts(robot, "controller-b") == 1 && robot.state("controller-b") == "ready"
        });
        assert_eq!(robot.last.mode, MotorAuthority::MODE_HOLDING, "the supervisor went on");

        // Now the disk answers. What is started too late is ended, and the next start succeeds.
        let _pipe = std::fs::File::open(&log).unwrap();
        let give_up = bus::clock::now_ns() + 60_000_000_000;
        while !matches!(robot.reason("nims", &plug), Some(Reason::ProcessStarts { .. })) {
            assert!(bus::clock::now_ns() < give_up, "{}", robot.printed());
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        robot.until_reported("it runs", |robot| robot.state("wind") == "running");
        robot.until_reported("one alone", |robot| sleepers(robot) == 1);
        assert_eq!(robot.down(Signal::INT), Some(1), "a process has ended: {}", robot.printed());
    });
}

#[test]
fn a_demonstration_that_is_broken_off_names_its_run_and_writes_its_report() {
    steadily(|| {
        let folder = tempfile::tempdir().unwrap();
        let domain = bus::Domain::for_test();
        let run = folder.path().join("run");
        let mut demo = Command::new(program())
            .args(["demo", "--json", "--domain", domain.name(), "--run"])
            .arg(&run)
            .arg(copy_configs(folder.path()).join(format!("systems/{THREE_CABLES}.toml")))
            .stdout(std::fs::File::create(folder.path().join("stdout")).unwrap())
            .stderr(std::fs::File::create(folder.path().join("stderr")).unwrap())
            .spawn()
            .unwrap();
        // A second of the flight is in the file.
        let flown = || {
            let samples = runlog::read_channel::<MotorAuthority>(&run, "motor/authority").unwrap_or_default();
            samples.iter().filter(|(_, sample)| sample.mode == MotorAuthority::MODE_FOLLOWING).count()
        };
        let give_up = bus::clock::now_ns() + 60_000_000_000;
        while flown() < 200 {
            assert!(bus::clock::now_ns() < give_up && demo.try_wait().unwrap().is_none(), "the robot does not fly");
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        let command::Output { value, words, .. } =
            analysis::report::report(std::slice::from_ref(&run), Some(&folder.path().join("live.html"))).unwrap();
        assert!(value["runs"][0]["flown_m"].as_f64().unwrap() > 0.0, "{words}");
        // The text itself: no negative zero.
        assert!(!words.contains("-0.0"), "{words}");
        rustix::process::kill_process(rustix::process::Pid::from_child(&demo), Signal::INT).unwrap();
        assert_eq!(demo.wait().unwrap().code(), Some(1));
        let said = std::fs::read_to_string(folder.path().join("stderr")).unwrap();
        let last = said.trim_end().lines().last().unwrap();
        assert!(last.contains(run.to_str().unwrap()), "{said}");
        let answer = std::fs::read_to_string(folder.path().join("stdout")).unwrap();
        let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
        assert!(answer["broken_off"].is_string(), "{answer}");
        assert!(
            run.join("report.html").is_file() && run.join("report.svg").is_file() && run.join("report.json").is_file()
        );
        let command::Output { value, words, .. } = analysis::report::report(std::slice::from_ref(&run), None).unwrap();
        assert!(!words.contains("-0.0"), "{words}");
        assert_eq!(value["runs"][0]["verdict"]["grade"], "bad", "the mission was not completed: {words}");
        let legs = value["runs"][0]["legs"].as_array().unwrap();
        let (flown, sum) = (
            value["runs"][0]["flown_m"].as_f64().unwrap(),
            legs.iter().map(|leg| leg["flown_m"].as_f64().unwrap()).sum::<f64>(),
        );
        assert!(flown > 0.0 && (flown - sum).abs() < 1e-9, "{flown} m, {sum} m");
        let last = legs.last().unwrap();
        assert!(last["complete"] == false && last["flown_m"].as_f64().unwrap() < last["length_m"].as_f64().unwrap());
    });
}
