//! Each part of the world compared with mechanics.
#![allow(clippy::unwrap_used)]

use plant::line::CableConfig;
use plant::motor::MotorConfig;
use plant::pulley::Guide;
use plant::world::{CableWorld, Pendulum, Warming, Wind};
use plant::{MotorInput, Plant, PlantConfig, STANDARD_GRAVITY};

const THREE: [[f64; 3]; 3] = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];
const START_M: [f64; 3] = [4.8, 2.9, 1.0];

fn config() -> PlantConfig {
    PlantConfig::new(THREE.to_vec(), START_M)
}

/// A plant whose cables all have this world.
fn plant(cable: CableWorld) -> Plant {
    let mut config = config();
    config.world.cables = vec![cable; 3];
    Plant::new(config).unwrap()
}

/// A node of 1 kg on one cable with an anchor 10 m above, 1 m routed, without winding irregularities.
fn pendulum(change: impl FnOnce(&mut PlantConfig)) -> Plant {
    let mut config = PlantConfig::new(vec![[0.0, 0.0, 12.0]], [0.0, 0.0, 2.0]);
    config.routed_length_m = vec![1.0];
    config.node.mass_kg = 1.0;
    config.drum.lay_noise = 0.0;
    config.world.cables = vec![CableWorld::default()];
    change(&mut config);
    Plant::new(config).unwrap()
}

fn hold(plant: &mut Plant, seconds: f64) {
    run(plant, seconds, 0.0);
}

fn run(plant: &mut Plant, seconds: f64, speed_m_s: f64) {
    let inputs: Vec<MotorInput> = (0..plant.cable_count()).map(|i| plant.speed_input(i, speed_m_s)).collect();
    for _ in 0..(seconds / 0.01).round() as usize {
        plant.step(0.01, &inputs).unwrap();
    }
}

fn release(plant: &mut Plant, seconds: f64) {
    let inputs = vec![MotorInput::RELEASED; plant.cable_count()];
    for _ in 0..(seconds / 0.01).round() as usize {
        plant.step(0.01, &inputs).unwrap();
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn every_world_starts_at_rest() {
    let worlds = [
        CableWorld { guide: Guide::Swivel { radius_m: 0.04 }, ..CableWorld::default() },
        CableWorld { guide: Guide::Fixed { radius_m: 0.04, azimuth_rad: 0.7 }, ..CableWorld::default() },
        CableWorld { mass_kg_m: 0.01, ..CableWorld::default() },
        CableWorld { pole_stiffness_n_m: 2000.0, ..CableWorld::default() },
        CableWorld { attachment_m: [0.05, -0.03, 0.02], ..CableWorld::default() },
        CableWorld { pulley_friction: 0.1, backlash_m: 0.005, ..CableWorld::default() },
    ];
    for cable in worlds {
        let mut plant = plant(cable.clone());
        release(&mut plant, 3.0);
        assert!(distance(plant.position_m(), START_M) < 1e-6, "{cable:?}: {:?}", plant.position_m());
    }
}

/// The forces of free cables from the points where they leave the wheels carry the node.
#[test]
fn cables_from_wheels_carry_the_weight() {
    let radius_m = 0.1;
    let plant = plant(CableWorld { guide: Guide::Swivel { radius_m }, ..CableWorld::default() });
    let mut force = [0.0, 0.0, -1.2 * STANDARD_GRAVITY];
    for (anchor, tension) in THREE.iter().zip(plant.tensions_n()) {
        let leg: Vec<f64> = (0..3).map(|axis| START_M[axis] - anchor[axis]).collect();
        let p = leg[0].hypot(leg[1]);
        // The tangent from the node to the circle, by bisection of the angle between radius and free cable.
        let gap = |a: f64| (p - radius_m + radius_m * a.cos()) * -a.cos() + (leg[2] - radius_m * a.sin()) * a.sin();
        let (mut low, mut high) = (0.1, 3.0);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if gap(low) * gap(middle) <= 0.0 { high = middle } else { low = middle }
        }
        let out = p - radius_m * (1.0 - low.cos());
        let up = leg[2] - radius_m * low.sin();
        let free = out.hypot(up);
        for axis in 0..2 {
            force[axis] -= tension * out / free * leg[axis] / p;
        }
        force[2] -= tension * up / free;
    }
    assert!(force.iter().all(|f| f.abs() < 1e-6), "{force:?}");
}

#[test]
fn warm_cables_lower_the_node_by_their_strain() {
    let mut plant = pendulum(|config| {
        config.world.cables[0].expansion_per_k = 4e-5;
        config.world.warming = Warming { change_k: 15.0, over_s: 4.0 };
    });
    release(&mut plant, 10.0);
    // 11 m of cable.
    let sunk_m = 2.0 - plant.position_m()[2];
    assert!((sunk_m - 11.0 * 4e-5 * 15.0).abs() < 2e-5, "{sunk_m}");
}

#[test]
fn counts_follow_scale_slip_and_stretch() {
    let turned = |change: fn(&mut PlantConfig)| {
        let mut plant = pendulum(|config| {
            config.node.mass_kg = 3.0;
            change(config);
        });
        run(&mut plant, 4.0, 0.1);
        hold(&mut plant, 2.0);
        let off_m = plant.lengths_m()[0];
        (plant.counts(0) as f64, off_m)
    };
    let first = pendulum(|config| config.node.mass_kg = 3.0).lengths_m()[0];
    let counts_per_m = config().idlers[0].counts_per_m;
    let plain = turned(|_| ());
    assert!((plain.0 / (plain.1 - first) - counts_per_m).abs() < 5.0, "{plain:?}");
    let scaled = turned(|config| config.world.cables[0].count_scale = 1.01);
    assert!((scaled.0 / (scaled.1 - first) / counts_per_m - 1.01).abs() < 1e-4, "{scaled:?}");
    let stretched = turned(|config| config.world.cables[0].counts_stretched = true);
    // 3 kg on 6 kN: 0.49 %.
    let strain = 3.0 * STANDARD_GRAVITY / 6000.0;
    assert!((stretched.0 / (stretched.1 - first) / counts_per_m - 1.0 - strain).abs() < 2e-4, "{stretched:?}");
}

#[test]
fn a_pole_gives_way_by_force_over_stiffness() {
    let stiff = plant(CableWorld::default());
    let soft = plant(CableWorld { pole_stiffness_n_m: 5000.0, ..CableWorld::default() });
    for (i, anchor) in THREE.iter().enumerate() {
        let leg: Vec<f64> = (0..3).map(|axis| START_M[axis] - anchor[axis]).collect();
        let length = leg.iter().map(|l| l * l).sum::<f64>().sqrt();
        let level = leg[0].hypot(leg[1]) / length;
        // The pole leans towards the node, so less cable is off the drum.
        let shorter_m = stiff.lengths_m()[i] - soft.lengths_m()[i];
        let expected_m = stiff.tension_n(i) * level * level / 5000.0;
        assert!((shorter_m - expected_m).abs() < 0.02 * expected_m + 1e-6, "{shorter_m} {expected_m}");
    }
}

/// A cable with weight needs more length than its chord: compared with the catenary, solved numerically.
#[test]
fn a_heavy_cable_bows_like_a_catenary() {
    let mass_kg_m = 0.01;
    let light = plant(CableWorld::default());
    let heavy = plant(CableWorld { mass_kg_m, ..CableWorld::default() });
    for (i, anchor) in THREE.iter().enumerate() {
        let tension_n = heavy.tension_n(i);
        let leg: Vec<f64> = (0..3).map(|axis| anchor[axis] - START_M[axis]).collect();
        let (level_m, rise_m) = (leg[0].hypot(leg[1]), leg[2]);
        let chord_m = level_m.hypot(rise_m);
        // The catenary with the horizontal tension of the chord: y = c cosh((x - x0) / c).
        let c = tension_n * level_m / chord_m / (mass_kg_m * STANDARD_GRAVITY);
        let arc_m = (rise_m * rise_m + (2.0 * c * (level_m / (2.0 * c)).sinh()).powi(2)).sqrt();
        // The routed part stretches under the tension at the anchor, the free one under that in the middle.
        let anchor_n = tension_n + 0.5 * mass_kg_m * STANDARD_GRAVITY * rise_m;
        let unstretched_m = chord_m / (1.0 + tension_n / 6000.0) + 6.0 / (1.0 + anchor_n / 6000.0);
        let bow_m = heavy.lengths_m()[i] + 6.0 - unstretched_m;
        let expected_m = arc_m - chord_m;
        assert!((bow_m - expected_m).abs() < 0.05 * expected_m, "{bow_m} {expected_m}");
        assert!(heavy.tension_n(i) > light.tension_n(i), "the node carries half of the cables");
    }
}

#[test]
fn pulley_friction_keeps_a_part_of_the_tension_from_the_motor() {
    let currents = |friction: f64, speed_m_s: f64| {
        let mut plant = pendulum(|config| {
            config.world.cables[0].pulley_friction = friction;
            config.motor.gear_friction = 0.0;
            config.motor.coulomb_n = 0.0;
            config.motor.viscous_n_s_m = 0.0;
        });
        run(&mut plant, 2.0, speed_m_s);
        // The node bounces on its cable, so the mean over many periods of 0.27 s.
        let inputs = [plant.speed_input(0, speed_m_s)];
        let mut sum = 0.0;
        for _ in 0..1000 {
            plant.step(0.01, &inputs).unwrap();
            sum += plant.measured_current_a(0);
        }
        sum / 1000.0
    };
    for (speed_m_s, side) in [(-0.1, 1.0), (0.1, -1.0)] {
        let share = currents(0.1, speed_m_s) / currents(0.0, speed_m_s) - 1.0;
        assert!((share - 0.1 * side).abs() < 0.02, "{speed_m_s}: {share}");
    }
}

/// Without load the drum stays behind its motor by the play; under load it does not.
#[test]
fn play_shows_only_without_load() {
    let paid_out = |backlash_m: f64, broken: bool| {
        let mut plant = pendulum(|config| config.world.cables[0].backlash_m = backlash_m);
        plant.apply(plant::Fault::BrokenLine { cable: 0, on: broken }).unwrap();
        let before = plant.lengths_m()[0];
        // Duty, because the speed loop sees the idler, which turns with the drum.
        for _ in 0..100 {
            plant.step(0.01, &[MotorInput::Duty(0.3)]).unwrap();
        }
        plant.lengths_m()[0] - before
    };
    let loaded = paid_out(0.0, false) - paid_out(0.02, false);
    let free = paid_out(0.0, true) - paid_out(0.02, true);
    assert!(loaded.abs() < 1e-3, "{loaded}");
    assert!((free - 0.02).abs() < 1e-3, "{free}");
}

#[test]
fn break_away_needs_more_current_than_motion() {
    let stiction = 0.4;
    // The largest current while the voltage rises slowly from rest, and the current in motion afterwards.
    let ramp = |stiction: f64| {
        let motor = MotorConfig { stiction, gear_friction: 0.0, viscous_n_s_m: 0.0, ..MotorConfig::default() };
        let mut plant = pendulum(|config| config.motor = motor);
        let mut peak = 0.0f64;
        for i in 0..2000 {
            plant.step(0.01, &[MotorInput::Duty(-f64::from(i) * 0.000_02)]).unwrap();
            peak = peak.max(plant.measured_current_a(0));
        }
        peak
    };
    let (with, without) = (ramp(stiction), ramp(0.0));
    // The weight and 3 N of friction at 40 N/A; the friction that sticks has the excess.
    let moving_a = (STANDARD_GRAVITY + 3.0) / 40.0;
    let sticking_a = (STANDARD_GRAVITY + 3.0 * (1.0 + stiction)) / 40.0;
    assert!(without < moving_a + 1e-3, "{without} {moving_a}");
    assert!(with > 0.97 * sticking_a && with < sticking_a + 1e-3, "{with} {sticking_a}");
}

#[test]
fn wind_pushes_node_and_cables() {
    let mut blown = pendulum(|config| {
        config.world.wind = Wind { mean_m_s: [8.0, 0.0, 0.0], ..Wind::default() };
        config.start_limits_n = [0.0, 1000.0];
        config.start_m = [0.0, 0.0, 2.0];
        config.start_tensions_n = None;
        config.anchors_m = vec![[0.0, 0.0, 12.0], [10.0, 0.0, 12.0], [0.0, 10.0, 12.0]];
        config.start_m = [3.0, 3.0, 2.0];
        config.routed_length_m = vec![1.0; 3];
        config.idlers = vec![config.idlers[0]; 3];
        config.world.cables = vec![CableWorld::default(); 3];
    });
    let mut force = [0.02 * 64.0, 0.0, -STANDARD_GRAVITY];
    let anchors = blown.config().anchors_m.clone();
    for (anchor, tension) in anchors.iter().zip(blown.tensions_n()) {
        let leg: Vec<f64> = (0..3).map(|axis| anchor[axis] - blown.position_m()[axis]).collect();
        let length = leg.iter().map(|l| l * l).sum::<f64>().sqrt();
        for axis in 0..3 {
            force[axis] += tension * leg[axis] / length;
        }
        // Half of the drag of a cylinder of this length and 0.285 mm diameter.
        force[0] += 0.5 * 0.66 * 0.000_285 * length * 64.0;
    }
    assert!(force.iter().all(|f| f.abs() < 1e-6), "{force:?}");
    release(&mut blown, 2.0);
    assert!(distance(blown.position_m(), [3.0, 3.0, 2.0]) < 1e-4, "{:?}", blown.position_m());
}

#[test]
fn a_swinging_body_tilts_its_sensors() {
    let mut config = config();
    config.world.pendulum = Pendulum { length_m: 0.3, damping: 0.03 };
    let mut plant = Plant::new(config).unwrap();
    let lever = [0.0, 0.0, -0.9];
    let straight = |plant: &Plant| {
        let at = plant.position_m();
        distance(plant.place_m(lever), [at[0], at[1], at[2] - 0.9])
    };
    assert!(straight(&plant) < 1e-12);
    let inputs: Vec<MotorInput> = [0.2, -0.2, 0.1].iter().enumerate().map(|(i, &v)| plant.speed_input(i, v)).collect();
    let mut largest = 0.0f64;
    for _ in 0..100 {
        plant.step(0.01, &inputs).unwrap();
        largest = largest.max(straight(&plant));
        let length = distance(plant.place_m(lever), plant.position_m());
        assert!((length - 0.9).abs() < 0.01, "{length}");
    }
    assert!(largest > 0.005 && largest < 0.3, "{largest}");
}

#[test]
fn parts_of_one_cable_change_only_this_cable() {
    let mut config = config();
    config.world.cables = vec![CableWorld::default(); 3];
    config.world.cables[1].line = Some(CableConfig { stiffness_n: 3000.0, ..config.line });
    let (plant, plain) =
        (Plant::new(config.clone()).unwrap(), Plant::new(PlantConfig::new(THREE.to_vec(), START_M)).unwrap());
    for i in 0..3 {
        let changed = (plant.lengths_m()[i] - plain.lengths_m()[i]).abs() > 1e-6;
        assert_eq!(changed, i == 1);
    }
    config.world.cables.pop();
    assert!(Plant::new(config).is_err(), "one world for each cable");
}
