//! The plant of a section `[motor_box.truth]`.

use plant::PlantConfig;
use plant::motor::MotorConfig;
use plant::pulley::Guide;
use plant::world::{CableWorld, Pendulum, Warming, Wind};

use config::{DrumEncoder, RobotFile};

use crate::section::{PerCable, TrueGuide, TruthSection};

/// Changes the plant of a robot file to the true world. `counts_per_m` is what the software assumes.
pub(crate) fn apply(truth: &TruthSection, robot: &RobotFile, counts_per_m: &[f64], config: &mut PlantConfig) {
    if let Some(anchors) = &truth.anchors_m {
        config.anchors_m = anchors.to_vec();
    }
    config.seed = truth.seed.unwrap_or(config.seed);
    let cables = config.cable_count();
    if let Some(routed) = &truth.routed_length_m {
        config.routed_length_m = (0..cables).map(|i| routed.at(i)).collect();
    }
    if let Some(slip) = &truth.slip {
        config.idlers.iter_mut().enumerate().for_each(|(i, idler)| idler.slip = slip.at(i));
    }
    let node = &mut config.node;
    node.mass_kg = truth.node_mass_kg.unwrap_or(node.mass_kg);
    node.net_weight_n = truth.net_weight_n.or(node.net_weight_n);
    node.drag_n_s2_m2 = truth.drag_n_s2_m2.unwrap_or(node.drag_n_s2_m2);
    node.ground_m = truth.ground_m.or(node.ground_m);
    let middle = middle_of(&config.anchors_m);
    let world = (0..cables).map(|i| {
        let guide = guide(truth, robot, i, config.anchors_m[i], middle);
        cable(truth, robot, counts_per_m[i], config, i, guide)
    });
    config.world.cables = world.collect();
    let [x, y] = truth.wind_m_s;
    let wind = Wind::default();
    config.world.wind = Wind {
        mean_m_s: [x, y, 0.0],
        gust_m_s: truth.gust_m_s,
        gust_length_m: truth.gust_length_m.unwrap_or(wind.gust_length_m),
        ..wind
    };
    config.world.warming = Warming { change_k: truth.warming_k, over_s: truth.warming_s };
    let damping = truth.pendulum_damping.unwrap_or(Pendulum::default().damping);
    config.world.pendulum = Pendulum { length_m: truth.pendulum_m, damping };
}

fn cable(
    truth: &TruthSection,
    robot: &RobotFile,
    counts_per_m: f64,
    config: &PlantConfig,
    i: usize,
    guide: Guide,
) -> CableWorld {
    let or = |given: &Option<PerCable>, other: f64| given.as_ref().map_or(other, |given| given.at(i));
    let plain = CableWorld::default();
    let motor = MotorConfig {
        force_constant_n_a: or(&truth.force_constant_n_a, config.motor.force_constant_n_a),
        resistance_ohm: or(&truth.resistance_ohm, config.motor.resistance_ohm),
        gear_friction: or(&truth.gear_friction, config.motor.gear_friction),
        coulomb_n: or(&truth.coulomb_n, config.motor.coulomb_n),
        viscous_n_s_m: or(&truth.viscous_n_s_m, config.motor.viscous_n_s_m),
        stiction: or(&truth.stiction, config.motor.stiction),
        ..config.motor
    };
    let (mut line, mut drum) = (config.line, config.drum);
    line.stiffness_n = or(&truth.stiffness_n, line.stiffness_n);
    drum.capacity_m = robot.drum.as_ref().and_then(|drum| drum.cable_m.get(i).copied()).unwrap_or(drum.capacity_m);
    let stated_radius_m = drum.radius_m;
    drum.radius_m = or(&truth.drum_radius_m, drum.radius_m);
    let counts_turns = robot.drum.as_ref().is_some_and(|drum| drum.encoder == DrumEncoder::First);
    // A second encoder on a larger drum than stated turns less. Beside one that counts turns there is an idler.
    let second_scale = if counts_turns { 1.0 } else { stated_radius_m / drum.radius_m };
    let dry_kg_m = or(&truth.line_mass_kg_m, robot.lines.mass_kg_m);
    let wet_kg_m = or(&truth.line_wet_mass_kg_m, dry_kg_m);
    CableWorld {
        motor: Some(motor),
        line: Some(line),
        drum: Some(drum),
        guide,
        pulley_friction: or(&truth.pulley_friction, plain.pulley_friction),
        count_scale: truth.counts_per_m.as_ref().map_or(1.0, |counts| counts.at(i) / counts_per_m.abs()),
        counts_stretched: truth
            .counts_stretched
            .as_ref()
            .map_or(robot.lines.counts_stretched.at(i), |cables| cables[i]),
        second_scale,
        counts_turns,
        attachment_m: truth.attachments_m.as_ref().map_or([0.0; 3], |points| points[i]),
        mass_kg_m: dry_kg_m + truth.wetness * (wet_kg_m - dry_kg_m),
        expansion_per_k: or(&truth.thermal_expansion_per_k, plain.expansion_per_k),
        pole_stiffness_n_m: or(&truth.pole_stiffness_n_m, plain.pole_stiffness_n_m),
        backlash_m: or(&truth.backlash_m, plain.backlash_m),
    }
}

/// What a cable leaves from. The wheels are those of the robot file unless the world defines others.
fn guide(truth: &TruthSection, robot: &RobotFile, i: usize, anchor_m: [f64; 3], middle_m: [f64; 2]) -> Guide {
    let assumed = robot.robot.pulley_radius_m.get(i).copied().unwrap_or(0.0);
    let radius_m = truth.pulley_radius_m.as_ref().map_or(assumed, |radius| radius.at(i));
    let inward = (middle_m[1] - anchor_m[1]).atan2(middle_m[0] - anchor_m[0]);
    let azimuth_rad = truth.pulley_azimuth_deg.as_ref().map_or(inward, |degrees| degrees.at(i).to_radians());
    let kind = truth.pulley.unwrap_or(TrueGuide::assumed(robot.robot.pulley.unwrap_or_default()));
    kind.guide(radius_m, azimuth_rad)
}

fn middle_of(anchors_m: &[[f64; 3]]) -> [f64; 2] {
    let mean = |axis: usize| anchors_m.iter().map(|anchor| anchor[axis]).sum::<f64>() / anchors_m.len() as f64;
    [mean(0), mean(1)]
}
