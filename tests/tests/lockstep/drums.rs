//! Flights with encoders on the motors, over drums on which the cable lies in layers: the world winds whole layers,
//! irregularly; the model knows the mean of them.
//!
//! The table is printed: `cargo test -p nims-tests --test lockstep drums -- --nocapture`.

use cable_robot::energy::flight;
use config::{DrumEncoder, DrumSection, RobotFile, SystemFile};
use messages::PlanStatus;
use motor_box::BoxConfig;
use nims_tests::lockstep::{Flight, Lockstep, Scenario, fly};
use planner::Mission;
use segments::motion_of;

/// A drum of 75 mm with 24 turns per layer, as of printed winches.
const DIAMETER_M: f64 = 0.075;
const TURNS: f64 = 24.0;
/// The paper's cable of 0.33 mm and a braided one of 0.8 mm, and the largest deviation from the setpoint with either, m
/// RMS: the steps from layer to layer, which the mean radius leaves out.
const CABLES_M: [(f64, f64); 2] = [(0.000_33, 0.004), (0.000_8, 0.009)];
const LENGTH_M: f64 = 25.0;

const POINTS_M: [[f64; 3]; 5] = [[3.0, 1.5, 0.5], [6.8, 1.5, 1.0], [4.8, 5.5, 0.5], [4.0, 2.5, 1.6], [4.8, 3.0, 0.3]];

fn flight(world: &RobotFile, model: &RobotFile, file: &SystemFile) -> Flight {
    let plant = BoxConfig::from_files(file, world, std::path::Path::new("/")).unwrap().plant;
    let text = format!("name = \"wide\"\n[[leg]]\npolyline = {{ points_m = {POINTS_M:?} }}\n");
    let scenario = Scenario::from_files(file, model.robot().unwrap(), plant, Mission::parse(&text).unwrap()).unwrap();
    fly(Scenario { longest_s: 600.0, ..scenario }).unwrap()
}

/// The turns of a drum lead to within millimetres if its layers are known, and not if they are not.
#[test]
fn encoders_on_drums_know_the_layers() {
    let file = SystemFile::load(&crate::drawn::system("demo3")).unwrap();
    let bare = file.robot_file().unwrap();
    println!("| cable, mm | model | truth - setpoint, mm RMS / max |");
    for (cable_diameter_m, most_m) in CABLES_M {
        let drum = DrumSection {
            diameter_m: DIAMETER_M + cable_diameter_m,
            cable_diameter_m,
            turns_per_layer: TURNS,
            cable_m: vec![LENGTH_M; bare.robot.anchors_m.len()],
            encoder: DrumEncoder::First,
            idler_m: 0.0,
        };
        let layered = RobotFile { drum: Some(drum), ..bare.clone() };
        let known = flight(&layered, &layered, &file);
        let mm = |flight: &Flight| format!("{:.2} / {:.2}", 1e3 * flight.truth.rms_m, 1e3 * flight.truth.max_m);
        println!("| {:.2} | layers known | {} |", 1e3 * cable_diameter_m, mm(&known));
        let taken_for_bare = flight(&layered, &bare, &file);
        println!("| {:.2} | bare drum | {} |", 1e3 * cable_diameter_m, mm(&taken_for_bare));
        assert_eq!(known.state, PlanStatus::STATE_DONE, "{known:?}");
        assert!(known.truth.rms_m <= most_m, "{known:?}");
        assert!(
            taken_for_bare.state != PlanStatus::STATE_DONE || taken_for_bare.truth.rms_m > 5.0 * known.truth.rms_m,
            "the layers hardly matter: {taken_for_bare:?}"
        );
    }
}

/// Loss of the flown segments by the model of a robot file, and by the plant as its drives average it, J.
fn losses_j(world: &RobotFile, model: &RobotFile, file: &SystemFile) -> [f64; 2] {
    let plant = BoxConfig::from_files(file, world, std::path::Path::new("/")).unwrap().plant;
    let mission =
        Mission::parse(&format!("name = \"wide\"\n[[leg]]\npolyline = {{ points_m = {POINTS_M:?} }}\n")).unwrap();
    let robot = model.robot().unwrap();
    let scenario = Scenario::from_files(file, robot, plant, mission.clone()).unwrap();
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    lockstep.run(&mission).unwrap();
    let (mut modelled_j, mut segment, mut from_j) = (0.0, 0, None);
    let lost_j = |lockstep: &Lockstep| lockstep.plant().averaged_losses_j().iter().sum::<f64>();
    loop {
        let before_j = lost_j(&lockstep);
        let cycle = lockstep.cycle().unwrap();
        if cycle.authority.segment != 0 && cycle.authority.segment != segment {
            segment = cycle.authority.segment;
            from_j.get_or_insert(before_j);
            let flown = motion_of(&cycle.motion).unwrap().current;
            let cost = flight::along(&robot, robot.default_distribution(), &flown.path, &flown.profile).unwrap();
            modelled_j += cost.energy_j;
        }
        if matches!(cycle.plan.state, PlanStatus::STATE_DONE | PlanStatus::STATE_ABORTED) {
            assert_eq!(cycle.plan.state, PlanStatus::STATE_DONE);
            return [modelled_j, before_j - from_j.unwrap()];
        }
    }
}

/// The energy of planned moves counts how full the drums are, as well as on drums without layers.
#[test]
fn planned_energy_knows_the_fill_of_drums() {
    let file = SystemFile::load(&crate::drawn::system("demo3")).unwrap();
    let bare = file.robot_file().unwrap();
    let drum = |cable_diameter_m: f64| DrumSection {
        diameter_m: DIAMETER_M + cable_diameter_m,
        cable_diameter_m,
        turns_per_layer: TURNS,
        cable_m: vec![LENGTH_M; bare.robot.anchors_m.len()],
        encoder: DrumEncoder::Second,
        idler_m: 0.0,
    };
    let with = |cable_diameter_m| RobotFile { drum: Some(drum(cable_diameter_m)), ..bare.clone() };
    let layered = with(CABLES_M[1].0);
    let share = |world: &RobotFile, model: &RobotFile| {
        let [modelled_j, lost_j] = losses_j(world, model, &file);
        println!("modelled {modelled_j:.2} J, lost {lost_j:.2} J: {:.3}", modelled_j / lost_j);
        modelled_j / lost_j
    };
    let (flat, full, ignored) = (share(&with(0.0), &with(0.0)), share(&layered, &layered), share(&layered, &bare));
    assert!((full - flat).abs() < 0.01, "{full} with layers, {flat} without");
    assert!((ignored - flat).abs() > 0.02, "the layers hardly matter: {ignored}");
}
