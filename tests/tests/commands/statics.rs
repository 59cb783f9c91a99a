//! The plant at rest compared with exact elastic catenaries over wheels in numpy, which share no formula with it.

use nims_tests::python;
use plant::line::CableConfig;
use plant::pulley::Guide;
use plant::world::CableWorld;
use plant::{Plant, PlantConfig, World};
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

struct Robot {
    name: &'static str,
    anchors_m: &'static [[f64; 3]],
    routed_m: &'static [f64],
    node_mass_kg: f64,
    /// Diameter of the braid, m.
    diameter_m: f64,
    limits_n: [f64; 2],
    /// Corners of the places.
    low_m: [f64; 3],
    high_m: [f64; 3],
}

/// The sizes of the example robots: 10 m, a river crossing, a forest span.
const ROBOTS: [Robot; 3] = [
    Robot {
        name: "10 m",
        anchors_m: &[[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]],
        routed_m: &[6.0; 3],
        node_mass_kg: 1.2,
        diameter_m: 0.000_33,
        limits_n: [1.0, 80.0],
        low_m: [3.0, 1.5, 0.2],
        high_m: [6.5, 4.5, 2.0],
    },
    Robot {
        name: "30 x 20 m",
        anchors_m: &[[0.0, 0.0, 6.2], [30.2, 0.4, 6.6], [29.6, 20.3, 6.0], [0.3, 19.8, 6.4]],
        routed_m: &[22.0, 22.0, 42.0, 42.0],
        node_mass_kg: 2.5,
        diameter_m: 0.001,
        limits_n: [5.0, 150.0],
        low_m: [6.0, 4.0, 0.5],
        high_m: [24.0, 16.0, 3.5],
    },
    Robot {
        name: "80 x 20 m",
        anchors_m: &[[0.0, 0.0, 15.2], [80.3, 0.6, 16.1], [79.6, 20.4, 14.8], [0.5, 19.7, 15.6]],
        routed_m: &[16.0, 16.0, 36.0, 36.0],
        node_mass_kg: 5.0,
        diameter_m: 0.0015,
        limits_n: [8.0, 250.0],
        low_m: [15.0, 4.0, 1.0],
        high_m: [65.0, 16.0, 10.0],
    },
];

/// A place, with eyes or wheels and with no cable weight, that of dry or that of wet cables: as JSON on one line. None
/// where the cables cannot hold the node.
fn place(robot: &Robot, share: [f64; 3], radius_m: f64, soaked: f64) -> Option<String> {
    let area_m2 = 0.25 * std::f64::consts::PI * robot.diameter_m * robot.diameter_m;
    // Polyethylene fibre of 970 kg/m³ that fills 80 % of the section, and 35 GPa of the section of a braid.
    let (mass_kg_m, stiffness_n) = (970.0 * 0.8 * area_m2 * soaked, 35e9 * area_m2);
    let start_m = std::array::from_fn(|k| robot.low_m[k] + share[k] * (robot.high_m[k] - robot.low_m[k]));
    let mut config = PlantConfig::new(robot.anchors_m.to_vec(), start_m);
    config.routed_length_m = robot.routed_m.to_vec();
    config.node.mass_kg = robot.node_mass_kg;
    config.line = CableConfig { stiffness_n, ..CableConfig::default() };
    config.start_limits_n = robot.limits_n;
    let guide = if radius_m > 0.0 { Guide::Swivel { radius_m } } else { Guide::Eye };
    let cable = CableWorld { guide, mass_kg_m, ..CableWorld::default() };
    config.world = World { cables: vec![cable; robot.anchors_m.len()], ..World::default() };
    let gravity_m_s2 = config.gravity_m_s2;
    let plant = Plant::new(config).ok()?;
    Some(format!(
        r#"{{"robot":"{}","anchors_m":{:?},"routed_m":{:?},"node_mass_kg":{:?},"radius_m":{radius_m:?},"mass_kg_m":{mass_kg_m:?},"stiffness_n":{stiffness_n:?},"gravity_m_s2":{gravity_m_s2:?},"unstretched_m":{:?},"position_m":{:?},"tensions_n":{:?},"routed_n":{:?}}}"#,
        robot.name,
        robot.anchors_m,
        robot.routed_m,
        robot.node_mass_kg,
        plant.lengths_m(),
        plant.position_m(),
        plant.tensions_n(),
        plant.drum_tensions_n(),
    ))
}

#[test]
fn the_plant_hangs_where_catenaries_over_wheels_hang() {
    let mut lines = String::new();
    for robot in &ROBOTS {
        for (radius_m, soaked) in [(0.0, 0.0), (0.03, 0.0), (0.0, 1.0), (0.04, 1.0), (0.03, 1.5)] {
            for x in [0.0, 0.45, 1.0] {
                for (y, z) in [(0.0, 0.3), (0.5, 0.0), (0.5, 1.0), (1.0, 0.6)] {
                    if let Some(line) = place(robot, [x, y, z], radius_m, soaked) {
                        writeln!(lines, "{line}").unwrap();
                    }
                }
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("places.jsonl");
    std::fs::write(&file, lines).unwrap();
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("python/check_statics.py");
    let output = Command::new(python()).arg(program).arg(&file).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    println!("{text}");
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
}
