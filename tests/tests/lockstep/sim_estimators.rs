//! `nims sim` with an estimator in a program of its own.

use crate::method::MyEstimator;
use crate::sim::{flights, fly, number, project, python, script};
use estimator::Estimator;
use nims_tests::lockstep::{Chain, fly_chain};
use nims_tests::scenarios::planar;
use serde_json::Value;
use std::io::{Read, Write};
use std::process::{Command, Stdio};

/// Both templates compute the same as the method of the template inside the flight, bit for bit.
#[test]
fn an_estimator_in_its_own_program_flies_as_one_inside() {
    let file = config::SystemFile::load(&project().join("configs/systems/aq4.toml")).unwrap();
    let chain = Chain::from_file(&file).unwrap();
    let estimator = Estimator::with_method(chain.estimator.config(), Box::new(MyEstimator::default()));
    let inside = fly_chain(planar().unwrap(), Chain { estimator, ..chain }, |_| Ok(())).unwrap();
    let standard = flights(&fly("aq4", &[]));
    assert_ne!(number(&standard[0], "/truth/max_m"), inside.truth.max_m, "the method makes no difference");
    let rust = env!("CARGO_BIN_EXE_my-estimator").to_owned();
    let script = project().join("scripts/templates/estimator.py");
    let python = format!("env PYTHONPATH={} python3 {}", project().join("scripts/python").display(), script.display());
    for program in [rust, python] {
        let own = flights(&fly("aq4", &["--estimator-program", &program]));
        assert_eq!(number(&own[0], "/tracking/rms_m"), inside.estimate.rms_m, "{program}");
        assert_eq!(number(&own[0], "/truth/max_m"), inside.truth.max_m, "{program}");
        assert_eq!(number(&own[0], "/energy_j"), inside.energy_j, "{program}");
    }
}

/// The programs of both templates for an estimator.
fn templates() -> [String; 2] {
    [env!("CARGO_BIN_EXE_my-estimator").to_owned(), python(&project().join("scripts/templates/estimator.py"))]
}

/// The answers of a program to these lines, without that to the first one.
fn answers(program: &str, lines: &[Value]) -> Vec<Value> {
    let asked: String = lines.iter().map(|line| format!("{line}\n")).collect();
    let program = format!("{program} --lockstep --system {}", lines[0]["system"].as_str().unwrap());
    let mut child = Command::new("sh").args(["-c", &program]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let child = child.as_mut().unwrap();
    child.stdin.take().unwrap().write_all(asked.as_bytes()).unwrap();
    let mut said = String::new();
    child.stdout.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(child.wait().unwrap().success(), "{program}");
    said.lines().skip(1).map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// A silence is bridged by its cycles, of which more last as long at 500 Hz; the times of readings vary a little.
#[test]
fn both_templates_bridge_as_many_cycles() {
    let system = project().join("configs/systems/demo3.toml");
    for (period_ns, silence, is_bridged) in
        [(10_000_000, 3, true), (10_000_000, 4, false), (2_000_000, 6, true), (2_000_000, 7, false)]
    {
        let mut lines = vec![serde_json::json!({ "system": system, "cables": 3 })];
        for cycle in 1..=4 + silence {
            let is_last = cycle == 4 + silence;
            let length_m = (cycle <= 4 || is_last).then_some(5.0 + 0.001 * cycle as f64);
            let at_ns = cycle * period_ns + if is_last { 300_000 } else { 0 };
            lines.push(serde_json::json!({
                "cycle": cycle, "period_s": 1e-9 * period_ns as f64, "instant_ns": at_ns + 1_000_000,
                "lengths_m": vec![length_m; 3], "sampled_ns": vec![at_ns; 3], "ahead_s": vec![0.001; 3],
                "commands_m_s": vec![0.1; 3], "forget": false, "expect_anything": false,
            }));
        }
        let velocities = templates().map(|program| {
            let last = answers(&program, &lines).pop().unwrap();
            last[0]["velocity_m_s"].as_f64().unwrap()
        });
        let [rust, python] = velocities;
        assert!((rust - python).abs() < 1e-12, "{period_ns} {silence}: {velocities:?}");
        assert_eq!(rust != 0.0, is_bridged, "{period_ns} {silence}: {velocities:?}");
    }
}

/// The operator sets the lengths in a cycle in which one cable has no reading.
#[test]
fn both_templates_expect_any_reading_of_a_cable_until_it_has_one() {
    let system = project().join("configs/systems/demo3.toml");
    let mut lines = vec![serde_json::json!({ "system": system, "cables": 3 })];
    for cycle in 1..=8_u64 {
        let set = cycle >= 4;
        let length = |cable: u64| {
            let missing = cable == 0 && (4..6).contains(&cycle);
            (!missing).then(|| 5.0 + 0.001 * cycle as f64 + 0.5 * f64::from(u8::from(set)))
        };
        // From the newest reading, which of that cable is the one of cycle 3 meanwhile.
        let silent_s = if length(0).is_none() { 0.01 * (cycle - 3) as f64 } else { 0.0 };
        lines.push(serde_json::json!({
            "cycle": cycle, "instant_ns": cycle * 10_000_000 + 4_000_000, "lengths_m": [length(0), length(1), length(2)],
            "sampled_ns": vec![cycle * 10_000_000; 3], "ahead_s": [0.004 + silent_s, 0.004, 0.004],
            "commands_m_s": vec![0.1; 3], "forget": false, "expect_anything": cycle == 4,
        }));
    }
    let [rust, python] = templates().map(|program| answers(&program, &lines));
    let figures = |answers: &[Value]| -> Vec<Option<[f64; 2]>> {
        let of_cables = answers.iter().flat_map(|answer| answer.as_array().unwrap());
        of_cables.map(|one| Some([one["length_m"].as_f64()?, one["velocity_m_s"].as_f64()?])).collect()
    };
    let python = figures(&python);
    assert_eq!(python.len(), 3 * 8);
    // The first reading after the operator has set the lengths: at rest, at its length.
    let [length_m, velocity_m_s] = python[3 * 5].unwrap();
    assert!((length_m - 5.506).abs() < 1e-12 && velocity_m_s == 0.0, "{length_m} m, {velocity_m_s} m/s");
    for (rust, python) in figures(&rust).iter().zip(&python) {
        let (rust, python) = (rust.unwrap(), python.unwrap());
        assert!((0..2).all(|at| (rust[at] - python[at]).abs() < 1e-12), "{rust:?} {python:?}");
    }
}

/// One that leaves out cables has no estimate, so the mission is not flown; a wrong answer fails the flight.
#[test]
fn an_estimator_without_an_answer_does_not_fly() {
    let folder = tempfile::tempdir().unwrap();
    for (answer, named) in [("null", None), ("[null,null,null,null]", None), ("[null]", Some("1 for 4 cables"))] {
        let program = script(folder.path(), &format!(r"{answer}\n"));
        let output = fly("aq4", &["--estimator-program", &program, "--longest", "5"]);
        let flight = &flights(&output)[0];
        assert!(output.failure.is_some() && flight["completed"] != true, "{flight}");
        if let Some(named) = named {
            assert!(flight["failed"].as_str().unwrap().contains(named), "{flight}");
        }
    }
}
