//! Tables of `nims.Run` in Python beside the figures of `nims report` of the same run.

use analysis::report::figures;
use messages::{Header, MotorAuthority, MotorInput};
use nims_tests::record;
use nims_tests::scenarios::Case;
use runlog::{ChannelSpec, RunClock, RunWriter};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

const PERIOD_NS: u64 = 10_000_000;
const CLOCK: RunClock = RunClock { t0_unix_ns: 1_767_225_600_000_000_000, t0_mono_ns: 0 };
/// Prints tables as JSON, which has no NaN.
const SCRIPT: &str = "import json, sys, nims
run = nims.Run(sys.argv[1])
plain = lambda rows: [{key: None if value != value else value for key, value in row.items()} for row in rows]
print(json.dumps({name: plain(getattr(run, name)()) for name in sys.argv[2:]}))";

/// Returns a table of a run.
fn table(run: &Path, name: &str) -> Vec<Value> {
    let modules = concat!(env!("CARGO_MANIFEST_DIR"), "/../scripts/python");
    let output = Command::new(nims_tests::python())
        .env("PYTHONPATH", modules)
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .args(["-c", SCRIPT])
        .arg(run)
        .arg(name)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice::<Value>(&output.stdout).unwrap()[name].as_array().unwrap().clone()
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("{key} in {row}"))
}

/// A run in which motor-io was restarted twice: the first time during a motion.
fn three_lives(run: &Path) {
    let mut writer = RunWriter::create(&run.join("run.mcap"), CLOCK, &Default::default(), &[]).unwrap();
    let channels = [
        writer.add_channel(&ChannelSpec::for_type::<MotorInput>("motor/input")).unwrap(),
        writer.add_channel(&ChannelSpec::for_type::<MotorAuthority>("motor/authority")).unwrap(),
    ];
    let mut write = |life: u64, cycle: u64, periods: u64, mission: u32, authority: MotorAuthority| {
        let stamp_ns = periods * PERIOD_NS;
        let header = Header { life, cycle, seq: cycle, ..Header::at(stamp_ns) };
        let input = MotorInput { header, tick_ns: stamp_ns, mission, ..MotorInput::default() };
        let authority = MotorAuthority { header, period_s: 0.01, cable_count: 3, ..authority };
        writer.write(channels[0], cycle, stamp_ns, stamp_ns, bytemuck::bytes_of(&input)).unwrap();
        writer.write(channels[1], cycle, stamp_ns, stamp_ns, bytemuck::bytes_of(&authority)).unwrap();
    };
    let none = MotorAuthority::PERIOD_NO_MISSION;
    for cycle in 1..=100 {
        let (motion, period) = (u32::from(cycle >= 10), if cycle > 10 { MotorAuthority::PERIOD_STEERED } else { none });
        let lost_computer = if cycle >= 50 { 3 } else { 0 };
        write(1, cycle, cycle, 1, MotorAuthority { motion, period, lost_computer, ..Default::default() });
    }
    // 50 periods without motor-io. The mission of before waits for 20 cycles, in which two ticks are missed.
    for cycle in 1..=60 {
        let flies = cycle > 20;
        let period = if cycle > 21 { MotorAuthority::PERIOD_STEERED } else { none };
        let (motion, lost_drive) = (if flies && cycle < 60 { 2 } else { 0 }, if cycle >= 40 { 4 } else { 0 });
        let at = 150 + cycle + if cycle > 10 { 2 } else { 0 };
        let authority = MotorAuthority { motion, period, lost_drive, ..Default::default() };
        write(2, cycle, at, if flies { 2 } else { 1 }, authority);
    }
    // The first cycles of this life are not in the file, and its first count is larger than the last one before.
    for cycle in 5..=20 {
        let authority = MotorAuthority { lost_drive: 9, period: none, ..Default::default() };
        write(3, cycle, 300 + cycle, 0, authority);
    }
    writer.finish(&Default::default()).unwrap();
}

#[test]
fn periods_are_counted_over_all_lives_as_in_the_report() {
    let folder = tempfile::tempdir().unwrap();
    three_lives(folder.path());
    let causes = table(folder.path(), "causes");
    let found: Vec<(&str, u64, f64)> = causes
        .iter()
        .map(|row| (row["cause"].as_str().unwrap(), row["periods"].as_u64().unwrap(), number(row, "begin_s")))
        .collect();
    let wanted = [("computer", 3, 0.5), ("answer", 72, 1.0), ("drive", 4, 1.92), ("drive", 9, 3.05)];
    assert_eq!(found.len(), wanted.len(), "{found:?}");
    for (found, wanted) in found.iter().zip(wanted) {
        assert!(found.0 == wanted.0 && found.1 == wanted.1 && (found.2 - wanted.2).abs() < 1e-6, "{found:?}");
    }
    let sum: u64 = found.iter().map(|(_, periods, _)| periods).sum();
    assert_eq!(figures(folder.path()).unwrap()["unsteered"], sum);
}

/// The flight has a swap of the controllers and a pause in its legs.
#[test]
fn legs_are_those_of_the_report_also_after_a_swap() {
    const CASE: Case = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] };
    let folder = tempfile::tempdir().unwrap();
    let system_path = record::system_with(folder.path(), "demo3", &[]).unwrap();
    let run = record::fly(&folder.path().join("run.mcap"), &system_path, &CASE, 900).unwrap();
    let (legs, figures) = (table(&run, "legs"), figures(&run).unwrap());
    let wanted = figures["legs"].as_array().unwrap();
    let slots: Vec<&str> =
        figures["in_charge"].as_array().unwrap().iter().map(|one| one["slot"].as_str().unwrap()).collect();
    assert!(slots.contains(&"b") && wanted.len() >= 2, "{slots:?}");
    assert_eq!(legs.len(), wanted.len(), "{legs:?}");
    for (leg, wanted) in legs.iter().zip(wanted) {
        let begin_s = number(wanted, "begin_s");
        assert!((number(leg, "begin_s") - begin_s).abs() < 0.021, "{leg}, {begin_s} s");
        assert!((number(leg, "end_s") - begin_s - number(wanted, "duration_s")).abs() < 0.021, "{leg} {wanted}");
        for (own, theirs) in [("error_rms_m", "rms_m"), ("error_max_m", "max_m")] {
            let theirs = number(&wanted["estimate"], theirs);
            assert!((number(leg, own) / theirs - 1.0).abs() < 0.02, "{own} is {}, in the report {theirs}", leg[own]);
        }
    }
}
