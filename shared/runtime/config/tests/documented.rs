//! Every key of a configuration file stands in each of the files that come with nims, with a word on what it is.
#![allow(clippy::unwrap_used)]

use config::{
    ArbiterSection, ControllerSection, DeviceSection, EstimatorSection, FieldSection, LinesSection,
    LoggedSensorSection, MotorBoxSection, MotorIoSection, MotorSection, PeakSection, PlannerSection, PortSection,
    ProcessSection, RealtimeSection, RecorderSection, RobotFile, RobotSection, SensorLoggerSection, SiteSection,
    SystemFile, UnitSection, ViewerSection,
};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// The keys of a section: what it says that it would have taken instead of one that it does not know.
fn keys<T: DeserializeOwned>() -> Vec<String> {
    let error = toml::from_str::<T>("no-such-key = 1").err().unwrap();
    let (_, expected) = error.message().split_once("expected ").unwrap();
    expected.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

fn files(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs").join(folder);
    std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect()
}

/// A line that gives a key, or shows what it would give, in any table.
fn gives(line: &str, key: &str) -> bool {
    let line = line.trim_start_matches(['#', ' ']);
    let inline = [format!("{{ {key} = "), format!(", {key} = ")];
    line.starts_with(&format!("{key} = ")) || inline.iter().any(|text| line.contains(text))
}

/// The lines of one table: from its head to the next one.
fn table<'a>(text: &'a str, head: &str) -> Vec<&'a str> {
    let heads = |line: &str| line.trim_start_matches(['#', ' ']).starts_with('[') && !line.starts_with("    ");
    let mut lines = text.lines().skip_while(|line| !line.trim_start_matches(['#', ' ']).starts_with(head));
    let first = lines.next().into_iter();
    first.chain(lines.take_while(|line| !heads(line))).collect()
}

fn check(folder: &str, sections: &[(&str, Vec<String>)]) {
    let files = files(folder);
    assert!(files.len() >= 3, "{files:?}");
    for path in files {
        let text = std::fs::read_to_string(&path).unwrap();
        for (head, keys) in sections {
            let lines = if head.is_empty() { text.lines().collect() } else { table(&text, head) };
            assert!(!lines.is_empty(), "{}: there is no {head}", path.display());
            for key in keys {
                let at = lines.iter().position(|line| gives(line, key));
                let at = at.unwrap_or_else(|| panic!("{}: `{key}` of {head} is not there", path.display()));
                // Behind the value, or in the line before.
                let said = [lines[at].trim_start_matches(['#', ' ']), lines[at.saturating_sub(1)]];
                assert!(said.iter().any(|line| line.contains("# ")), "{}: nothing is said of `{key}`", path.display());
            }
        }
    }
}

#[test]
fn every_key_of_a_box_file_is_in_each_of_them() {
    let tables = [
        "motor_io",
        "arbiter",
        "estimator",
        "controller",
        "planner",
        "recorder",
        "viewer",
        "sensor_logger",
        "motor_box",
        "realtime",
        "process",
    ];
    let own: Vec<String> = keys::<SystemFile>().into_iter().filter(|key| !tables.contains(&key.as_str())).collect();
    assert_eq!(own.len() + tables.len(), keys::<SystemFile>().len(), "a table has a new name");
    let without = |keys: Vec<String>, table: &str| keys.into_iter().filter(|key| key != table).collect();
    check(
        "systems",
        &[
            ("", own),
            ("[motor_io]", without(keys::<MotorIoSection>(), "ports")),
            ("[[motor_io.ports]]", [keys::<PortSection>(), keys::<UnitSection>()].concat()),
            ("[arbiter]", keys::<ArbiterSection>()),
            ("[estimator]", keys::<EstimatorSection>()),
            ("[controller]", keys::<ControllerSection>()),
            ("[planner]", keys::<PlannerSection>()),
            ("[recorder]", keys::<RecorderSection>()),
            ("[viewer]", keys::<ViewerSection>()),
            ("[sensor_logger]", without(keys::<SensorLoggerSection>(), "sensor")),
            ("[[sensor_logger.sensor]]", keys::<LoggedSensorSection>()),
            ("[motor_box]", without(keys::<MotorBoxSection>(), "device")),
            ("[[motor_box.device]]", without(keys::<DeviceSection>(), "value")),
            ("[[motor_box.device.value]]", [keys::<FieldSection>(), keys::<PeakSection>()].concat()),
            ("[realtime]", keys::<RealtimeSection>()),
            ("[[process]]", keys::<ProcessSection>()),
        ],
    );
}

#[test]
fn every_key_of_a_robot_file_is_in_each_of_them() {
    let name = keys::<RobotFile>().remove(0);
    assert_eq!(name, "name");
    check(
        "robots",
        &[
            ("", vec![name]),
            ("[robot]", keys::<RobotSection>()),
            ("[lines]", keys::<LinesSection>()),
            ("[motor]", keys::<MotorSection>()),
            ("[site]", keys::<SiteSection>()),
        ],
    );
}
