//! Flights among random trunks and walls: a mission that the planner accepts touches none of them, with the node or
//! with a cable, in the true motion of the plant.

use cable_robot::{Obstacle, Vector3};
use config::{ObstacleSection, RobotFile};
use messages::PlanStatus;
use nims_tests::lockstep::Lockstep;
use nims_tests::scenarios::{Case, START_M};
use planner::Mission;
use proptest::prelude::*;
use std::cell::Cell;
use std::path::Path;

const CASE: Case = Case { robot: "lab3", mission: "polyline", motor_s: [0.03, 0.04] };
/// Flights in a run of the tests; `PROPTEST_CASES` sets another number.
const FLIGHTS: u32 = 24;
/// Smallest share of the clearance that the true motion keeps. The robot follows its path to some millimetres.
const KEPT: f64 = 0.8;

fn trunk() -> impl Strategy<Value = ObstacleSection> {
    (1.0..8.5f64, 0.5..7.0f64, 0.1..0.4f64, 0.3..4.0f64)
        .prop_map(|(x, y, radius_m, top_m)| ObstacleSection::cylinder([x, y], radius_m, [0.0, top_m]))
}

/// A wall in any direction: a prism over four corners.
fn wall() -> impl Strategy<Value = ObstacleSection> {
    let turn = 0.0..std::f64::consts::PI;
    (1.0..8.5f64, 0.5..7.0f64, 0.1..0.8f64, 0.02..0.2f64, turn, 0.3..4.0f64).prop_map(
        |(x, y, along_m, across_m, turn, top_m)| {
            let (sin, cos) = turn.sin_cos();
            let corner = |u: f64, v: f64| [x + u * cos - v * sin, y + u * sin + v * cos];
            let corners_m = vec![
                corner(-along_m, -across_m),
                corner(along_m, -across_m),
                corner(along_m, across_m),
                corner(-along_m, across_m),
            ];
            ObstacleSection { center_m: None, radius_m: None, corners_m, height_m: [0.0, top_m] }
        },
    )
}

fn body() -> impl Strategy<Value = ObstacleSection> {
    prop_oneof![2 => trunk(), 1 => wall()]
}

fn point() -> impl Strategy<Value = [f64; 3]> {
    (3.2..6.4f64, 1.8..4.6f64, 0.3..1.4f64).prop_map(|(x, y, z)| [x, y, z])
}

/// Least distance of the node and of the cables from any obstacle, m.
fn least_distance_m(anchors: &[[f64; 3]], node_m: [f64; 3], obstacles: &[Obstacle]) -> f64 {
    const POINTS: usize = 60;
    let node = Vector3::from(node_m);
    let points = anchors.iter().flat_map(|anchor| {
        let anchor = Vector3::from(*anchor);
        (0..=POINTS).map(move |k| anchor + (node - anchor) * (k as f64 / POINTS as f64))
    });
    points.flat_map(|at| obstacles.iter().map(move |body| body.distance_m(&at))).fold(f64::INFINITY, f64::min)
}

/// Flies a mission among trunks. Returns the least true distance from any of them, m, or `None` if it was rejected.
fn fly(trunks: Vec<ObstacleSection>, points: &[[f64; 3]]) -> Option<f64> {
    let path = format!("{}/../configs/robots/lab3.toml", env!("CARGO_MANIFEST_DIR"));
    let mut file = RobotFile::load(Path::new(&path)).unwrap();
    file.obstacle = trunks;
    let obstacles: Vec<Obstacle> = file.obstacle.iter().map(|section| section.obstacle().unwrap()).collect();
    let anchors = file.robot.anchors_m.to_vec();
    let mut scenario = CASE.scenario(true).unwrap();
    scenario.robot = file.robot().unwrap();
    let mut lockstep = Lockstep::new(scenario).unwrap();
    lockstep.zero_and_arm().unwrap();
    let text = format!("name = \"trunks\"\nspeed_m_s = 0.3\n[[leg]]\npolyline = {{ points_m = {points:?} }}\n");
    lockstep.run(&Mission::parse(&text).unwrap()).ok()?;
    let mut least_m = f64::INFINITY;
    for cycle in 0..20_000 {
        let sample = lockstep.cycle().unwrap();
        if cycle % 5 == 0 {
            least_m = least_m.min(least_distance_m(&anchors, sample.truth_m, &obstacles));
        }
        match sample.plan.state {
            PlanStatus::STATE_DONE => return Some(least_m),
            PlanStatus::STATE_ABORTED => panic!("{}", messages::text_of(&sample.plan.reason)),
            _ => {}
        }
    }
    panic!("the mission does not end");
}

#[test]
fn an_accepted_mission_touches_no_body_with_node_or_cables() {
    let flights = std::env::var("PROPTEST_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(FLIGHTS);
    let (flown, rejected, least_m) = (Cell::new(0), Cell::new(0), Cell::new(f64::INFINITY));
    let clearance_m = 0.1;
    let config = ProptestConfig { cases: flights, max_global_rejects: 20 * flights, ..ProptestConfig::default() };
    let mut runner = proptest::test_runner::TestRunner::new(config);
    let missions = (proptest::collection::vec(body(), 1..4), proptest::collection::vec(point(), 1..4));
    let result = runner.run(&missions, |(trunks, points)| {
        let near = |section: &ObstacleSection| {
            let body = section.obstacle().unwrap();
            let start = Vector3::from(START_M);
            let anchors = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]].map(Vector3::from);
            anchors.iter().any(|anchor| body.is_near(anchor, &start, 2.0 * clearance_m))
        };
        prop_assume!(!trunks.iter().any(near));
        match fly(trunks, &points) {
            Some(distance_m) => {
                flown.set(flown.get() + 1);
                least_m.set(least_m.get().min(distance_m));
                prop_assert!(distance_m > KEPT * clearance_m, "{distance_m} m");
            }
            None => rejected.set(rejected.get() + 1),
        }
        Ok(())
    });
    println!("{} flown, {} rejected, least distance {:.4} m", flown.get(), rejected.get(), least_m.get());
    result.unwrap();
    assert!(flown.get() >= flights / 8 && rejected.get() >= flights / 8, "the trunks are too many or too few");
}

/// A flat body below the path leaves the clearance and 3 cm, of which a step of the check takes 2: enough only for a
/// robot file that is exact.
#[test]
fn the_margin_of_a_trunk_contains_what_the_robot_file_may_have_wrong() {
    let path = format!("{}/../configs/robots/lab3.toml", env!("CARGO_MANIFEST_DIR"));
    let mut file = RobotFile::load(Path::new(&path)).unwrap();
    let accepted = |file: &RobotFile| {
        let mut scenario = CASE.scenario(true).unwrap();
        scenario.robot = file.robot().unwrap();
        let mut lockstep = Lockstep::new(scenario).unwrap();
        lockstep.zero_and_arm().unwrap();
        let to_m = [START_M[0] + 1.6, START_M[1], START_M[2]];
        let text = format!("name = \"over\"\n[[leg]]\nline = {{ to_m = {to_m:?} }}\n");
        lockstep.run(&Mission::parse(&text).unwrap()).is_ok()
    };
    assert!(accepted(&file), "without the body");
    let top_m = START_M[2] - file.robot.clearance_m - 0.03;
    file.obstacle = vec![ObstacleSection::cylinder([START_M[0] + 1.4, START_M[1]], 0.05, [-1.0, top_m])];
    assert!(!accepted(&file), "as uncertain as stated");
    file.uncertainty = config::UncertaintySection {
        anchors_m: 0.0,
        pulley_radius_m: Some(0.0),
        cable_scale: 0.0,
        stiffness: 0.0,
        node_weight: 0.0,
        pole_m_n: 0.0,
        pulley_friction: 0.0,
        expansion: 0.0,
    };
    assert!(accepted(&file), "exact");
}
