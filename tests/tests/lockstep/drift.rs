//! The measure of drift of the tests with processes, by a node that swings and does not drift, and by ones that drift.

use cable_robot::{CableVec, Robot, Vector3, elastic, kinematics, tension};
use nims_tests::drift::drift_m;
use nims_tests::lockstep::Lockstep;
use nims_tests::scenarios::{Case, START_M};

const CASE: Case = Case { robot: "lab3", mission: "polyline", motor_s: [0.03, 0.04] };
/// Duration, s, and what `tests/live/processes.rs` allows in it, m.
const DRIFT_S: f64 = 2.0;
const ALLOWED_M: f64 = 0.02 * DRIFT_S / 60.0;
/// Cycles after which motor-io resets no loop of a drive any more; by a reset the node sinks a quarter of a millimetre.
const SETTLED: u32 = 400;
/// Velocity of a push, m/s: the node swings by as much as after a stop.
const PUSH_M_S: f64 = 0.06;

/// Lengths of the cables with the node at rest there, m.
fn lengths_at(robot: &Robot, position_m: &Vector3<f64>) -> CableVec {
    let held = tension::at(robot, position_m, &Vector3::zeros(), robot.default_distribution()).unwrap();
    let straight = kinematics::inverse_kinematics(robot.anchors(), position_m);
    elastic::unstretched(robot, position_m, &straight, &held.tensions_n)
}

#[test]
fn a_swing_is_no_drift_whatever_its_phase() {
    let (mut largest_m, mut by_positions_m) = (0.0_f64, 0.0_f64);
    for late in 0..12 {
        let mut flight = Lockstep::new(CASE.scenario(true).unwrap()).unwrap();
        flight.zero_and_arm().unwrap();
        (0..SETTLED).for_each(|_| _ = flight.cycle().unwrap());
        let at_m = flight.plant().position_m();
        flight.plant_mut().push_node(at_m, [0.5 * PUSH_M_S, 0.3 * PUSH_M_S, PUSH_M_S]);
        (0..50 + 3 * late).for_each(|_| _ = flight.cycle().unwrap());
        let (mut lengths, mut positions) = (Vec::new(), Vec::new());
        for _ in 0..270 {
            flight.cycle().unwrap();
            lengths.push(CableVec::from_slice(&flight.plant().lengths_m()).unwrap());
            positions.push(Vector3::from(flight.plant().position_m()));
        }
        let robot = CASE.scenario(true).unwrap().robot;
        largest_m = largest_m.max(drift_m(&robot, &lengths).unwrap());
        let mean = |some: &[Vector3<f64>]| some.iter().sum::<Vector3<f64>>() / some.len() as f64;
        by_positions_m = by_positions_m.max((mean(&positions[170..]) - mean(&positions[..100])).norm());
        let swing_m = positions.iter().map(|at| (at - mean(&positions)).norm()).fold(0.0, f64::max);
        assert!(swing_m > 0.002, "{swing_m} m");
    }
    println!("{:.3} mm by lengths, {:.3} mm by positions", 1e3 * largest_m, 1e3 * by_positions_m);
    assert!(largest_m < 0.3 * ALLOWED_M, "{largest_m} m");
}

#[test]
fn a_drift_of_twice_what_is_allowed_is_found_in_every_direction() {
    let robot = CASE.scenario(true).unwrap().robot;
    for axis in 0..3 {
        let mut along = Vector3::zeros();
        along[axis] = 2.0 * ALLOWED_M / DRIFT_S;
        let at = |sample: usize| lengths_at(&robot, &(Vector3::from(START_M) + along * (0.01 * sample as f64)));
        let lengths: Vec<CableVec> = (0..300).map(at).collect();
        let found_m = drift_m(&robot, &lengths).unwrap();
        assert!((found_m - 2.0 * ALLOWED_M).abs() < 0.02 * ALLOWED_M, "{found_m} m along axis {axis}");
    }
}
