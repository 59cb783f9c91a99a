//! The plant compared with mechanics.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use proptest::prelude::*;

use plant::drive::DriveConfig;
use plant::line::{CableConfig, RIGID_STIFFNESS_N};
use plant::motor::MotorConfig;
use plant::{Fault, MotorInput, Plant, PlantConfig, PlantError, STANDARD_GRAVITY};

const THREE: [[f64; 3]; 3] = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];
const FOUR: [[f64; 3]; 4] = [[0.0, 0.0, 3.0], [9.0, 0.0, 3.2], [9.2, 8.0, 2.9], [-0.2, 8.1, 3.1]];

fn three() -> Plant {
    Plant::new(PlantConfig::new(THREE.to_vec(), [4.8, 2.9, 1.0])).unwrap()
}

fn four() -> Plant {
    Plant::new(PlantConfig::new(FOUR.to_vec(), [4.0, 4.2, 1.1])).unwrap()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Steps of 10 ms with the same speed on every cable.
fn run(plant: &mut Plant, seconds: f64, speeds_m_s: &[f64]) {
    let inputs: Vec<MotorInput> = speeds_m_s.iter().enumerate().map(|(i, &v)| plant.speed_input(i, v)).collect();
    for _ in 0..(seconds / 0.01).round() as usize {
        plant.step(0.01, &inputs).unwrap();
    }
}

#[test]
fn it_starts_at_rest_and_stays_there_released_or_held() {
    for mut plant in [three(), four()] {
        let start = plant.position_m();
        let n = plant.cable_count();
        for _ in 0..300 {
            plant.step(0.01, &vec![MotorInput::RELEASED; n]).unwrap();
        }
        assert!(distance(plant.position_m(), start) < 1e-9, "released: a locking gear does not move");
        run(&mut plant, 3.0, &vec![0.0; n]);
        assert!(distance(plant.position_m(), start) < 0.001, "held: {:?}", plant.position_m());
        assert!(plant.slack().iter().all(|slack| !slack));
    }
}

#[test]
fn tensions_at_rest_carry_the_weight() {
    for plant in [three(), four()] {
        let mut force = [0.0, 0.0, -1.2 * STANDARD_GRAVITY];
        for (i, anchor) in plant.config().anchors_m.iter().enumerate() {
            let length = plant.distances_m()[i];
            for axis in 0..3 {
                force[axis] += plant.tensions_n()[i] * (anchor[axis] - plant.position_m()[axis]) / length;
            }
        }
        assert!(force.iter().all(|f| f.abs() < 1e-6), "{force:?}");
    }
}

#[test]
fn stretch_is_hookes_law_over_the_whole_line() {
    let plant = three();
    for i in 0..3 {
        let (length, unstretched) = (plant.distances_m()[i], plant.lengths_m()[i]);
        let expected = (length + 6.0) / (1.0 + plant.tensions_n()[i] / 6000.0) - 6.0;
        assert!((unstretched - expected).abs() < 1e-12);
    }
}

#[test]
fn a_plucked_node_settles_at_the_position_of_hookes_law() {
    // One cable straight down with a jammed motor: after the oscillation the weight W stretches it to U (1 + W / EA).
    let mut config = PlantConfig::new(vec![[0.0, 0.0, 5.0]], [0.0, 0.0, 2.0]);
    config.node.drag_n_s2_m2 = 5.0;
    config.line.damping_s = 0.02;
    let mut plant = Plant::new(config).unwrap();
    plant.apply(Fault::Stall { cable: 0, on: true }).unwrap();
    plant.push_node([0.0, 0.0, 2.3], [0.0; 3]);
    for _ in 0..2000 {
        plant.step(0.01, &[MotorInput::RELEASED]).unwrap();
    }
    let stretched = (5.0 - plant.position_m()[2]) + 6.0;
    let theory = (plant.lengths_m()[0] + 6.0) * (1.0 + 1.2 * STANDARD_GRAVITY / 6000.0);
    assert!((stretched - theory).abs() < 1e-6, "{stretched} {theory}");
}

#[test]
fn a_pendulum_has_its_period() {
    let mut config = PlantConfig::new(vec![[0.0, 0.0, 5.0]], [0.0, 0.0, 3.0]);
    config.line = CableConfig { stiffness_n: RIGID_STIFFNESS_N, damping_s: 0.0 };
    config.node.drag_n_s2_m2 = 0.0;
    config.routed_length_m = vec![0.0];
    let mut plant = Plant::new(config).unwrap();
    plant.apply(Fault::Stall { cable: 0, on: true }).unwrap();
    let amplitude: f64 = 0.1;
    let stretched = 2.0;
    plant.push_node([stretched * amplitude.sin(), 0.0, 5.0 - stretched * amplitude.cos()], [0.0; 3]);
    let mut crossings = Vec::new();
    let mut last = plant.position_m()[0];
    while crossings.len() < 9 {
        plant.step(0.001, &[MotorInput::RELEASED]).unwrap();
        let x = plant.position_m()[0];
        if last > 0.0 && x <= 0.0 {
            crossings.push(plant.time_ns() as f64 * 1e-9 - 0.001 * x / (x - last));
        }
        last = x;
    }
    let period = (crossings[8] - crossings[0]) / 8.0;
    let small = 2.0 * std::f64::consts::PI * (stretched / STANDARD_GRAVITY).sqrt();
    let theory = small * (1.0 + amplitude.powi(2) / 16.0);
    assert!((period / theory - 1.0).abs() < 2e-4, "{period} {theory}");
}

#[test]
fn energy_is_conserved_without_losses_and_lost_with_them() {
    let mut config = PlantConfig::new(THREE.to_vec(), [4.8, 2.9, 1.0]);
    config.line.damping_s = 0.0;
    config.node.drag_n_s2_m2 = 0.0;
    let swing = |config: PlantConfig| {
        let mut plant = Plant::new(config).unwrap();
        for cable in 0..3 {
            plant.apply(Fault::Stall { cable, on: true }).unwrap();
        }
        plant.push_node([4.8, 2.9, 1.0], [0.02, -0.03, 0.04]);
        let before = plant.energy_j();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for _ in 0..1000 {
            plant.step(0.01, &[MotorInput::RELEASED; 3]).unwrap();
            let change = plant.energy_j() - before;
            (low, high) = (low.min(change), high.max(change));
        }
        (low, high, plant.energy_j() - before)
    };
    let given = 0.5 * 1.2 * (0.02f64.powi(2) + 0.03f64.powi(2) + 0.04f64.powi(2));
    let (low, high, _) = swing(config.clone());
    assert!(high - low < 0.02 * given, "wobble of {} J around {given} J", high - low);
    config.line.damping_s = 0.002;
    let (_, high, end) = swing(config);
    assert!(high < 0.02 * given && end < -0.5 * given, "{high} {end}");
}

#[test]
fn free_fall_then_the_floor() {
    let mut plant = three();
    for cable in 0..3 {
        plant.apply(Fault::BrokenLine { cable, on: true }).unwrap();
    }
    for _ in 0..20 {
        plant.step(0.01, &[MotorInput::RELEASED; 3]).unwrap();
    }
    let fallen = 1.0 - plant.position_m()[2];
    assert!((fallen - 0.5 * STANDARD_GRAVITY * 0.04).abs() < 0.002, "{fallen}");
    for _ in 0..300 {
        plant.step(0.01, &[MotorInput::RELEASED; 3]).unwrap();
    }
    let depth = -plant.position_m()[2];
    assert!((depth - 1.2 * STANDARD_GRAVITY / 20_000.0).abs() < 1e-5, "{depth}");
    assert!(plant.slack().iter().all(|slack| *slack));
}

#[test]
fn a_floating_node_keeps_its_momentum() {
    let mut config = PlantConfig::new(vec![[0.0, 0.0, 5.0]], [0.0, 0.0, 2.0]);
    config.node.net_weight_n = Some(0.0);
    config.node.drag_n_s2_m2 = 0.0;
    config.node.ground_m = None;
    config.start_limits_n = [0.0, 10.0];
    let mut plant = Plant::new(config).unwrap();
    plant.apply(Fault::BrokenLine { cable: 0, on: true }).unwrap();
    plant.push_node([0.0, 0.0, 2.0], [0.1, -0.2, 0.3]);
    for _ in 0..100 {
        plant.step(0.01, &[MotorInput::RELEASED]).unwrap();
    }
    assert_eq!(plant.velocity_m_s(), [0.1, -0.2, 0.3]);
    assert!(distance(plant.position_m(), [0.1, -0.2, 2.3]) < 1e-12);
}

#[test]
fn a_commanded_speed_takes_effect_after_delay_and_lag() {
    for (delay, lag) in [(0.030, 0.040), (0.060, 0.100)] {
        let mut config = PlantConfig::new(THREE.to_vec(), [4.8, 2.9, 1.0]);
        config.drive = DriveConfig { delay_s: delay, lag_s: lag, gains: None };
        let mut plant = Plant::new(config).unwrap();
        run(&mut plant, 1.0, &[0.0; 3]);
        let start = plant.lengths_m();
        let input = plant.speed_input(0, 0.05);
        // Length of a delayed first-order response: v (t - delay - lag) long after the step.
        for _ in 0..100 {
            plant.step(0.01, &[input; 3]).unwrap();
        }
        for (start, now) in start.iter().zip(plant.lengths_m()) {
            let behind_s = 1.0 - (now - start) / 0.05;
            assert!((behind_s - delay - lag).abs() < 0.006, "behind by {behind_s} s at {delay} + {lag}");
        }
        // The speed reaches half its final value at the theoretical time.
        let speeds = plant.line_speeds_m_s();
        assert!(speeds.iter().all(|v| (v - 0.05).abs() < 0.004), "{speeds:?}");
    }
}

#[test]
fn nothing_moves_before_the_delay_is_over() {
    let mut config = PlantConfig::new(THREE.to_vec(), [4.8, 2.9, 1.0]);
    config.drive = DriveConfig { delay_s: 0.060, lag_s: 0.0, gains: None };
    let mut plant = Plant::new(config).unwrap();
    run(&mut plant, 1.0, &[0.0; 3]);
    let input = plant.speed_input(0, 0.2);
    for _ in 0..59 {
        plant.step(0.001, &[input; 3]).unwrap();
        assert_eq!(plant.reference_counts_s(0), 0.0);
    }
    plant.step(0.002, &[input; 3]).unwrap();
    assert!(plant.reference_counts_s(0) > 0.0);
}

#[test]
fn the_encoder_counts_unstretched_line_and_the_current_follows_the_law() {
    let mut plant = three();
    run(&mut plant, 0.5, &[0.0; 3]);
    let (counts, lengths) = (plant.counts(1), plant.lengths_m()[1]);
    let counts_per_m = plant.config().idlers[1].counts_per_m;
    // Wind up all three slowly: the node rises, currents are those of reeling in.
    let law = MotorConfig::default();
    let input = plant.speed_input(0, -0.05);
    let mut worst: f64 = 0.0;
    for k in 0..150 {
        plant.step(0.01, &[input; 3]).unwrap();
        if k > 60 {
            for cable in 0..3 {
                let v = -plant.line_speeds_m_s()[cable];
                let s = (v / law.transition_m_s).tanh();
                let force =
                    plant.tension_n(cable) * (1.0 + law.gear_friction * s) + law.coulomb_n * s + law.viscous_n_s_m * v;
                worst = worst.max((plant.measured_current_a(cable) - force / law.force_constant_n_a).abs());
            }
        }
    }
    let moved = (plant.counts(1) - counts) as f64 / counts_per_m;
    assert!((moved - (plant.lengths_m()[1] - lengths)).abs() < 2.0 / counts_per_m);
    assert!(worst < 0.15, "current off the law by {worst} A");
}

#[test]
fn a_cable_too_long_among_four_is_loose_and_its_idler_stops() {
    let mut plant = four();
    run(&mut plant, 0.5, &[0.0; 4]);
    let before = plant.counts(0);
    run(&mut plant, 2.0, &[0.3, 0.0, 0.0, 0.0]);
    assert!(plant.slack()[0]);
    let turned_m = (plant.counts(0) - before) as f64 / plant.config().idlers[1].counts_per_m;
    let paid_out_m = plant.lengths_m()[0] - plant.distances_m()[0];
    assert!(turned_m < 0.3 && paid_out_m > 0.3, "turned {turned_m}, loose {paid_out_m}");
}

#[test]
fn a_speed_loop_on_the_idler_runs_away_with_a_broken_cable() {
    let mut plant = three();
    run(&mut plant, 0.5, &[0.0; 3]);
    plant.apply(Fault::BrokenLine { cable: 2, on: true }).unwrap();
    run(&mut plant, 3.0, &[0.02, 0.02, 0.02]);
    assert_eq!(plant.duty(2), 1.0, "full speed, although 2 cm/s were commanded");
    assert!(plant.line_speeds_m_s()[2] > 0.5);
    plant.step(0.01, &[MotorInput::RELEASED; 3]).unwrap();
    run_released(&mut plant, 1.0);
    assert_eq!(plant.line_speeds_m_s()[2], 0.0, "releasing stops it");
}

fn run_released(plant: &mut Plant, seconds: f64) {
    for _ in 0..(seconds / 0.01) as usize {
        plant.step(0.01, &vec![MotorInput::RELEASED; plant.cable_count()]).unwrap();
    }
}

#[test]
fn a_stalled_motor_shows_current_and_no_motion() {
    let mut plant = three();
    run(&mut plant, 0.5, &[0.0; 3]);
    plant.apply(Fault::Stall { cable: 0, on: true }).unwrap();
    let before = plant.counts(0);
    run(&mut plant, 2.0, &[-0.1, 0.0, 0.0]);
    assert!((plant.counts(0) - before).abs() <= 40, "only the stretch changes: {}", plant.counts(0) - before);
    assert!(plant.measured_current_a(0) > 14.0, "{}", plant.measured_current_a(0));
    assert!(plant.voltage_v() < 23.9, "the supply voltage drops");
}

#[test]
fn encoder_faults_and_a_weak_supply_change_the_measurements() {
    let mut plant = three();
    run(&mut plant, 0.5, &[0.0; 3]);
    let before = plant.counts(0);
    plant.apply(Fault::EncoderJump { cable: 0, counts: 5000 }).unwrap();
    assert_eq!(plant.counts(0) - before, 5000);
    plant.apply(Fault::EncoderDead { cable: 2, on: true }).unwrap();
    let dead = plant.counts(2);
    run(&mut plant, 0.5, &[0.05; 3]);
    assert_eq!(plant.counts(2), dead);
    plant.apply(Fault::Supply { voltage_v: 9.0 }).unwrap();
    plant.step(0.01, &[MotorInput::RELEASED; 3]).unwrap();
    assert!(plant.voltage_v() <= 9.0);
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let fly = |mut plant: Plant| {
        for k in 0..400u32 {
            let t = f64::from(k) * 0.01;
            let inputs: Vec<MotorInput> =
                (0..4).map(|i| plant.speed_input(i, 0.1 * (t * (1.0 + 0.3 * i as f64)).sin())).collect();
            plant.step(0.01, &inputs).unwrap();
        }
        plant
    };
    let (a, b) = (fly(four()), fly(four()));
    assert_eq!(a, b);
    assert_eq!(a.position_m().map(f64::to_bits), b.position_m().map(f64::to_bits));
    // A clone of an intermediate state continues identically.
    let c = fly(fly(four()).clone());
    assert_eq!(fly(a), c);
}

#[test]
fn the_step_size_has_little_effect() {
    let fly = |dt: f64| {
        let mut plant = three();
        for _ in 0..(2.0f64 / dt).round() as usize {
            plant.step(dt, &[plant.speed_input(0, -0.05); 3]).unwrap();
        }
        plant.position_m()
    };
    assert!(distance(fly(0.01), fly(0.001)) < 1e-9);
    assert!(distance(fly(0.01), fly(0.0005)) < 1e-9);
    assert!(distance(fly(0.01), fly(0.0002)) < 2e-4);
}

#[test]
fn bad_input_is_refused_in_one_sentence() {
    let nan = PlantConfig::new(THREE.to_vec(), [4.8, f64::NAN, 1.0]);
    let error = Plant::new(nan).unwrap_err();
    let PlantError::Value { key: "start_m", value, accepted } = error else { panic!("{error}") };
    assert!(value.is_nan() && !error.to_string().contains('\n'), "{error}");
    assert!(["start_m", "NaN", accepted].iter().all(|part| error.to_string().contains(part)), "{error}");
    let outside = Plant::new(PlantConfig::new(THREE.to_vec(), [20.0, 2.0, 1.0])).unwrap_err();
    assert!(matches!(outside, PlantError::NoEquilibrium { .. }), "{outside}");
    let mut plant = three();
    assert!(plant.step(0.01, &[MotorInput::RELEASED]).is_err());
    assert!(plant.step(f64::NAN, &[MotorInput::RELEASED; 3]).is_err());
    assert!(plant.step(0.01, &[MotorInput::Speed(f64::INFINITY); 3]).is_err());
    assert!(plant.apply(Fault::Stall { cable: 3, on: true }).is_err());
    assert_eq!(plant, three(), "nothing moved");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    /// With any cables and commands the motion stays physical: the node is within reach of its cables, and cable speeds
    /// are within the range of the motors.
    #[test]
    fn every_configuration_is_stable(
        stiffness in 500.0..1e6f64,
        mass in 0.05..20.0f64,
        routed in 0.0..10.0f64,
        inertia in 0.1..50.0f64,
        commands in proptest::collection::vec(-0.5..0.5f64, 12),
        seed in 0u64..1000,
    ) {
        let mut config = PlantConfig::new(FOUR.to_vec(), [4.0, 4.2, 1.1]);
        config.line.stiffness_n = stiffness;
        config.node.mass_kg = mass;
        config.routed_length_m = vec![routed; 4];
        config.motor.inertia_kg = inertia;
        config.start_limits_n = [0.0, 1000.0];
        config.seed = seed;
        let mut plant = Plant::new(config).unwrap();
        for chunk in commands.chunks(4) {
            run(&mut plant, 0.3, chunk);
            let tensions = plant.tensions_n();
            prop_assert!(tensions.iter().all(|t| (0.0..5000.0).contains(t)), "{tensions:?}");
            prop_assert!(distance(plant.velocity_m_s(), [0.0; 3]) < 20.0, "{:?}", plant.velocity_m_s());
            prop_assert!(plant.position_m()[2] > -0.5 && plant.position_m()[2] < 6.0, "{:?}", plant.position_m());
            prop_assert!(plant.line_speeds_m_s().iter().all(|v| v.abs() < 1.5), "{:?}", plant.line_speeds_m_s());
        }
    }
}

/// In water, without weight and with every cable broken, only drag remains: v = v0 / (1 + c v0 t / m).
#[test]
fn drag_alone_slows_a_free_floating_node_within_its_plane() {
    let corners = vec![[0.0, 0.0, 4.2], [8.0, 0.0, 4.2], [8.0, 0.0, 0.3], [0.0, 0.0, 0.3]];
    let mut config = PlantConfig::new(corners, [4.0, 0.0, 2.0]);
    (config.planar, config.node.mass_kg, config.node.net_weight_n) = (true, 6.0, Some(0.0));
    (config.node.drag_n_s2_m2, config.start_limits_n) = (25.0, [10.0, 80.0]);
    let mut plant = Plant::new(config.clone()).unwrap();
    // Only preload acts: the node does not move.
    assert!(plant.tensions_n().iter().all(|tension| *tension >= 10.0 - 1e-6), "{:?}", plant.tensions_n());
    for _ in 0..100 {
        plant.step(0.01, &[MotorInput::Speed(0.0); 4]).unwrap();
    }
    let moved: f64 = plant.position_m().iter().zip([4.0, 0.0, 2.0]).map(|(a, b)| (a - b).powi(2)).sum();
    assert!(moved.sqrt() < 1e-3, "{:?}", plant.position_m());
    for cable in 0..4 {
        plant.apply(Fault::BrokenLine { cable, on: true }).unwrap();
    }
    let v0 = 0.5;
    plant.push_node([2.0, 0.3, 2.0], [v0, 0.2, 0.0]);
    let seconds = 2.0;
    for _ in 0..200 {
        plant.step(0.01, &[MotorInput::RELEASED; 4]).unwrap();
    }
    let expected = v0 / (1.0 + 25.0 * v0 * seconds / 6.0);
    let [vx, vy, vz] = plant.velocity_m_s();
    assert!((vx - expected).abs() < 2e-3 * expected, "{vx} instead of {expected} m/s");
    let way = 6.0 / 25.0 * (1.0 + 25.0 * v0 * seconds / 6.0f64).ln();
    assert!((plant.position_m()[0] - 2.0 - way).abs() < 2e-3, "{:?} instead of {way} m", plant.position_m());
    assert_eq!((vy, vz, plant.position_m()[1]), (0.0, 0.0, 0.0));
    config.start_m[1] = 0.1;
    let error = Plant::new(config).unwrap_err();
    assert!(matches!(error, PlantError::Value { value: 0.1, .. }), "{error}");
}
