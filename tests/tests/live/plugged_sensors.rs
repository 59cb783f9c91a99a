//! Custom sensors on the robot in flight: plugged in, replaced, killed and restarted, in Rust and in Python, from the
//! unmodified templates. The cost is read from the run file.
//!
//! `NIMS_REPLACEMENTS=50 cargo test --workspace --test live plugged_sensors::` replaces them fifty times.

use crate::robot::{Robot, root, samples_of, steadily};
use messages::{Header, MotorAuthority, MotorState, ProcessState, Request, text_of};
use nims_tests::python;
use rustix::process::Signal;
use std::collections::BTreeMap;
use std::path::Path;

messages::message! {
    /// The message of both templates: the same type in both languages.
    pub struct Example {
        header: Header,
        value_v: f64,
        samples: [f64; 4],
    }
}

/// A second controller and a second estimator, which answer if the machine delays the first ones for a moment.
const STANDBYS: &str = "\n[[process]]\nname = \"controller-b\"\nrole = \"controller\"\nstandby = true\n\
    \n[[process]]\nname = \"estimator-b\"\nrole = \"estimator\"\nstandby = true\n";
/// Cycles of quiet flight before the first sensor starts and after the last one ends.
const QUIET_CYCLES: u64 = 300;
/// Rate at which the templates read their device, 1/s.
const RATE_HZ: u64 = 10;
/// Cycles between a period lost to the computer and a command that is missing because of it.
const FROZEN_CYCLES: u64 = 5;

/// The way of a sensor in Python that is one of the robot's own processes.
const SHARED: &str = "--shared-memory";

/// A motion to and fro for a quarter of an hour.
fn fly_for_long(robot: &mut Robot) {
    let mut mission = "name = \"to and fro\"\nspeed_m_s = 0.15\n".to_owned();
    for _ in 0..40 {
        mission +=
            "[[leg]]\npolyline = { points_m = [[5.6, 3.4, 0.6], [4.8, 4.0, 0.9], [4.0, 3.4, 0.6], [4.8, 3.0, 0.3]] }\n";
    }
    std::fs::write(robot.folder().join("fro.toml"), mission).unwrap();
    robot.arm();
    // A cycle without readings has no estimate, and then the planner has no starting point.
    robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    for _ in 0..50 {
        if robot.nims(&["run", "./fro.toml"]).status.success() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    robot.until("the mission has begun", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
}

/// The template in Python with its files (`sensor.py`), and a copy with another field under the same name (`other.py`).
fn copy_templates(robot: &Robot) {
    for file in ["templates/sensor.py", "python/nims_sensor.py"] {
        let from = root().join("scripts").join(file);
        std::fs::copy(&from, robot.folder().join(from.file_name().unwrap())).unwrap();
    }
    let text = std::fs::read_to_string(robot.folder().join("sensor.py")).unwrap();
    std::fs::write(robot.folder().join("other.py"), text.replace("value_v", "value_a")).unwrap();
}

/// Periods without an answer between `first` and `last` without a nearby shortage of computing time.
fn unanswered(run: &Path, first: u64, last: u64) -> u64 {
    let mut samples = samples_of::<MotorAuthority>(run, "motor/authority");
    samples.retain(|sample| (first..=last).contains(&sample.header.cycle));
    assert!(samples.len() as u64 > (last - first) * 95 / 100, "the run file lacks cycles");
    let grown = |of: fn(&MotorAuthority) -> u64| {
        samples.windows(2).filter(move |two| of(&two[1]) > of(&two[0])).map(|two| two[1].header.cycle)
    };
    let starved: Vec<u64> = grown(|sample| sample.lost_computer).collect();
    grown(|sample| sample.lost_answer)
        .filter(|cycle| starved.iter().all(|starved| starved.abs_diff(*cycle) > FROZEN_CYCLES))
        .count() as u64
}

/// Checks that every life of a sensor is in the run file: no gap after its first sample, which is from within the first
/// second. Two lives may overlap, as those of a program and its successor do: the number of a sample shows which one
/// published it.
fn lives(run: &Path, channel: &str) -> u64 {
    let samples = runlog::read_channel::<Example>(run, channel).unwrap();
    let (mut lives, mut last) = (0, Vec::new());
    for (_, Example { header, value_v, samples }) in samples {
        // The value is the number of the sample, from 0: a new life restarts it.
        let count = header.seq - 1;
        match last.iter_mut().rev().take(2).find(|last| **last + 1 == header.seq) {
            Some(last) => *last = header.seq,
            None => {
                lives += 1;
                assert!(header.seq <= RATE_HZ, "{channel}: life {lives} begins with sample {}", header.seq);
                last.push(header.seq);
            }
        }
        assert!((value_v - 0.1 * count as f64).abs() < 1e-9 && samples[3] == count as f64 + 3.0);
    }
    lives
}

/// Both appear under their names, with their fields, and no other process is restarted.
fn both_appear(robot: &mut Robot, python: &str) {
    robot.accepted(&["plug", "soil", "--", "my-sensor"]);
    robot.accepted(&["plug", "leaf", "--", python, "sensor.py", SHARED]);
    for name in ["soil", "leaf"] {
        let channel = format!("sensor/{name}");
        let mut subscriber = robot.bus.subscriber::<Example>(&channel).unwrap();
        robot.until("a sample", |_| true);
        let said = robot.accepted(&["channel", "echo", &channel, "-n", "3"]);
        assert_eq!(said.lines().filter(|line| line.contains("\"value_v\":")).count(), 3, "{said}");
        assert!(subscriber.latest().unwrap().is_some());
        assert!(robot.accepted(&["channel", "list"]).contains(&format!("{channel}  ")));
    }
}

/// No process of the control cycle has a sensor's channel open, so that no sensor can delay it.
fn no_process_of_the_cycle_reads_a_sensor(robot: &Robot) {
    for channel in robot.bus.channels().unwrap().iter().filter(|channel| channel.name.starts_with("sensor/")) {
        let holders: Vec<&str> = channel.holders.iter().map(|node| node.name.as_str()).collect();
        let own = channel.name.trim_start_matches("sensor/");
        assert!(
            holders.iter().all(|name| [own, "recorder", "observer"].contains(name)),
            "{}: {holders:?}",
            channel.name
        );
    }
}

/// Nothing is lost, and two types with one name in one file are distinguished.
fn types_are_recorded_apart(run: &Path) {
    let report = runlog::info(run).unwrap();
    let lossy: Vec<_> = report.channels.iter().filter(|channel| channel.lost > 0).collect();
    assert!(lossy.is_empty(), "{lossy:?}");
    let schema = |name: &str| {
        report.channels.iter().find(|channel| channel.name == format!("sensor/{name}")).unwrap().schema.clone()
    };
    assert_eq!((schema("soil"), schema("leaf")), ("nims_msgs/msg/Example".into(), "nims_msgs/msg/Example".into()));
    assert!(schema("leaf-2").starts_with("nims_msgs/msg/ExampleX"), "{}", schema("leaf-2"));
}

#[test]
fn sensors_are_replaced_in_flight_at_no_cost() {
    steadily(|| {
        let rounds: u64 = std::env::var("NIMS_REPLACEMENTS").map_or(3, |count| count.parse().unwrap());
        let python = python();
        let path = |path: &Path| path.to_str().unwrap().to_owned();
        let mut robot = Robot::up(STANDBYS);
        copy_templates(&robot);
        fly_for_long(&mut robot);
        let begun = robot.last.header.cycle;
        robot.until("quiet flight", |robot| robot.last.header.cycle > begun + QUIET_CYCLES);
        let first = robot.last.header.cycle;

        both_appear(&mut robot, &path(&python));
        let mut killed = 0;
        for round in 0..rounds {
            let mut samples = robot.bus.subscriber::<Example>("sensor/soil").unwrap();
            match round % 3 {
                0 => {
                    robot.accepted(&["plug", "soil", "--replace", "--", "my-sensor"]);
                }
                1 => {
                    killed += 1;
                    robot.signal("soil", Signal::KILL);
                    robot
                        .until("its end is known", |robot| robot.domain.alive().iter().all(|node| node.name != "soil"));
                    // In the other language, under the same name and with the same type.
                    let python = path(&python);
                    robot.accepted(&["plug", "soil", "--replace", "--", &python, "sensor.py", SHARED]);
                }
                _ => {
                    robot.accepted(&["restart", "soil"]);
                }
            }
            while samples.latest().unwrap().is_some() {}
            let now = robot.last.header.cycle;
            let give_up = bus::clock::now_ns() + 20_000_000_000;
            while samples.receive().unwrap().is_none_or(|sample| sample.header.seq < 3) {
                assert!(bus::clock::now_ns() < give_up, "round {round}: the sensor publishes nothing");
                std::thread::sleep(std::time::Duration::from_millis(20));
            }
            robot.until("the next cycle", |robot| robot.last.header.cycle > now);
            if robot.last.mode != MotorAuthority::MODE_FOLLOWING {
                // Whether the machine caused that is checked below.
                robot.ask("motor-io", Request::Resume);
            }
        }
        no_process_of_the_cycle_reads_a_sensor(&robot);
        // Other fields under the old name are rejected, with what to do; under a new name they are accepted.
        let output = robot.nims(&["plug", "leaf", "--replace", "--", &path(&python), "other.py", SHARED]);
        assert!(!output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        robot.accepted(&["plug", "leaf-2", "--", &path(&python), "other.py", SHARED]);
        robot.accepted(&["channel", "echo", "sensor/leaf-2", "-n", "1"]);
        robot.accepted(&["unplug", "soil"]);
        robot.accepted(&["unplug", "leaf-2"]);
        robot.poll();
        let last = robot.last.header.cycle;
        robot.until("quiet flight", |robot| robot.last.header.cycle > last + QUIET_CYCLES);
        assert_eq!(robot.down(Signal::INT), Some(1), "nims up exits with success although a sensor was killed");
        let run = robot.run();

        let (quiet, disturbed) = (
            unanswered(&run, begun, first) + unanswered(&run, last, last + QUIET_CYCLES),
            unanswered(&run, first, last),
        );
        println!("periods without an answer: {disturbed} of {}; {quiet} in quiet flight", last - first);
        // A machine that misses cycles without a new sensor is too busy for a statement about sensors.
        assert!(disturbed == 0 || quiet > 0, "{disturbed} periods without an answer, and none in quiet flight");
        assert_eq!(lives(&run, "sensor/soil"), rounds + 1);
        assert_eq!(lives(&run, "sensor/leaf"), 1);
        types_are_recorded_apart(&run);
        let states = runlog::read_channel::<MotorState>(&run, "motor/state").unwrap();
        println!("{rounds} replacements ({killed} by SIGKILL) in {} cycles", states.len());
    });
}

#[test]
fn a_successor_that_does_not_speak_costs_nothing() {
    steadily(|| {
        let python = python();
        let python = python.to_str().unwrap();
        let mut robot = Robot::up("");
        copy_templates(&robot);
        robot.accepted(&["plug", "soil", "--", "my-sensor"]);
        robot.accepted(&["channel", "echo", "sensor/soil", "-n", "1"]);
        let before = robot.pid_in_table("soil").unwrap();

        // One that ends, one of another type, and one that never publishes: the previous one keeps publishing. What the
        // first one printed is part of the reason.
        for (command, why) in [
            (vec!["sh", "-c", "echo the cable is off >&2; exit 3"], "the cable is off"),
            (vec![python, "other.py", SHARED], "soil"),
            (vec!["sleep", "1000"], "soil"),
        ] {
            let mut args = vec!["plug", "soil", "--replace", "--"];
            args.extend(command);
            let output = robot.nims(&args);
            let sentence = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(!output.status.success() && sentence.contains(why), "{sentence}");
            assert_eq!(
                (robot.pid_in_table("soil"), robot.state("soil").as_str()),
                (Some(before), "ready"),
                "{sentence}"
            );
        }

        // One that publishes has the name from then on; the previous one published until then.
        robot.accepted(&["plug", "soil", "--replace", "--", python, "sensor.py", SHARED]);
        let after = robot.pid_in_table("soil").unwrap();
        assert_ne!(after, before);
        assert_eq!(robot.down(Signal::INT), Some(0), "no process ended");
        // Without a gap in either: two lives.
        assert_eq!(lives(&robot.run(), "sensor/soil"), 2);
        // It has the name only after its first sample.
        let readings = samples_of::<Example>(&robot.run(), "sensor/soil");
        let first = readings.windows(2).find(|two| two[1].header.seq < two[0].header.seq).unwrap()[1].header;
        let rows = samples_of::<ProcessState>(&robot.run(), "system/process");
        let named = rows.iter().find(|row| text_of(&row.name) == "soil" && row.pid == after).unwrap().header;
        assert!(first.published_ns < named.published_ns, "{first:?} {named:?}");
        // Rows that have not changed come in parts, spread over the period of the table.
        let mut last = BTreeMap::new();
        let is_same = |before: ProcessState, row: &ProcessState| ProcessState { header: row.header, ..before } == *row;
        let again = rows.iter().filter(|row| last.insert(row.name, **row).is_some_and(|before| is_same(before, row)));
        let stamps: Vec<u64> = again.map(|row| row.header.stamp_ns).collect();
        let close = stamps.windows(2).filter(|two| two[1] - two[0] < 50_000_000).count();
        assert!(stamps.len() > 10 && 2 * close < stamps.len(), "{close} of {}", stamps.len());
    });
}
