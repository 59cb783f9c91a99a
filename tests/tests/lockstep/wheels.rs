//! Flights over wheels of 25 mm, the only difference between the world and the model: taken for eyes, with the radius
//! known, and with anchors and radius of a calibration.
//!
//! The table is printed: `cargo test -p nims-tests --test lockstep wheels -- --nocapture`.

use crate::calibrations::median;
use cable_robot::{Anchors, Robot, Vector3};
use commissioning::calibrate::{MeasurementsFile, PointEntry, RangeEntry, judge, places};
use config::{PulleyKind, SystemFile};
use messages::PlanStatus;
use motor_box::BoxConfig;
use nims_tests::lockstep::{Flight, Scenario, fly};
use planner::Mission;
use plant::PlantConfig;
use plant::pulley::Guide;
use plant::random::Random;
use plant::world::CableWorld;

const RADIUS_M: f64 = 0.025;

/// Paths over the workspace, m.
const WIDE: [(&str, [[f64; 3]; 5]); 2] = [
    ("demo3", [[3.0, 1.5, 0.5], [6.8, 1.5, 1.0], [4.8, 5.5, 0.5], [4.0, 2.5, 1.6], [4.8, 3.0, 0.3]]),
    ("river4", [[7.0, 5.0, 0.8], [23.0, 5.0, 1.5], [23.0, 15.0, 0.8], [7.0, 15.0, 2.5], [15.0, 10.0, 1.0]]),
];

/// Calibrations, and what a team adds to them: reading a length, an uneven floor, a distance between plumb lines, and a
/// radius from a data sheet that does not say how deep the groove is, m.
const CALIBRATIONS: u64 = 9;
const READING_M: f64 = 0.005;
const FLOOR_M: f64 = 0.008;
const RANGE_M: f64 = 0.003;
const SHEET_M: f64 = 0.003;

/// The wide path of a system in the world with wheels, flown with another model of the robot.
fn flight(name: &str, points_m: &[[f64; 3]], model: impl Fn(Robot) -> Robot) -> Flight {
    flight_in(name, points_m, model, |_| ())
}

/// The same with more that is different in the world.
fn flight_in(
    name: &str,
    points_m: &[[f64; 3]],
    model: impl Fn(Robot) -> Robot,
    change: impl Fn(&mut PlantConfig),
) -> Flight {
    let file = SystemFile::load(&crate::drawn::system(name)).unwrap();
    let robot_file = file.robot_file().unwrap();
    let mut plant = BoxConfig::from_files(&file, &robot_file, std::path::Path::new("/")).unwrap().plant;
    plant.world.cables.resize(plant.anchors_m.len(), CableWorld::default());
    plant.world.cables.iter_mut().for_each(|cable| cable.guide = Guide::Swivel { radius_m: RADIUS_M });
    change(&mut plant);
    let text = format!("name = \"wide\"\n[[leg]]\npolyline = {{ points_m = {points_m:?} }}\n");
    let robot = model(robot_file.robot().unwrap());
    let scenario = Scenario::from_files(&file, robot, plant, Mission::parse(&text).unwrap()).unwrap();
    let flight = fly(Scenario { longest_s: 600.0, ..scenario }).unwrap();
    assert_eq!(flight.state, PlanStatus::STATE_DONE, "{flight:?}");
    flight
}

fn row(name: &str, model: &str, flight: &Flight) {
    let mm = |d: nims_tests::lockstep::Deviation| format!("{:5.2} / {:5.2}", 1e3 * d.rms_m, 1e3 * d.max_m);
    println!("| {name}, {model} | {} | {} | {} |", mm(flight.estimate), mm(flight.between), mm(flight.truth));
}

/// With the radius known the node is as near to its setpoint as over eyes.
#[test]
fn a_robot_that_knows_its_wheels_flies_as_over_eyes() {
    println!("| robot, model | estimate - setpoint, mm RMS / max | truth - estimate | truth - setpoint |");
    for ((name, points_m), most_m) in WIDE.iter().zip([0.0015, 0.004]) {
        let eyes = flight(name, points_m, |robot| robot);
        let known = flight(name, points_m, |robot| robot.with_pulleys(&vec![RADIUS_M; robot.cable_count()]).unwrap());
        row(name, "eyes", &eyes);
        row(name, "wheels known", &known);
        assert!(eyes.truth.rms_m > 5.0 * known.truth.rms_m, "the wheels hardly matter: {eyes:?} {known:?}");
        assert!(known.truth.rms_m <= most_m, "{known:?}");
    }
}

/// A robot file that gives weightless cables a weight, and stretch to counts without it, makes tensions and place
/// wrong. The robot flies to the end all the same, within what it states of its own doubt: a current that is a fifth
/// lower than that of the estimated tension is no slack cable.
#[test]
fn a_wrong_belief_about_weight_and_counts_is_no_slack_cable() {
    let (name, points_m) = &WIDE[1];
    let weightless = |plant: &mut PlantConfig| {
        plant.world.cables.iter_mut().for_each(|cable| (cable.mass_kg_m, cable.counts_stretched) = (0.0, false));
    };
    let known = |robot: Robot| robot.with_pulleys(&vec![RADIUS_M; robot.cable_count()]).unwrap();
    let flight = flight_in(name, points_m, known, weightless);
    row(name, "cables with weight, counted as stretched", &flight);
    println!("stated {:?}, within in {:.1} %", flight.stated, 100.0 * flight.covered);
    assert!(flight.between.max_m > 0.005, "the belief is not wrong enough: {flight:?}");
    assert!(flight.slack_cycles == 0 && flight.covered >= 0.95, "{flight:?}");
}

/// What a team writes down at the places of `nims setup`.
fn measured(anchors_m: &[[f64; 3]], random: &mut Random) -> MeasurementsFile {
    let mut file = MeasurementsFile { sigma_range_m: Some(RANGE_M), ..MeasurementsFile::default() };
    let n = anchors_m.len();
    for (from, to) in (0..n).flat_map(|from| (from + 1..n).map(move |to| (from, to))) {
        let apart = (Vector3::from(anchors_m[from]) - Vector3::from(anchors_m[to])).xy().norm();
        let m = apart + RANGE_M * random.gaussian();
        file.range.push(RangeEntry { from: from + 1, to: to + 1, m, sigma_m: None, side: None });
    }
    let wheel = Guide::Swivel { radius_m: RADIUS_M };
    for [x, y] in places::spots(anchors_m, 9) {
        let node = Vector3::new(x, y, FLOOR_M * random.gaussian());
        let mut shown =
            |anchor: &[f64; 3]| wheel.path(node - Vector3::from(*anchor)).length_m + READING_M * random.gaussian();
        file.point.push(PointEntry { lengths_m: anchors_m.iter().map(&mut shown).collect(), gps_m: None });
    }
    file.pulley = Some(PulleyKind::Swivel);
    file.pulley_radius_m = vec![RADIUS_M + SHEET_M * random.gaussian(); n];
    (file.sigma_pulley_radius_m, file.sigma_floor_m) = (Some(SHEET_M), Some(FLOOR_M));
    file
}

/// Each calibration finds anchors and radius from its own errors of measurement. Median of the flights.
#[test]
fn a_robot_with_calibrated_wheels_flies_within_millimetres() {
    let (name, points_m) = &WIDE[0];
    let anchors_m =
        SystemFile::load(&crate::drawn::system(name)).unwrap().robot_file().unwrap().robot.anchors_m.to_vec();
    let mut rms_m = Vec::new();
    for seed in 1..=CALIBRATIONS {
        let file = measured(&anchors_m, &mut Random::new(seed));
        let judged = judge(&file, file.usual_method()).unwrap();
        let list = |key: &str| serde_json::to_string(&judged.value[key]).unwrap();
        let found_m: Vec<[f64; 3]> = serde_json::from_str(&list("anchors_m")).unwrap();
        let radii_m: Vec<f64> = serde_json::from_str(&list("pulley_radius_m")).unwrap();
        let found = Anchors::new(&found_m).unwrap();
        let flight = flight(name, points_m, |robot| robot.with_anchors(found).unwrap().with_pulleys(&radii_m).unwrap());
        row(name, &format!("calibration {seed}, {:.1} mm", 1e3 * radii_m[0]), &flight);
        rms_m.push(flight.truth.rms_m);
    }
    println!("median {:.2} mm", 1e3 * median(&rms_m));
    assert!(median(&rms_m) <= 0.003, "{rms_m:?}");
}
