//! A world without any of what models leave out has the bits of the plant before it had a world.
#![allow(clippy::unwrap_used)]

use plant::pulley::Guide;
use plant::world::CableWorld;
use plant::{Fault, MotorInput, Plant, PlantConfig};

/// Hash of every bit of position, velocity, counts, tensions, currents and energy over 15 s (FNV-1a).
fn fingerprint(mut plant: Plant) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |value: u64| hash = (hash ^ value).wrapping_mul(0x0100_0000_01b3);
    let count = plant.cable_count();
    for cycle in 0..1500_u32 {
        let speed = |i: usize| 0.03 * (f64::from(cycle) * 0.01 * (1.0 + i as f64)).sin();
        let inputs: Vec<MotorInput> = (0..count).map(|i| plant.speed_input(i, speed(i))).collect();
        if cycle == 900 {
            plant.apply(Fault::IdlerSlip { cable: 0, share: 0.1 }).unwrap();
        }
        if cycle == 1200 {
            plant.apply(Fault::BrokenLine { cable: 0, on: true }).unwrap();
        }
        plant.step(0.01, &inputs).unwrap();
        plant.position_m().iter().chain(&plant.velocity_m_s()).for_each(|v| add(v.to_bits()));
        for i in 0..count {
            add(plant.counts(i) as u64);
            add(plant.tension_n(i).to_bits());
            add(plant.measured_current_a(i).to_bits());
        }
        add(plant.energy_j().to_bits());
    }
    hash
}

/// Three cables, four cables and a planar robot.
fn configs() -> [PlantConfig; 3] {
    let anchors = vec![[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];
    let three = PlantConfig::new(anchors, [4.8, 2.9, 1.0]);
    let anchors = vec![[0.0, 0.0, 3.0], [9.0, 0.0, 3.2], [9.2, 8.0, 2.9], [-0.2, 8.1, 3.1]];
    let four = PlantConfig::new(anchors, [4.0, 4.2, 1.1]);
    let mut planar = PlantConfig::new(vec![[0.0, 0.0, 3.0], [6.0, 0.0, 3.0]], [2.0, 0.0, 1.0]);
    planar.planar = true;
    [three, four, planar]
}

#[test]
fn the_default_world_changes_no_bit() {
    // Computed with the plant of the commit before `world` existed.
    let before = [0xa762_2f65_dbbd_aabc, 0x0d86_0a5f_9b0b_c835, 0xc487_26c2_1fdd_88cb];
    assert_eq!(configs().map(|config| fingerprint(Plant::new(config).unwrap())), before);
}

#[test]
fn a_world_that_states_the_defaults_changes_no_bit() {
    for config in configs() {
        let mut stated = config.clone();
        let cable = CableWorld {
            motor: Some(config.motor),
            line: Some(config.line),
            drum: Some(config.drum),
            guide: Guide::Swivel { radius_m: 0.0 },
            ..CableWorld::default()
        };
        stated.world.cables = vec![cable; config.cable_count()];
        assert_eq!(fingerprint(Plant::new(stated).unwrap()), fingerprint(Plant::new(config).unwrap()));
    }
}
