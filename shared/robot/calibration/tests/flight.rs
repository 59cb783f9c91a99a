//! Stiffness from the record of a flight that is computed with known cables and winches.

#![allow(clippy::unwrap_used)]

use cable_robot::tension::FourCables;
use cable_robot::{CableVec, Robot, RobotParts, StructureMatrix, Uncertainty, Vector3, elastic, kinematics};
use calibration::Found;
use calibration::flight::{Flight, FlightPart, FlightStiffness, GIVEN, WIDE, flight_stiffness};

const STATED_N: f64 = 6000.0;
const PART_S: f64 = 0.2;

fn parts(cables: usize, stiffness_n: f64) -> RobotParts {
    let anchors_m = [[0.0, 0.0, 3.05], [9.9, 0.1, 3.1], [9.8, 8.9, 2.98], [0.1, 9.0, 3.02]];
    RobotParts {
        anchors_m: anchors_m[..cables].to_vec(),
        node_mass_kg: 1.2,
        tension_limits_n: [2.0, 60.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: Some(stiffness_n),
        routed_length_m: Some(vec![6.0; cables]),
        uncertainty: Uncertainty {
            anchors_m: 0.007,
            pulley_radius_m: 0.0005,
            cable_scale: 0.0005,
            stiffness: 0.1,
            node_weight: 0.03,
            pole_m_n: 9e-5,
            pulley_friction: 0.03,
            expansion: 1e-4,
        },
        ..RobotParts::default()
    }
}

/// A node on a path of circles that rise and fall, with another pretension in the second half.
fn flown(cables: usize, true_n: f64, tighter_n: f64, noise_a: f64) -> Flight {
    let robot = Robot::new(parts(cables, true_n)).unwrap();
    let count = 600;
    let at = |k: usize| {
        let angle = 0.04 * k as f64;
        let rise = 0.3 * libm::sin(0.37 * angle);
        Vector3::new(4.9 + 1.2 * libm::cos(angle), 4.5 + 1.2 * libm::sin(angle), 1.0 + rise)
    };
    let held = |k: usize| {
        let position = at(k);
        let structure = StructureMatrix::at(robot.anchors(), &position).unwrap();
        let weight_n = robot.wrench_n(&Vector3::zeros());
        let mut tensions_n = cable_robot::tension::least_norm_unbounded(&structure, &weight_n).unwrap();
        if cables == 4 {
            let line = FourCables::new(&structure, &weight_n, [0.1, 200.0]).unwrap();
            let more_n = if k < count / 2 { 0.0 } else { tighter_n };
            tensions_n = tensions_n.zip_map(&line.direction, |tension_n, share| tension_n + more_n * share);
        }
        let straight = kinematics::inverse_kinematics(robot.anchors(), &position);
        (elastic::unstretched(&robot, &position, &straight, &tensions_n), tensions_n)
    };
    let mut random = 1_u64;
    let mut noise = move || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        noise_a * ((random >> 33) as f64 / f64::from(1_u32 << 31) - 0.5) * 12.0_f64.sqrt()
    };
    let parts = (1..count - 1).map(|k| {
        let (lengths_m, tensions_n) = held(k);
        // Of one pretension, so that its change is no motion.
        let beside = |k: usize| kinematics::inverse_kinematics(robot.anchors(), &at(k));
        let reel_in_m_s = beside(k - 1).zip_map(&beside(k + 1), |before, after| (before - after) / (2.0 * PART_S));
        let current_a = CableVec::from_fn(cables, |i| robot.motor().current_a(tensions_n[i], reel_in_m_s[i]) + noise());
        FlightPart {
            time_s: PART_S * k as f64,
            lengths_m,
            passed_n_m: CableVec::zeros(cables),
            reel_in_m_s,
            reel_in_m_s2: CableVec::zeros(cables),
            current_a,
        }
    });
    Flight { parts: parts.collect(), part_s: PART_S, force_constants_n_a: vec![[40.0, 1.6]; cables] }
}

fn found(cables: usize, flight: &Flight) -> FlightStiffness {
    flight_stiffness(&parts(cables, STATED_N), flight).unwrap()
}

#[test]
fn another_pretension_tells_the_stiffness_whatever_the_robot_file_states() {
    for true_n in [4500.0, 6000.0, 8000.0] {
        let found = found(4, &flown(4, true_n, 6.0, 0.005));
        println!("{true_n}: {found:?}");
        let Found::Determined { value, std } = found.stiffness_n else { panic!("{true_n} N: {found:?}") };
        assert!((value - true_n).abs() < 2.0 * std && std < GIVEN * value, "{true_n} N: {found:?}");
    }
}

#[test]
fn a_flight_that_does_not_tell_gives_no_value_and_says_what_would() {
    let noisy = found(4, &flown(4, 5000.0, 0.0, 0.3));
    let Found::Undetermined(why) = &noisy.stiffness_n else { panic!("{noisy:?}") };
    assert!(why.contains("pretension") && why.contains("nims loads") && noisy.left > GIVEN, "{noisy:?}");

    let three = found(3, &flown(3, 5000.0, 0.0, 0.005));
    let Found::Undetermined(why) = &three.stiffness_n else { panic!("{three:?}") };
    assert!(why.contains("3 cables") && three.left == WIDE, "{three:?}");

    let mut silent = flown(4, 5000.0, 6.0, 0.005);
    silent.parts.iter_mut().for_each(|part| part.current_a[2] = f64::NAN);
    let Found::Undetermined(why) = found(4, &silent).stiffness_n else { panic!("a cable without currents") };
    assert!(why.contains("cable 3"), "{why}");
}

#[test]
fn a_flight_of_another_robot_is_refused() {
    let flight = flown(3, 5000.0, 0.0, 0.005);
    assert_eq!(flight_stiffness(&parts(4, STATED_N), &flight).unwrap_err().kind(), "invalid_argument");
    let rigid = RobotParts { stiffness_n: None, ..parts(3, STATED_N) };
    assert!(flight_stiffness(&rigid, &flight).unwrap_err().to_string().contains("rigid"));
}
