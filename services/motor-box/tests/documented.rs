//! Every configuration key is in the reference file of its kind, with a comment.
#![allow(clippy::unwrap_used)]

use config::{
    ArbiterSection, BusSection, ControllerSection, EstimatorSection, GatewaySection, LinesSection, LoggedSensorSection,
    MotorIoSection, MotorSection, ObstacleSection, PlannerSection, PluginSection, PortSection, ProcessSection,
    RealtimeSection, RecorderSection, RobotFile, RobotSection, SensorLoggerSection, SiteSection, SystemFile,
    UncertaintySection, UnitSection, ViewerSection,
};
use motor_box::section::{DeviceSection, FieldSection, MotorBoxSection, PeakSection};
use serde::de::DeserializeOwned;
use std::path::Path;

/// Returns the keys of a section, from its error message about an unknown key.
fn keys<T: DeserializeOwned>() -> Vec<String> {
    let error = toml::from_str::<T>("no-such-key = 1").err().unwrap();
    let (_, expected) = error.message().split_once("expected ").unwrap();
    expected.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// Returns whether a text line sets a key, also in a comment or an inline table.
fn sets(line: &str, key: &str) -> bool {
    let line = line.trim_start_matches(['#', ' ']);
    let inline = [format!("{{ {key} = "), format!(", {key} = ")];
    line.starts_with(&format!("{key} = ")) || inline.iter().any(|text| line.contains(text))
}

/// Returns the text lines of one table: from its header to the next header.
fn table<'a>(text: &'a str, head: &str) -> Vec<&'a str> {
    let heads = |line: &str| line.trim_start_matches(['#', ' ']).starts_with('[') && !line.starts_with("    ");
    let mut lines = text.lines().skip_while(|line| !line.trim_start_matches(['#', ' ']).starts_with(head));
    let first = lines.next().into_iter();
    first.chain(lines.take_while(|line| !heads(line))).collect()
}

fn check(file: &str, sections: &[(&str, Vec<String>)]) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(file);
    let text = std::fs::read_to_string(&path).unwrap();
    for (head, keys) in sections {
        let lines = if head.is_empty() { text.lines().collect() } else { table(&text, head) };
        assert!(!lines.is_empty(), "{file}: {head} is missing");
        for key in keys {
            let at = lines.iter().position(|line| sets(line, key));
            let at = at.unwrap_or_else(|| panic!("{file}: `{key}` of {head} is missing"));
            // The comment is after the value, or in the text line before.
            let candidates = [lines[at].trim_start_matches(['#', ' ']), lines[at.saturating_sub(1)]];
            let commented = candidates.iter().any(|line| line.contains("# "));
            assert!(commented, "{file}: `{key}` has no comment");
        }
    }
}

#[test]
fn every_key_of_a_system_file_is_in_demo3() {
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
        "bus",
        "process",
        "gateway",
        "plugin",
    ];
    let own: Vec<String> = keys::<SystemFile>().into_iter().filter(|key| !tables.contains(&key.as_str())).collect();
    assert_eq!(own.len() + tables.len(), keys::<SystemFile>().len(), "a table is missing in this test");
    let without = |keys: Vec<String>, table: &str| keys.into_iter().filter(|key| key != table).collect();
    check(
        "systems/demo3.toml",
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
            ("[motor_box]", without(without(keys::<MotorBoxSection>(), "device"), "truth")),
            ("[[motor_box.device]]", without(keys::<DeviceSection>(), "value")),
            ("[[motor_box.device.value]]", [keys::<FieldSection>(), keys::<PeakSection>()].concat()),
            ("[realtime]", keys::<RealtimeSection>()),
            ("[bus]", keys::<BusSection>()),
            ("[[process]]", keys::<ProcessSection>()),
            ("[gateway]", keys::<GatewaySection>()),
            ("[[plugin]]", keys::<PluginSection>()),
        ],
    );
}

#[test]
fn every_key_of_a_robot_file_is_in_lab3() {
    let name = keys::<RobotFile>().remove(0);
    assert_eq!(name, "name");
    check(
        "robots/lab3.toml",
        &[
            ("", vec![name]),
            ("[robot]", keys::<RobotSection>()),
            ("[lines]", keys::<LinesSection>()),
            ("[motor]", keys::<MotorSection>()),
            ("[uncertainty]", keys::<UncertaintySection>()),
            ("[site]", keys::<SiteSection>()),
            ("[[obstacle]]", keys::<ObstacleSection>()),
        ],
    );
}
