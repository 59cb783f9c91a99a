//! An encoder calibration takes effect on the robot: one whose encoders count 1 % off, calibrated by its own lengths,
//! flies true afterwards.

use config::{RobotFile, SystemFile};
use messages::PlanStatus;
use nims_tests::lockstep::{Chain, Lockstep};
use nims_tests::scenarios::{COUNTS_PER_M, Case};
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

/// Counts per metre in the system file: the robot's lengths read 1 % too long.
const BELIEVED: f64 = COUNTS_PER_M / 1.01;
const CASE: Case = Case { robot: "lab3", mission: "polyline", motor_s: [0.03, 0.04] };

fn configs() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs")
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// A robot and a system file in `folder` with these encoders, and with `anchors` in the robot file.
fn files(folder: &Path, anchors: Option<&str>) -> SystemFile {
    let robot = std::fs::read_to_string(configs().join("robots/lab3.toml")).unwrap();
    let (from, to) = (robot.find("anchors_m = [").unwrap(), robot.find("tension_limits_n").unwrap());
    let robot = match anchors {
        Some(line) => format!("{}{line}\n{}", &robot[..from], &robot[to..]),
        None => robot,
    };
    let said = std::fs::read_to_string(configs().join("systems/demo3.toml")).unwrap();
    let counts = format!("counts_per_m = [{BELIEVED}, {BELIEVED}, {BELIEVED}]");
    let said = said.replace("counts_per_m = [10865.0, 10865.0, 10865.0]", &counts);
    let said = said.replace("../robots/lab3.toml", "robot.toml");
    assert!(said.contains(&counts));
    std::fs::write(folder.join("robot.toml"), robot).unwrap();
    std::fs::write(folder.join("system.toml"), said).unwrap();
    SystemFile::load(&folder.join("system.toml")).unwrap()
}

/// Flies the mission with the files and a robot whose encoders give [`COUNTS_PER_M`]; returns the mean distance between
/// the estimate and the true position of the node in flight, m.
fn flown_m(file: &SystemFile) -> f64 {
    let scenario = CASE.scenario(true).unwrap();
    let mission = scenario.mission.clone();
    let mut lockstep = Lockstep::with(scenario, Chain::from_file(file).unwrap()).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(&mission).unwrap();
    let (mut sum, mut count) = (0.0, 0);
    for _ in 0..20_000 {
        let cycle = lockstep.cycle().unwrap();
        if cycle.plan.state == PlanStatus::STATE_RUNNING {
            sum += distance(cycle.truth_m, cycle.estimate.position_m).powi(2);
            count += 1;
        }
        assert_ne!(cycle.plan.state, PlanStatus::STATE_ABORTED, "the flight was aborted");
        if cycle.plan.state == PlanStatus::STATE_DONE {
            return (sum / f64::from(count)).sqrt();
        }
    }
    panic!("the mission does not end");
}

/// A field team's notes: ranges between the true anchors, and the robot's cable lengths while a person holds the node
/// at points of the floor, zeroed at the start with anchors that are known to some centimetres.
fn measurements() -> String {
    let anchors = RobotFile::load(&configs().join("robots/lab3.toml")).unwrap().robot.anchors_m.to_vec();
    let mut text = format!(
        "sigma_length_m = 0.001\nsigma_scale = 0.02\nsigma_offset_m = 0.2\ncounts_per_m = [{BELIEVED}, {BELIEVED}, {BELIEVED}]\n"
    );
    for (from, to) in [(0, 1), (0, 2), (1, 2)] {
        let [a, b] = [anchors[from], anchors[to]];
        let m = (a[0] - b[0]).hypot(a[1] - b[1]);
        let _ = writeln!(text, "[[range]]\nfrom = {}\nto = {}\nm = {m}\nsigma_m = 0.001", from + 1, to + 1);
    }
    let zero = [4.8, 3.0, 0.0];
    for k in 0..30 {
        let share = f64::from(k) / 30.0;
        let (angle, reach) = (share * 40.0, 0.5 + 2.6 * share);
        let at = [4.8 + reach * angle.cos(), 2.9 + 0.8 * reach * angle.sin(), 0.0];
        let lengths: Vec<String> = anchors
            .iter()
            .map(|anchor| {
                let from = distance(*anchor, zero);
                let counts = ((distance(*anchor, at) - from) * COUNTS_PER_M).round();
                format!("{}", from + 0.03 + counts / BELIEVED)
            })
            .collect();
        let _ = writeln!(text, "[[point]]\nlengths_m = [{}]", lengths.join(", "));
    }
    text
}

#[test]
fn a_robot_with_encoders_that_are_off_flies_true_after_a_calibration_by_its_own_lengths() {
    let folder = tempfile::tempdir().unwrap();
    let before_m = flown_m(&files(folder.path(), None));
    let (measured, site) = (folder.path().join("measured.toml"), folder.path().join("site.toml"));
    std::fs::write(&measured, measurements()).unwrap();
    let [measured, site] = [&measured, &site].map(|path| path.to_str().unwrap());
    let found = nims(&["--json", "calibrate", measured, "--method", "joint", "--out", site]);
    let found: serde_json::Value = serde_json::from_str(&found).unwrap();
    let scale = found["scale"].as_f64().unwrap();
    assert!((scale - 1.01).abs() < 5e-4, "{found}");
    let file = files(folder.path(), Some("calibration = \"site.toml\""));
    let counts = &file.motor_io.counts_per_m;
    assert!(counts.iter().all(|counts| (counts / COUNTS_PER_M - 1.0).abs() < 5e-4), "{counts:?}");
    let after_m = flown_m(&file);
    println!("{:.1} mm before, {:.1} mm after; scale {scale:.5}", 1e3 * before_m, 1e3 * after_m);
    assert!(before_m > 0.01 && after_m < 0.2 * before_m && after_m < 0.004, "{before_m} {after_m}");
    // The figures in the report: the scale, and the counts that it leads to.
    let said = nims(&["check", folder.path().join("system.toml").to_str().unwrap()]);
    assert!(said.contains(&format!("{scale:.4}")) && said.contains(&format!("{:.1}", counts[0])), "{said}");
}

/// Output of the operator's command.
fn nims(args: &[&str]) -> String {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    let output = Command::new(program).args(args).output().unwrap();
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}
