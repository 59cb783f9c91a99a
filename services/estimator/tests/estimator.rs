//! The estimator with lengths computed from known positions.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use cable_control::length_filter::FilterError;
use cable_robot::{CableVec, Distribution, Jacobian, Robot, RobotParts, Vector3, elastic};
use config::{EstimatorMethod, EstimatorSection};
use estimator::{BRIDGED_CYCLES, Estimator, EstimatorConfig, Method};
use messages::{Header, MotorAuthority, MotorState, NodeEstimate};
use proptest::prelude::*;

const PERIOD_NS: u64 = 10_000_000;

fn robot(cables: usize, stiffness_n: Option<f64>) -> Robot {
    Robot::new(parts(cables, stiffness_n)).unwrap()
}

fn parts(cables: usize, stiffness_n: Option<f64>) -> RobotParts {
    let anchors = [[0.0, 0.0, 3.05], [9.9, 0.1, 3.10], [9.8, 8.9, 2.98], [0.1, 9.0, 3.02]];
    RobotParts {
        anchors_m: anchors[..cables].to_vec(),
        node_mass_kg: 1.2,
        tension_limits_n: [1.0, 60.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n,
        routed_length_m: Some(vec![6.0; cables]),
        ..RobotParts::default()
    }
}

/// A planar robot whose node floats in water.
fn floating(drag_n_s2_m2: f64) -> Robot {
    Robot::new(RobotParts {
        anchors_m: vec![[0.0, 0.0, 4.2], [8.0, 0.0, 4.2], [8.0, 0.0, 0.3], [0.0, 0.0, 0.3]],
        planar: true,
        node_mass_kg: 6.0,
        net_weight_n: Some(0.0),
        drag_n_s2_m2,
        tension_limits_n: [10.0, 80.0],
        speed_limit_m_s: 0.3,
        acceleration_limit_m_s2: 0.3,
        stiffness_n: Some(12_000.0),
        routed_length_m: Some(vec![4.0, 4.0, 8.0, 8.0]),
        ..RobotParts::default()
    })
    .unwrap()
}

fn methods() -> Vec<Method> {
    let section = |method: &EstimatorMethod| EstimatorSection { method: *method, ..EstimatorSection::default() };
    EstimatorMethod::ALL.iter().map(|method| Method::from_section(&section(method)).unwrap()).collect()
}

fn estimator(robot: Robot, method: Method) -> Estimator {
    Estimator::new(&EstimatorConfig { robot, method, sigma_length_m: 0.001, incarnation: 7, thread: 0 })
}

fn lengths(robot: &Robot, position: Vector3<f64>) -> CableVec {
    let choice = robot.default_distribution();
    elastic::realise(robot, &position, &Vector3::zeros(), choice).unwrap().unstretched_m
}

fn state(cycle: u64, lengths_m: &CableVec) -> MotorState {
    let at_ns = 1_000_000_000 + cycle * PERIOD_NS;
    let mut state = MotorState {
        header: Header { cycle, seq: cycle, ..Header::at(at_ns) },
        length_m: lengths_m.to_array8(),
        cable_count: lengths_m.len() as u8,
        position_known: MotorState::POSITION_KNOWN,
        ..MotorState::default()
    };
    for i in 0..lengths_m.len() {
        state.sampled_ns[i] = at_ns;
        state.fresh[i] = 1;
    }
    state
}

fn distance(estimate: &NodeEstimate, position: Vector3<f64>) -> f64 {
    (Vector3::from(estimate.position_m) - position).norm()
}

/// Trace of the covariance, m².
fn spread(estimate: &NodeEstimate) -> f64 {
    (0..3).map(|i| estimate.covariance_m2[4 * i]).sum()
}

/// A node with constant velocity, read like that of a robot: two cables at a time, 2 ms apart.
fn steady(robot: &Robot, cycle: u64) -> (MotorState, Vector3<f64>) {
    let velocity = Vector3::new(0.15, -0.1, 0.05);
    let at = |seconds: f64| Vector3::new(6.0, 3.5, 0.8) + velocity * seconds;
    let begin_s = cycle as f64 * 0.01;
    let n = robot.cable_count();
    let newest_s = 0.002 * n.div_ceil(2) as f64;
    let mut state = state(cycle, &lengths(robot, at(begin_s)));
    for i in 0..n {
        let after_s = 0.002 * (i / 2 + 1) as f64;
        state.length_m[i] = lengths(robot, at(begin_s + after_s))[i];
        state.sampled_ns[i] += (after_s * 1e9) as u64;
        let speed = (lengths(robot, at(begin_s + 0.01))[i] - lengths(robot, at(begin_s))[i]) / 0.01;
        (state.command_m_s[i], state.velocity_m_s[i]) = (speed, speed);
    }
    state.header.stamp_ns += (newest_s * 1e9) as u64;
    (state, at(begin_s + newest_s))
}

#[test]
fn position_and_tensions_of_a_hanging_node_are_estimated() {
    for method in methods() {
        for (cables, stiffness) in [(3, Some(6000.0)), (3, None), (4, Some(6000.0)), (4, None)] {
            let robot = robot(cables, stiffness);
            let position = Vector3::new(5.0, 3.0, 1.0);
            let choice = robot.default_distribution();
            let held = elastic::realise(&robot, &position, &Vector3::zeros(), choice).unwrap();
            let estimate = estimator(robot, method).step(&state(1, &held.unstretched_m), None);
            assert_eq!((estimate.valid, estimate.cable_count, estimate.incarnation), (1, cables as u8, 7));
            assert!(distance(&estimate, position) < 1e-6, "{estimate:?}");
            for (is, chosen) in estimate.tension_n.iter().zip(held.tensions_n.iter()) {
                assert!((is - chosen).abs() < 1e-3, "{is} N, chosen {chosen} N");
            }
            assert!(estimate.residual_m < 1e-6);
            assert_eq!(estimate.slack, [0; 8]);
            assert!((0..3).all(|i| estimate.covariance_m2[4 * i] > 0.0));
        }
    }
}

/// A common uncertainty of 2 cm of all anchors in one direction causes the same uncertainty of the node.
#[test]
fn the_covariance_of_the_anchors_is_part_of_that_of_the_estimate() {
    for (cables, stiffness) in [(3, None), (3, Some(6000.0)), (4, Some(6000.0))] {
        let together = [0.02, 0.0, 0.0].repeat(cables);
        let covariance = together.iter().map(|a| together.iter().map(|b| a * b).collect()).collect();
        let position = Vector3::new(5.0, 3.0, 1.0);
        let measured = state(1, &lengths(&robot(cables, stiffness), position));
        let plain = estimator(robot(cables, stiffness), methods()[0]).step(&measured, None);
        let calibrated = RobotParts { anchor_covariance_m2: Some(covariance), ..parts(cables, stiffness) };
        let estimate = estimator(Robot::new(calibrated).unwrap(), methods()[0]).step(&measured, None);
        assert_eq!(estimate.position_m, plain.position_m);
        let added = |i: usize| estimate.covariance_m2[i] - plain.covariance_m2[i];
        // Elastic cables rotate slightly with their anchors.
        assert!((added(0) - 4e-4).abs() < 4e-5, "{cables} {stiffness:?}: {}", added(0));
        assert!((1..9).all(|i| added(i).abs() < 4e-5), "{estimate:?}");
    }
}

#[test]
fn readings_at_different_times_are_extrapolated_to_one_instant() {
    for method in methods() {
        let robot = robot(4, Some(6000.0));
        let mut estimator = estimator(robot, method);
        let (mut worst, mut unpredicted) = (0.0f64, 0.0f64);
        for cycle in 1..200 {
            let (state, position) = steady(&robot, cycle);
            let estimate = estimator.step(&state, None);
            if cycle > 100 {
                worst = worst.max(distance(&estimate, position));
                for i in 0..4 {
                    unpredicted = unpredicted.max((estimate.measured_m[i] - lengths(&robot, position)[i]).abs());
                }
                assert!((Vector3::from(estimate.velocity_m_s) - Vector3::new(0.15, -0.1, 0.05)).norm() < 2e-3);
            }
        }
        assert!(unpredicted > 2e-4 && worst < 2e-5, "{unpredicted} m, {worst} m");
    }
}

#[test]
fn lost_readings_are_bridged_but_not_for_long() {
    let bridged = u64::from(BRIDGED_CYCLES);
    for method in methods() {
        let robot = robot(3, Some(6000.0));
        let mut estimator = estimator(robot, method);
        for cycle in 1..100 {
            estimator.step(&steady(&robot, cycle).0, None);
        }
        let before = estimator.step(&steady(&robot, 100).0, None);
        for cycle in 101..=100 + bridged {
            let (mut state, position) = steady(&robot, cycle);
            (state.fresh[2], state.length_m[2], state.sampled_ns[2]) = (0, 0.0, 0);
            let estimate = estimator.step(&state, None);
            assert_eq!(estimate.valid, 1);
            assert!(distance(&estimate, position) < 1e-3);
            assert!(spread(&estimate) > spread(&before), "the uncertainty increases");
            assert_eq!(estimate.header.oldest_input_ns, before.header.stamp_ns, "the age accumulates");
        }
        let (mut state, _) = steady(&robot, 101 + bridged);
        state.fresh[2] = 0;
        assert_eq!(estimator.step(&state, None).valid, 0);
        let (state, position) = steady(&robot, 102 + bridged);
        let estimate = estimator.step(&state, None);
        assert_eq!(estimate.valid, 1);
        assert!(distance(&estimate, position) < 1e-3);
    }
}

/// Time for which the estimates stay valid while one cable is not read, s.
fn bridged_s(method: Method, rate_hz: f64) -> f64 {
    let robot = robot(3, Some(6000.0));
    let mut estimator = estimator(robot, method);
    let authority = MotorAuthority { period_s: 1.0 / rate_hz, ..MotorAuthority::default() };
    // What happens within 10 ms at 100 Hz, in a period of this rate.
    let faster = rate_hz / 100.0;
    let shrunk = |at_ns: u64| (at_ns as f64 / faster) as u64;
    let at = |cycle: u64| {
        let (mut state, _) = steady(&robot, cycle);
        state.header.stamp_ns = shrunk(state.header.stamp_ns);
        state.sampled_ns = state.sampled_ns.map(shrunk);
        (state.command_m_s, state.velocity_m_s) =
            (state.command_m_s.map(|v| v * faster), state.velocity_m_s.map(|v| v * faster));
        state
    };
    for cycle in 1..=100 {
        assert_eq!(estimator.step(&at(cycle), Some(&authority)).valid, 1);
    }
    let valid = |cycle: &u64| {
        let mut state = at(*cycle);
        state.fresh[2] = 0;
        estimator.step(&state, Some(&authority)).valid == 1
    };
    (101..200).take_while(valid).count() as f64 / rate_hz
}

#[test]
fn above_250_hz_lost_readings_are_bridged_for_as_long_as_at_250_hz() {
    for method in methods() {
        let [at_100_hz, at_250_hz] = [100.0, 250.0].map(|rate_hz| bridged_s(method, rate_hz));
        assert_eq!([at_100_hz, at_250_hz], [3.0 / 100.0, 3.0 / 250.0]);
        for rate_hz in [333.0, 400.0, 500.0] {
            let s = bridged_s(method, rate_hz);
            assert!((s - at_250_hz).abs() <= 1.0 / rate_hz, "{rate_hz} Hz: {s} s instead of {at_250_hz} s");
        }
    }
}

/// The state of a cycle without any reading repeats the readings and the stamp of the last one.
#[test]
fn a_cycle_without_any_reading_is_extrapolated_by_a_period() {
    for method in methods() {
        let robot = robot(4, Some(6000.0));
        let mut estimator = estimator(robot, method);
        let authority = MotorAuthority { period_s: 0.01, ..MotorAuthority::default() };
        for cycle in 1..=100 {
            estimator.step(&steady(&robot, cycle).0, Some(&authority));
        }
        let (last, _) = steady(&robot, 100);
        for cycle in 101..=102 {
            let mut state = MotorState { fresh: [0; 8], ..last };
            state.header.cycle = cycle;
            let estimate = estimator.step(&state, Some(&authority));
            let (read, position) = steady(&robot, cycle);
            assert_eq!((estimate.valid, estimate.header.stamp_ns), (1, read.header.stamp_ns));
            assert_eq!(estimate.header.oldest_input_ns, last.header.oldest_input_ns);
            assert!(distance(&estimate, position) < 1e-4, "{} m", distance(&estimate, position));
        }
        let (state, position) = steady(&robot, 103);
        let estimate = estimator.step(&state, Some(&authority));
        assert_eq!(estimate.header.stamp_ns, state.header.stamp_ns);
        assert!(distance(&estimate, position) < 1e-4);
    }
}

#[test]
fn an_estimate_from_unknown_or_implausible_lengths_is_not_valid() {
    for method in methods() {
        let robot = robot(3, Some(6000.0));
        let good = state(1, &lengths(&robot, Vector3::new(5.0, 3.0, 1.0)));
        let unusable = [
            MotorState { position_known: MotorState::POSITION_UNKNOWN, ..good },
            MotorState { cable_count: 4, ..good },
            MotorState { fresh: [0; 8], ..good },
            MotorState { length_m: [f64::NAN; 8], ..good },
            MotorState { length_m: [f64::INFINITY; 8], ..good },
            MotorState { length_m: [-20.0; 8], ..good },
        ];
        for state in unusable {
            let estimate = estimator(robot, method).step(&state, None);
            assert_eq!((estimate.valid, estimate.position_m), (0, [0.0; 3]), "{state:?}");
        }
        let old = MotorState { position_known: MotorState::POSITION_RESTORED, ..good };
        assert_eq!(estimator(robot, method).step(&old, None).valid, 1, "shown, but not used for motions");
    }
}

#[test]
fn the_estimator_resets_when_the_cycles_restart() {
    for method in methods() {
        let robot = robot(3, Some(6000.0));
        let mut estimator = estimator(robot, method);
        for cycle in 1..50 {
            estimator.step(&steady(&robot, cycle).0, None);
        }
        let position = Vector3::new(6.5, 2.5, 1.5);
        let estimate = estimator.step(&state(1, &lengths(&robot, position)), None);
        assert!(estimate.valid == 1 && distance(&estimate, position) < 1e-6);
        assert_eq!(estimate.cable_velocity_m_s, [0.0; 8]);
    }
}

#[test]
fn a_slack_cable_is_flagged() {
    for method in methods() {
        let robot = robot(4, Some(6000.0));
        let mut lengths_m = lengths(&robot, Vector3::new(5.0, 4.5, 1.0));
        lengths_m[1] += 0.2;
        let estimate = estimator(robot, method).step(&state(1, &lengths_m), None);
        assert_eq!(estimate.valid, 1);
        assert_eq!((estimate.slack[1], estimate.tension_n[1]), (1, 0.0));
    }
}

/// The Kalman filter rejects a single outlier, and the paper's method accepts it; both follow a persistent step.
#[test]
fn the_filter_rejects_an_outlier_until_it_persists() {
    for (method, accepts) in methods().into_iter().zip([true, false]) {
        let robot = robot(3, Some(6000.0));
        let mut estimator = estimator(robot, method);
        let authority = MotorAuthority { period_s: 0.01, epoch: 5, ..MotorAuthority::default() };
        for cycle in 1..=100 {
            estimator.step(&steady(&robot, cycle).0, Some(&authority));
        }
        let off = |cycle, by_m: f64| {
            let (mut state, position) = steady(&robot, cycle);
            state.length_m[1] += by_m;
            (state, position)
        };
        let (state, position) = off(101, 0.02);
        let estimate = estimator.step(&state, Some(&authority));
        assert_eq!((estimate.valid, distance(&estimate, position) > 0.01), (1, accepts));
        for cycle in 102..120 {
            let (state, position) = off(cycle, 0.0);
            let estimate = estimator.step(&state, Some(&authority));
            assert!(distance(&estimate, position) < 1e-3, "{} m", distance(&estimate, position));
        }
        for cycle in 120..140 {
            let (state, _) = off(cycle, 0.05);
            let estimate = estimator.step(&state, Some(&authority));
            if cycle > 121 {
                assert!((estimate.predicted_m[1] - estimate.measured_m[1]).abs() < 1e-3, "cycle {cycle}");
            }
        }
        // Lengths that the operator sets, with a new epoch, are accepted at once.
        let (state, _) = off(140, 0.3);
        let estimate = estimator.step(&state, Some(&MotorAuthority { epoch: 6, ..authority }));
        assert!((estimate.predicted_m[1] - estimate.measured_m[1]).abs() < 1e-3);
    }
}

/// After a stall of the machine or after lost readings, the reading is more reliable than the prediction, so the
/// estimate follows it at once.
#[test]
fn after_a_gap_a_reading_is_accepted_at_once() {
    for (cycles, late_ns) in [(1, 90_000_000), (3, 0)] {
        let robot = robot(3, Some(6000.0));
        let mut estimator = estimator(robot, methods()[1]);
        for cycle in 1..=100 {
            estimator.step(&steady(&robot, cycle).0, None);
        }
        let (mut state, position) = steady(&robot, 101);
        state.header.cycle = 100 + cycles;
        for stamp in [&mut state.header.stamp_ns].into_iter().chain(&mut state.sampled_ns) {
            *stamp += late_ns + (cycles - 1) * PERIOD_NS;
        }
        let estimate = estimator.step(&state, None);
        assert_eq!(estimate.valid, 1);
        assert!(distance(&estimate, position) < 1e-3, "{} m", distance(&estimate, position));
    }
}

#[test]
fn each_method_has_a_number_and_wrong_parameters_are_rejected() {
    for method in EstimatorMethod::ALL {
        let section = EstimatorSection { method: *method, ..EstimatorSection::default() };
        assert_eq!(Method::numbered(Method::from_section(&section).unwrap().number()), Some(*method));
    }
    let named = [NodeEstimate::METHOD_PHI, NodeEstimate::METHOD_KALMAN].map(Method::numbered);
    assert_eq!(named, [Some(EstimatorMethod::Phi), Some(EstimatorMethod::Kalman)]);
    let section = EstimatorSection { method: EstimatorMethod::Kalman, drive_lag_s: 0.0, ..EstimatorSection::default() };
    let error = Method::from_section(&section).unwrap_err();
    assert!(matches!(error, FilterError { value: 0.0, .. }), "{error}");
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -20.0..20.0f64,
        0.0..12.0f64,
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(-1e300),
        Just(0.0),
        any::<f64>()
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// With any content of the inputs there is no panic, and a valid estimate is finite.
    #[test]
    fn a_valid_estimate_is_finite(
        rows in proptest::collection::vec(
            (proptest::array::uniform8(any_number()), proptest::array::uniform8(any_number()), any::<u64>(), 0u8..4, any::<u8>()),
            1..30
        ),
        cables in 3usize..=4,
        method in 0usize..2,
    ) {
        let robot = robot(cables, Some(6000.0));
        let mut estimator = estimator(robot, methods()[method]);
        for (cycle, (lengths_m, commands, sampled, known, fresh)) in rows.into_iter().enumerate() {
            let mut state = state(cycle as u64, &CableVec::from_slice(&lengths_m[..cables]).unwrap());
            (state.command_m_s, state.velocity_m_s, state.position_known) = (commands, commands, known);
            state.sampled_ns[0] = sampled;
            for i in 0..8 {
                state.fresh[i] = (fresh >> i) & 1;
            }
            let estimate = estimator.step(&state, None);
            if estimate.valid == 1 {
                let numbers = estimate.position_m.iter().chain(&estimate.velocity_m_s).chain(&estimate.covariance_m2);
                prop_assert!(numbers.chain(&estimate.tension_n).chain(&estimate.predicted_m).all(|x| x.is_finite()));
            }
        }
    }
}

/// Only the preload of the cables holds a floating node, and only the lengths determine the tensions.
#[test]
fn position_and_preload_of_a_floating_node_are_estimated() {
    let robot = floating(25.0);
    let position = Vector3::new(2.5, 0.0, 3.0);
    let held = elastic::realise(&robot, &position, &Vector3::zeros(), Distribution::LeastNorm).unwrap();
    let estimate = estimator(robot, methods()[0]).step(&state(1, &held.unstretched_m), None);
    assert_eq!((estimate.valid, estimate.position_m[1], estimate.velocity_m_s[1]), (1, 0.0, 0.0));
    assert!(distance(&estimate, position) < 1e-6, "{estimate:?}");
    for (is, chosen) in estimate.tension_n.iter().zip(held.tensions_n.iter()) {
        assert!((is - chosen).abs() < 0.01 && *chosen > 9.99, "{:?}", estimate.tension_n);
    }
    assert!(estimate.covariance_m2[0] > 0.0 && estimate.covariance_m2[8] > 0.0);
    assert_eq!(estimate.covariance_m2[4], 0.0);
}

#[test]
fn drag_does_not_bias_the_estimate_of_a_moving_node() {
    let robot = floating(25.0);
    let velocity = Vector3::new(0.2, 0.0, 0.1);
    let wrench = robot.moving_wrench_n(&velocity, &Vector3::zeros());
    let worst_m = |robot: Robot| {
        let mut estimator = estimator(robot, methods()[0]);
        let mut worst_m = 0.0f64;
        for cycle in 1..200 {
            let position = Vector3::new(2.5, 0.0, 1.5) + velocity * (0.01 * cycle as f64);
            let held = elastic::realise_under(&robot, &position, &wrench, Distribution::LeastNorm).unwrap();
            let mut state = state(cycle, &held.unstretched_m);
            let speeds = Jacobian::at(robot.anchors(), &position).unwrap().cable_velocity(&velocity);
            state.velocity_m_s = speeds.to_array8();
            let estimate = estimator.step(&state, None);
            if cycle > 2 {
                worst_m = worst_m.max(distance(&estimate, position));
            }
        }
        worst_m
    };
    let (known, unknown) = (worst_m(floating(25.0)), worst_m(floating(0.0)));
    assert!(known < 5e-5 && unknown > 5e-4, "{known} m, {unknown} m off without it");
}

/// Zeroing changes every length between two readings; this change is not a velocity for the extrapolation.
#[test]
fn setting_the_lengths_is_not_a_motion() {
    for method in methods() {
        let robot = robot(4, Some(6000.0));
        let mut estimator = estimator(robot, method);
        for cycle in 1..60 {
            let at = if cycle < 30 { Vector3::new(3.0, 3.0, 1.5) } else { Vector3::new(6.0, 3.5, 0.8) };
            let mut state = state(cycle, &lengths(&robot, at));
            // The cables are read two at a time, 2 ms apart.
            for i in 0..4 {
                state.sampled_ns[i] += if i < 2 { 0 } else { 2_000_000 };
            }
            state.header.stamp_ns += 2_000_000;
            let epoch = if cycle < 30 { 1 } else { 2 };
            let authority = MotorAuthority { header: state.header, epoch, period_s: 0.01, ..MotorAuthority::default() };
            let estimate = estimator.step(&state, Some(&authority));
            assert_eq!(estimate.valid, 1);
            assert!(distance(&estimate, at) < 1e-4, "{method:?}, cycle {cycle}: {} m", distance(&estimate, at));
        }
    }
}
