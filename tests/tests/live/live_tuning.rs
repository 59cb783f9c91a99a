//! The recorded configuration is the one that flew: the run's copy of the configuration, the parameters that each
//! process publishes, and `nims set`.

use crate::robot::{Robot, THREE_CABLES, steadily};
use messages::{MotorAuthority, Request, SystemConfig, text_of};
use replay::{Changes, run};
use rustix::process::Signal;
use std::path::{Path, PathBuf};

const TWO_CONTROLLERS: &str = "\n[controller]\nlaw = \"p-feedforward\"\n\n[[process]]\nname = \"second\"\nrole = \"controller\"\nstandby = true\n\
    [[process]]\nname = \"first\"\nrole = \"controller\"\nrestart = true\n";

/// The newest sample of a process with its parameters.
fn config_of(robot: &Robot, process: &str) -> Option<SystemConfig> {
    let mut said = robot.bus.subscriber::<SystemConfig>(&format!("system/config/{process}")).unwrap();
    let give_up = bus::clock::now_ns() + 500_000_000;
    loop {
        if let Some(said) = said.latest().unwrap() {
            return Some(said);
        }
        if bus::clock::now_ns() >= give_up {
            return None;
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

fn parameters(said: &SystemConfig) -> String {
    text_of(&said.parameters)
}

fn hash(path: &Path) -> String {
    runtime::hash_of(&[path.to_path_buf()]).unwrap()
}

/// Computes the run again: every sample that can be compared is the same.
fn replays(run_folder: &Path, channels: &[&str]) {
    let replayed = run(run_folder, &Changes::default(), &mut |_| {}).unwrap();
    assert_eq!(replayed.different(), 0, "{:#?}", replayed.channels);
    for channel in channels {
        let tally = replayed.channels.iter().find(|tally| tally.channel == *channel).unwrap();
        assert!(tally.equal > 100 && tally.equal + 50 >= tally.recorded, "{tally:#?}");
    }
}

#[test]
fn a_parameter_set_in_flight_applies_to_every_slot_and_after_a_restart_and_replays() {
    steadily(|| {
        let mut robot = Robot::up(TWO_CONTROLLERS);
        robot.arm();
        robot.fly();
        for process in ["controller", "controller-b"] {
            let said = config_of(&robot, process).unwrap();
            assert_eq!((said.changes, said.from_seq, said.from_cycle), (0, 1, 0), "{process}");
            assert!(parameters(&said).contains("length_gain_per_s = 3.0\n"), "{}", parameters(&said));
        }
        assert_eq!(
            robot.refused(&["set", "controller.length_gain_per_s", "51"], &["length_gain_per_s", "50"]),
            Some(2)
        );
        assert_eq!(robot.refused(&["set", "controller.law", "preview"], &["nims swap"]), Some(2));
        let answer = robot.accepted(&["--json", "set", "controller.length_gain_per_s", "6"]);
        let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
        assert_eq!(answer["taken_up_by"].as_array().unwrap().len(), 2, "{answer}");
        let announced = answer["from_cycle"].as_u64().unwrap();
        let mut first = [0; 2];
        for (process, incarnation) in ["controller", "controller-b"].iter().zip(&mut first) {
            let said = config_of(&robot, process).unwrap();
            assert!(parameters(&said).contains("length_gain_per_s = 6.0\n"), "{}", parameters(&said));
            assert!(said.changes == 1 && said.from_seq > 1 && said.from_cycle >= announced, "{said:?}");
            *incarnation = said.incarnation;
        }
        // The process in charge dies; the standby takes over, and the restarted one begins with the parameters that
        // were set.
        robot.signal("controller", Signal::KILL);
        robot.until_reported("another controller", |robot| {
            config_of(robot, "controller").is_some_and(|said| said.incarnation != first[0])
        });
        let again = config_of(&robot, "controller").unwrap();
        assert_eq!((again.changes, again.from_seq), (1, 1));
        assert!(parameters(&again).contains("length_gain_per_s = 6.0\n"), "{}", parameters(&again));
        assert_eq!(text_of(&again.file), robot.run().join("resolved-1.toml").to_string_lossy());
        assert_eq!(text_of(&again.file_sha256).len(), 64);
        robot.accepted(&["set", "estimator.eta", "20"]);
        // The method that does not use it is named.
        let idle = robot.accepted(&["set", "estimator.reading_sigma_m", "0.001"]);
        assert!(idle.contains("phi"), "{idle}");
        robot.arrive();
        // One of its processes has died.
        assert_eq!(robot.down(Signal::INT), Some(1), "{}", robot.printed());
        let record = std::fs::read_to_string(robot.run().join("set.toml")).unwrap();
        let record: toml::Table = record.parse().unwrap();
        assert_eq!(record["set"].as_array().unwrap().len(), 3, "{record}");
        let begun = std::fs::read_to_string(robot.run().join("resolved.toml")).unwrap();
        assert!(begun.contains("length_gain_per_s = 3.0\n"), "the initial parameters");
        replays(&robot.run(), &["motor/command/a", "motor/command/b", "node/estimate/a"]);
    });
}

/// A sensor on a missing port, so that only its file matters.
const SENSOR: &str = "\n[[process]]\nname = \"wind\"\ncommand = [\"sensor\", \"../sensors/wind.toml\"]\n";

#[test]
fn an_edit_in_flight_is_for_the_next_run() {
    steadily(|| {
        let mut robot = Robot::up_with(THREE_CABLES, SENSOR, |_| ());
        robot.arm();
        robot.fly();
        let resolved = robot.run().join("resolved.toml");
        let begun = std::fs::read_to_string(&resolved).unwrap();
        let edit = |path: PathBuf, from: &str, to: &str| {
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains(from), "{}: no {from}", path.display());
            std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        };
        let configs = robot.folder().join("configs");
        edit(robot.system_file(), "[motor_box]", "[controller]\nhorizon_cycles = 77\n[motor_box]");
        edit(configs.join("robots/lab3.toml"), "node_mass_kg = 1.2", "node_mass_kg = 2.4");
        edit(configs.join("sensors/wind.toml"), "baud = ", "baud = 1");
        edit(resolved.clone(), "horizon_cycles = 20", "horizon_cycles = 66");
        robot.ask("motor-io", Request::Stop);
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        for process in ["controller", "estimator", "planner", "wind"] {
            let before = config_of(&robot, process).unwrap();
            robot.accepted(&["restart", process]);
            robot.until_reported("another life", |robot| {
                config_of(robot, process).is_some_and(|said| said.incarnation != before.incarnation)
            });
            let after = config_of(&robot, process).unwrap();
            let same = |said: &SystemConfig| (text_of(&said.file), text_of(&said.file_sha256), parameters(said));
            assert_eq!(same(&after), same(&before), "{process}");
            let file = PathBuf::from(text_of(&after.file));
            assert!(file.starts_with(robot.run()), "{process} reads {}", file.display());
        }
        assert_eq!(std::fs::read_to_string(&resolved).unwrap(), begun, "the file is restored");
        assert!(robot.printed().contains("resolved.toml"), "the file is named: {}", robot.printed());
        robot.fly();
        assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
        assert_eq!(std::fs::read_to_string(&resolved).unwrap(), begun);
        replays(&robot.run(), &["motor/command/a", "node/estimate/a"]);
    });
}

#[test]
fn every_process_publishes_its_configuration() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.poll();
        let program = crate::robot::program().canonicalize().unwrap();
        for (process, word) in [
            ("motor-io", "watchdog_s = 0.3"),
            ("estimator", "eta = 50"),
            ("controller", "horizon_cycles = 20"),
            ("planner", "check_step_m = 0.02"),
            ("recorder", "flush_s = 0.5"),
            ("motor-box", "seed = 1"),
            ("nims", ""),
        ] {
            // The hash follows once the program file has been read.
            robot.until_reported("the hash of its program", |robot| {
                config_of(robot, process).is_some_and(|said| !text_of(&said.program_sha256).is_empty())
            });
            let said = config_of(&robot, process).unwrap();
            assert!(parameters(&said).contains(word), "{process}: {}", parameters(&said));
            assert_eq!(text_of(&said.name), process);
            let own = program.with_file_name(if process == "nims" { "supervisor" } else { process });
            assert_eq!(text_of(&said.program_sha256), hash(&own), "{process}");
            assert!(text_of(&said.version).starts_with(env!("CARGO_PKG_VERSION")), "{process}");
            let file = if process == "motor-box" { "motor-box.toml" } else { "resolved.toml" };
            assert_eq!(text_of(&said.file), robot.run().join(file).to_string_lossy(), "{process}");
        }
        assert_eq!(robot.down(Signal::INT), Some(0), "{}", robot.printed());
        let kept = runlog::read_channel::<SystemConfig>(&robot.run(), "system/config/controller").unwrap();
        assert!(parameters(&kept[0].1).contains("law = \"lq-endpoint\""), "the run file contains it");
    });
}

/// The help has a row of each parameter; the table of `docs/tuning.md` is tested in `config`.
#[test]
fn the_help_has_every_parameter() {
    let help = std::process::Command::new(crate::robot::program()).args(["set", "--help"]).output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    for one in config::tunable() {
        let row =
            |line: &&str| [&one.key, &one.accepted.to_string(), one.what].iter().all(|words| line.contains(*words));
        assert!(help.lines().any(|line| row(&line)), "no row of {}", one.key);
    }
}
