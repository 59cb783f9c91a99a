//! A run drawn in three dimensions: independent readers find every cable, pose and point at its position.

use messages::ros::TfMessage;
use messages::{FieldMap, LogEvent, Message, NodeEstimate, Reading, Request, put_text};
use nims::visualization_export::export_visualization;
use nims_tests::python;
use nims_tests::recorded::record;
use nims_tests::scenarios::{self, Case};
use runlog::{ChannelSpec, RunReader, RunWriter, read_channel};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Content of a process's log in the run.
const SAID: &str = "the line \u{e4} is taut";

/// The lockstep run, and a log event and a map in a second file of it.
fn run(folder: &Path) -> PathBuf {
    let case = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] };
    let system_path = format!("{}/../configs/systems/demo3.toml", env!("CARGO_MANIFEST_DIR"));
    let run = folder.join("run");
    std::fs::create_dir(&run).unwrap();
    record(&run.join("run.mcap"), Path::new(&system_path), &case, 6.0, true).unwrap();
    let mut reader = RunReader::open(&run).unwrap();
    reader.next_sample().unwrap().unwrap();
    let clock = reader.clock().unwrap();
    let mut writer = RunWriter::create(&run.join("run-0002.mcap"), clock, &Default::default(), &[]).unwrap();
    let channel = writer.add_channel(&ChannelSpec::for_type::<LogEvent>("system/log/motor-io")).unwrap();
    let mut event = LogEvent { level: LogEvent::LEVEL_WARN, ..LogEvent::default() };
    let stamp_ns = 6_100_000_000;
    event.header_mut().stamp_ns = stamp_ns;
    put_text(&mut event.process, "motor-io");
    put_text(&mut event.text, SAID);
    writer.write(channel, 1, stamp_ns, stamp_ns, bytemuck::bytes_of(&event)).unwrap();
    let channel = writer.add_channel(&ChannelSpec::for_type::<FieldMap>("map/height")).unwrap();
    let mut map = FieldMap { origin_m: [1.5, -2.0], cell_m: 0.25, columns: 2, rows: 2, ..FieldMap::default() };
    map.value[..4].copy_from_slice(&[1.0, f32::NAN, 3.0, 2.0]);
    map.header_mut().stamp_ns = stamp_ns;
    writer.write(channel, 1, stamp_ns, stamp_ns, bytemuck::bytes_of(&map)).unwrap();
    writer.finish(&Default::default()).unwrap();
    run
}

#[test]
fn a_run_is_drawn_and_read_field_by_field() {
    let folder = tempfile::tempdir().unwrap();
    let run = run(folder.path());
    let out = folder.path().join("visualization.mcap");
    let command::Output { value, words, .. } = export_visualization(&run, &out).unwrap();
    assert!(value["frames"].as_u64().unwrap() > 100, "{words}");
    let again = export_visualization(&run, &out).unwrap_err();
    assert_eq!(again.exit_code(), 2, "{again}");

    let mut reader = RunReader::open(&run).unwrap();
    reader.next_sample().unwrap().unwrap();
    let clock = reader.clock().unwrap();
    let (mut places, mut tensions) = (Map::new(), Map::new());
    for (_, estimate) in read_channel::<NodeEstimate>(&run, "node/estimate/a").unwrap() {
        let key = clock.unix_of(estimate.header.stamp_ns).to_string();
        places.insert(key.clone(), json!(estimate.position_m));
        tensions.insert(key, json!(estimate.tension_n));
    }
    let readings = read_channel::<Reading>(&run, "sensor/height").unwrap();
    let reading = readings.last().unwrap().1;
    let value = reading.value[0] as f32;
    let estimates = read_channel::<NodeEstimate>(&run, "node/estimate/a").unwrap();
    let near = estimates.iter().map(|(_, e)| e).find(|e| e.header.cycle == reading.header.cycle).unwrap();
    let sample: Vec<Value> = near.position_m.iter().map(|x| json!(*x as f32)).chain([json!(value)]).collect();
    let anchors: Vec<[f64; 3]> = scenarios::robot("lab3").unwrap().anchors().iter().map(|a| (*a).into()).collect();
    let expected = json!({
        "anchors": anchors, "places": places, "tensions": tensions, "last_sample": sample,
        "log": { "name": "motor-io", "msg": SAID, "level": 30, "file": "", "line": 0 },
        "map": { "resolution": 0.25, "width": 64, "height": 64 }, "corner": [1.5, -2.0, 0.0], "cells": [0, 100, 50],
    });
    let file = folder.path().join("expected.json");
    std::fs::write(&file, expected.to_string()).unwrap();

    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = python();
    let printed = |script: &str, more: &[&Path]| {
        let output = Command::new(&python).arg(root.join(script)).arg(&out).args(more).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
        said
    };
    let checked = printed("python/check_visualization.py", &[&file]);
    assert_eq!(checked.lines().filter(|line| line.ends_with("as expected")).count(), 2, "{checked}");
    // the project's reader for analysts, including texts and lists
    let reader = printed("python/check_reader.py", &[]);
    assert!(reader.contains(" samples on 8 channels agree"), "{reader}");
}

/// Largest number of polls, 10 ms apart.
const LOOKS: usize = 2000;

#[test]
fn a_living_robot_is_drawn_too() {
    let command = r#"["visualization", "--name", "{name}", "--domain", "{domain}", "--system", "{system}"]"#;
    let mut robot = crate::robot::Robot::up(&format!("\n[[process]]\nname = \"visualization\"\ncommand = {command}\n"));
    let mut transforms = robot.bus.subscriber::<TfMessage>("tf").unwrap();
    let start_m = [4.8, 3.0, 0.3];
    robot.ask("motor-io", Request::Arm);
    robot.ask("motor-io", Request::ZeroAt { position_m: start_m });
    let mut look = || {
        std::thread::sleep(std::time::Duration::from_millis(10));
        transforms.latest().unwrap()
    };
    let TfMessage(body) = (0..LOOKS).find_map(|_| look()).expect("nothing is drawn");
    // after the count, the header and the child's name
    for (axis, start_m) in start_m.iter().enumerate() {
        let at = 32 + 8 * axis;
        let drawn_m = f64::from_le_bytes(body[at..at + 8].try_into().unwrap());
        assert!((drawn_m - start_m).abs() < 0.05, "axis {axis}: {drawn_m} m");
    }
    let find = |name: &str| {
        std::thread::sleep(std::time::Duration::from_millis(10));
        robot.bus.channel(name).unwrap()
    };
    for name in ["visualization/pose", "visualization/robot", "visualization/plan", "visualization/track", "log"] {
        let info = (0..LOOKS).find_map(|_| find(name)).unwrap_or_else(|| panic!("there is no {name}"));
        let known = messages::channel_of(name).unwrap();
        assert_eq!(info.schema.as_deref(), known.schema.map(|schema| schema()), "{name}");
    }
    // The time of a drawing is that of the run file, to the nanosecond: both use the clock of the run.
    let number = |at: usize| u64::from(u32::from_le_bytes(body[at..at + 4].try_into().unwrap()));
    let drawn_ns = 1_000_000_000 * number(4) + number(8);
    assert_eq!(robot.down(rustix::process::Signal::INT), Some(0), "{}", robot.printed());
    let clock = RunReader::open(&robot.run()).unwrap().clock().unwrap();
    let estimates = read_channel::<NodeEstimate>(&robot.run(), "node/estimate/a").unwrap();
    let exactly = |(_, estimate): &(u64, NodeEstimate)| clock.unix_of(estimate.header.stamp_ns) == drawn_ns;
    assert!(estimates.iter().any(exactly), "drawn at {drawn_ns}, a time without an estimate in the run");
}
