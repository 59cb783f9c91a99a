//! Parameters that are set in flight, in lockstep: no step in the commands, and the same bits in a replay.

use config::{SystemFile, Tuned};
use controller::ControllerConfig;
use estimator::EstimatorConfig;
use messages::{CABLES, Request, SystemConfig, put_text};
use nims_sim::Tape;
use nims_tests::lockstep::{Chain, Lockstep};
use nims_tests::record;
use nims_tests::scenarios::Case;
use replay::{Changes, run};
use std::path::Path;

/// The cycle of the change, in the middle of a motion.
const CYCLE: u64 = 300;
const FADE_S: f64 = 0.25;
struct Flight {
    lockstep: Lockstep,
    file: SystemFile,
}

/// In motion, one cycle before the change.
fn flight(folder: &Path, name: &str, robot: &'static str, words: &[(&str, &str, &str)]) -> Flight {
    let path = record::system_with(folder, name, words).unwrap();
    let file = SystemFile::load(&path).unwrap();
    let case = Case { robot, mission: "polyline", motor_s: [0.030, 0.040] };
    let scenario = case.scenario(true).unwrap();
    let (mission, [x, y, z]) = (scenario.mission.clone(), scenario.plant.start_m);
    let mut lockstep = Lockstep::with(scenario, Chain::from_file(&file).unwrap()).unwrap();
    for cycle in 1..CYCLE {
        match cycle {
            3 => lockstep.request(Request::ZeroAt { position_m: [x, y, z] }),
            5 => lockstep.request(Request::Arm),
            10 => drop(lockstep.run(&mission).unwrap()),
            _ => {}
        }
        lockstep.cycle().unwrap();
    }
    Flight { lockstep, file }
}

fn tuned(file: &SystemFile, key: &str, value: &str) -> SystemFile {
    file.tuned(&file.robot_file().unwrap(), &Tuned::default().with(key, value).unwrap()).unwrap()
}

fn controller_of(file: &SystemFile, was: &ControllerConfig) -> ControllerConfig {
    ControllerConfig::from_files(file, &file.robot_file().unwrap(), was.incarnation).unwrap()
}

/// Largest step of a commanded cable velocity from cycle to cycle, m/s.
fn largest_step(lockstep: &mut Lockstep, cycles: u64) -> f64 {
    let row = |lockstep: &Lockstep| -> Vec<f64> {
        let said = lockstep.slots().outputs().next().unwrap();
        assert_eq!(said.command.valid[0], 1);
        said.command.velocity_m_s[..CABLES].to_vec()
    };
    let (mut last, mut largest) = (row(lockstep), 0.0_f64);
    for _ in 0..cycles {
        lockstep.cycle().unwrap();
        let now = row(lockstep);
        largest = last.iter().zip(&now).fold(largest, |largest, (a, b)| largest.max((a - b).abs()));
        last = now;
    }
    largest
}

/// The step of the commands in the cycle of a change, m/s: with the fade, and without one.
fn steps(flight: &Flight, key: &str, value: &str) -> [f64; 2] {
    let after = tuned(&flight.file, key, value);
    [FADE_S, 0.0].map(|fade_s| {
        let mut changed = flight.lockstep.fork().unwrap();
        let is = changed.slots_mut().configure_controller(0, |was| controller_of(&after, &was), fade_s).unwrap();
        assert_eq!(is.law.number(), controller_of(&flight.file, &is).law.number());
        largest_step(&mut changed, 1)
    })
}

#[test]
fn a_change_of_the_controllers_parameters_is_no_step_of_the_command() {
    let cases = [
        ("demo3", "lab3", "p-feedforward", "controller.length_gain_per_s", "10"),
        ("demo3", "lab3", "lq-endpoint", "controller.horizon_cycles", "5"),
        ("demo3", "lab3", "lq-endpoint", "controller.input_weight", "50"),
        ("demo4", "lab4", "lq-endpoint", "controller.redundant_s", "0.05"),
        ("demo3", "lab3", "preview", "controller.horizon_cycles", "5"),
    ];
    for (name, robot, law, key, value) in cases {
        let folder = tempfile::tempdir().unwrap();
        let flight = flight(folder.path(), name, robot, &[("controller", "law", law)]);
        let [faded, bare] = steps(&flight, key, value);
        println!("{law} {key} = {value}: a step of {:.3} mm/s, without a fade of {:.3} mm/s", 1e3 * faded, 1e3 * bare);
        // The first of the 25 cycles of the fade takes its share.
        assert!(faded <= 0.05 * bare, "{law} {key}: {faded} m/s, without a fade {bare} m/s");
    }
}

#[test]
fn the_preview_law_takes_other_parameters_at_weight_nought() {
    let folder = tempfile::tempdir().unwrap();
    let flight = flight(folder.path(), "demo3", "lab3", &[("controller", "law", "preview")]);
    let lags = tuned(&flight.file, "controller.drive_lag_s", "[0.03, 0.04]");
    let mut lockstep = flight.lockstep.fork().unwrap();
    for (file, horizon) in [(&lags, 40), (&tuned(&lags, "controller.preview_cycles", "25"), 25)] {
        lockstep.slots_mut().configure_controller(0, |was| controller_of(file, &was), FADE_S).unwrap();
        let step = largest_step(&mut lockstep, 100);
        assert!(step < 0.02, "{step} m/s");
        assert_eq!(lockstep.slots().outputs().next().unwrap().status.horizon, horizon, "the law is in charge again");
    }
}

#[test]
fn a_change_of_the_estimators_parameters_is_no_step_of_the_estimate() {
    for (method, key, value) in [
        ("phi", "estimator.eta", "8"),
        ("phi", "estimator.ridge", "0.1"),
        ("phi", "estimator.prior", "[1.0, 0.0]"),
        ("kalman", "estimator.drive_lag_s", "0.2"),
        ("kalman", "estimator.acceleration_sigma_m_s2", "10"),
        ("kalman", "estimator.reading_sigma_m", "0.001"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let Flight { lockstep, file } = flight(folder.path(), "demo3", "lab3", &[("estimator", "method", method)]);
        let after = tuned(&file, key, value);
        let config =
            EstimatorConfig::from_section(&after.estimator, file.robot_file().unwrap().robot().unwrap(), 1).unwrap();
        let (mut calm, mut changed) = (lockstep.fork().unwrap(), lockstep);
        changed.slots_mut().configure_estimator(0, &config);
        let mut apart_m = [0.0; 2];
        for apart_m in &mut apart_m {
            let [a, b] = [&mut calm, &mut changed].map(|one| one.cycle().unwrap().estimate);
            assert_eq!((a.valid, b.valid), (1, 1));
            *apart_m = a.position_m.iter().zip(&b.position_m).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        }
        // A standby may be 20 mm beside the one in charge when it takes over; this is an encoder step.
        assert!(apart_m[0] < 2e-4 && apart_m[1] < 2e-4, "{method} {key}: {apart_m:?} m");
    }
}

/// Parameters that a process publishes.
fn declared(file: &SystemFile, section: &str, incarnation: u32, from_seq: u64, stamp_ns: u64) -> SystemConfig {
    let mut said = SystemConfig { incarnation, from_seq, ..SystemConfig::default() };
    said.header.stamp_ns = stamp_ns;
    put_text(&mut said.parameters, &file.sections(&[section]));
    said
}

#[test]
fn a_run_in_which_parameters_were_set_replays_bit_for_bit() {
    for (law, method, changes) in [
        ("p-feedforward", "phi", [("controller.length_gain_per_s", "9"), ("estimator.eta", "12")]),
        ("preview", "kalman", [("controller.preview_cycles", "25"), ("estimator.reading_sigma_m", "0.0005")]),
        ("lq-endpoint", "phi", [("controller.horizon_cycles", "30"), ("estimator.ridge", "0.01")]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let words = [("controller", "law", law), ("estimator", "method", method)];
        let system_path = record::system_with(folder.path(), "demo3", &words).unwrap();
        let file = SystemFile::load(&system_path).unwrap();
        let after = changes.iter().fold(file.clone(), |file, (key, value)| tuned(&file, key, value));
        let case = Case { robot: "lab3", mission: "polyline", motor_s: [0.030, 0.040] };
        let scenario = case.scenario(true).unwrap();
        let (mission, [x, y, z]) = (scenario.mission.clone(), scenario.plant.start_m);
        let mut lockstep = Lockstep::with(scenario, Chain::from_file(&file).unwrap()).unwrap();
        let mut tape = Tape::new(&folder.path().join("run.mcap"), &system_path).unwrap();
        let config =
            EstimatorConfig::from_section(&after.estimator, file.robot_file().unwrap().robot().unwrap(), 1).unwrap();
        for cycle in 1..=500 {
            match cycle {
                3 => lockstep.request(Request::ZeroAt { position_m: [x, y, z] }),
                5 => lockstep.request(Request::Arm),
                10 => drop(lockstep.run(&mission).unwrap()),
                CYCLE => {
                    let slots = lockstep.slots_mut();
                    slots.configure_controller(0, |was| controller_of(&after, &was), file.arbiter.fade_s).unwrap();
                    slots.configure_estimator(0, &config);
                }
                _ => {}
            }
            let now = lockstep.cycle().unwrap();
            if cycle == 1 || cycle == CYCLE {
                let file = if cycle == 1 { &file } else { &after };
                let stamp_ns = now.state.header.stamp_ns;
                tape.write("system/config/estimator", declared(file, "estimator", 1, cycle, stamp_ns)).unwrap();
                tape.write("system/config/controller", declared(file, "controller", 2, cycle, stamp_ns)).unwrap();
            }
            tape.cycle(&now, lockstep.slots()).unwrap();
        }
        let path = tape.finish().unwrap();
        let replayed = run(&path, &Changes::default(), &mut |_| {}).unwrap();
        assert_eq!((replayed.different(), replayed.cycles), (0, 500), "{law}: {:#?}", replayed.channels);
        assert!(
            replayed.channels.iter().all(|tally| tally.equal == tally.recorded && tally.equal > 0),
            "{replayed:#?}"
        );
        // Without the change in the run, the replay would differ.
        let (key, _) = changes[0];
        let as_begun = Changes { set: vec![(key.to_owned(), file.value_of(key))], ..Changes::default() };
        let instead = run(&path, &as_begun, &mut |_| {}).unwrap().instead.unwrap();
        assert!(instead.command_m_s.iter().any(|spread| spread.max > 0.0), "{law}: {instead:?}");
    }
}
