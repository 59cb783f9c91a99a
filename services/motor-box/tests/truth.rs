//! `[motor_box.truth]`: its documentation, its errors, and what it changes.
#![allow(clippy::unwrap_used)]

use config::SystemFile;
use motor_box::section::TruthSection;
use motor_box::{BoxConfig, MotorBoxSection};
use plant::PlantConfig;
use plant::pulley::Guide;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The keys of the section, from its error message about an unknown key.
fn keys() -> Vec<String> {
    let error = toml::from_str::<TruthSection>("no-such-key = 1").unwrap_err();
    let (_, expected) = error.message().split_once("expected ").unwrap();
    expected.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The demonstration's system file with this section, and the line of its header.
fn system(truth: &str) -> (SystemFile, usize) {
    let configs = root().join("configs");
    let text = std::fs::read_to_string(configs.join("systems/demo3.toml")).unwrap();
    let robot = configs.join("robots/lab3.toml").canonicalize().unwrap();
    let text = text.replace("../robots/lab3.toml", &robot.to_string_lossy());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("system.toml");
    std::fs::write(&path, format!("{text}\n[motor_box.truth]\n{truth}\n")).unwrap();
    (SystemFile::load(&path).unwrap(), text.lines().count() + 2)
}

fn plant(truth: &str) -> PlantConfig {
    let (file, _) = system(truth);
    BoxConfig::from_files(&file, &file.robot_file().unwrap(), Path::new("/")).unwrap().plant
}

#[test]
fn every_key_is_documented_with_unit_default_and_origin() {
    let text = std::fs::read_to_string(root().join("docs/truth.md")).unwrap();
    let rows: Vec<Vec<&str>> =
        text.lines().filter(|line| line.starts_with("| `")).map(|line| line.split(" | ").collect()).collect();
    for key in keys() {
        let row =
            rows.iter().find(|row| row[0] == format!("| `{key}`")).unwrap_or_else(|| panic!("`{key}` is missing"));
        assert!(row.len() == 5 && row[2..].iter().all(|cell| !cell.trim().is_empty()), "{row:?}");
    }
    assert_eq!(rows.len(), keys().len(), "a row of the table is no key");
}

#[test]
fn an_error_names_file_line_and_key() {
    let cases = [
        ("node_mas_kg = 1.0", "unknown field `node_mas_kg`"),
        ("node_mass_kg = 0.0", "`motor_box.truth.node_mass_kg` is 0; accepted: 0.01 to 1000 kg"),
        ("stiffness_n = [5e3, 5e3]", "`motor_box.truth.stiffness_n` has 2 values for 3 cables"),
        ("stiffness_n = [5e3, 5e3, nan]", "`motor_box.truth.stiffness_n` is NaN; accepted: 100 to 1e7 N"),
        ("slip = \"none\"", "`motor_box.truth.slip` is \"none\"; accepted: a number, or one for each cable"),
        ("pulley = \"swivels\"", "did you mean swivel?"),
        ("anchors_m = [[0.0, 3.0], [9.0, 3.0], [4.0, 3.0]]", "points of another kind"),
        ("counts_per_m = 21000.0\nwetness = 2.0", "`motor_box.truth.wetness` is 2; accepted: 0 to 1"),
        ("counts_per_m = 100.0", "half to twice that of [motor_io]"),
        ("attachments_m = [[0.0, 0.0, 0.0]]", "has 1 values for 3 cables"),
        ("attachments_m = [[0, 0, 0, 1], [0, 0, 0], [0, 0, 0]]", "has 4 entries; accepted: 3"),
    ];
    for (text, part) in cases {
        let (file, head) = system(&format!("# comment\n{text}"));
        let error = MotorBoxSection::from_file(&file, &file.robot_file().unwrap()).unwrap_err();
        let line = if text.contains('\n') { head + 3 } else { head + 2 };
        let start = format!("system.toml, line {line}: ");
        assert!(error.to_string().contains(&start) && error.to_string().contains(part), "{error} (line {line})");
        assert!(error.key().is_some_and(|key| key.starts_with("motor_box.truth")), "{:?}", error.key());
    }
}

#[test]
fn without_the_section_the_plant_has_no_world() {
    let file = SystemFile::load(&root().join("configs/systems/demo3.toml")).unwrap();
    let plain = BoxConfig::from_files(&file, &file.robot_file().unwrap(), Path::new("/")).unwrap().plant;
    assert_eq!(plain.world, plant::World::default());
}

/// Each key changes the plant, and only what it names.
#[test]
fn each_key_reaches_the_plant() {
    type Check = fn(&PlantConfig) -> bool;
    let cases: [(&str, Check); 35] = [
        ("seed = 12", |p| p.seed == 12),
        ("anchors_m = [[0, 0, 3.05], [9.8, 0, 3.10], [4.8, 8.6, 2.98]]", |p| p.anchors_m[2][0] == 4.8),
        ("pulley = \"swivel\"\npulley_radius_m = 0.03", |p| {
            p.world.cables[0].guide == Guide::Swivel { radius_m: 0.03 }
        }),
        (
            "pulley = \"fixed\"\npulley_radius_m = 0.03\npulley_azimuth_deg = [0, 60, 180]",
            |p| matches!(p.world.cables[1].guide, Guide::Fixed { azimuth_rad, .. } if (azimuth_rad.to_degrees() - 60.0).abs() < 1e-9),
        ),
        ("pulley_radius_m = 0.03", |p| p.world.cables[0].guide == Guide::Eye),
        ("pulley_friction = 0.04", |p| p.world.cables[2].pulley_friction == 0.04),
        ("counts_per_m = [10865, 10973.65, 10865]", |p| (p.world.cables[1].count_scale - 1.01).abs() < 1e-12),
        ("slip = [0, 0, 0.01]", |p| p.idlers[2].slip == 0.01 && p.idlers[0].slip == 0.0),
        ("counts_stretched = [true, false, true]", |p| {
            p.world.cables[0].counts_stretched && !p.world.cables[1].counts_stretched
        }),
        ("node_mass_kg = 1.3", |p| p.node.mass_kg == 1.3),
        ("net_weight_n = 9.0", |p| p.node.net_weight_n == Some(9.0)),
        ("attachments_m = [[0.1, 0, 0], [0, 0, 0], [0, 0, 0]]", |p| p.world.cables[0].attachment_m[0] == 0.1),
        ("drag_n_s2_m2 = 0.03", |p| p.node.drag_n_s2_m2 == 0.03),
        ("stiffness_n = [5000, 6000, 6000]", |p| p.world.cables[0].line.is_some_and(|l| l.stiffness_n == 5000.0)),
        ("line_mass_kg_m = 0.001", |p| p.world.cables[0].mass_kg_m == 0.001),
        ("line_mass_kg_m = 0.001\nline_wet_mass_kg_m = 0.002\nwetness = 0.5", |p| {
            (p.world.cables[0].mass_kg_m - 0.0015).abs() < 1e-12
        }),
        ("line_wet_mass_kg_m = 0.002", |p| p.world.cables[0].mass_kg_m == 0.0),
        ("wetness = 1.0", |p| p.world.cables[0].mass_kg_m == 0.0),
        ("thermal_expansion_per_k = 1e-5", |p| p.world.cables[0].expansion_per_k == 1e-5),
        ("routed_length_m = 5.5", |p| p.routed_length_m == [5.5; 3]),
        ("drum_radius_m = 0.021", |p| p.world.cables[0].drum.is_some_and(|d| d.radius_m == 0.021)),
        ("backlash_m = 0.001", |p| p.world.cables[0].backlash_m == 0.001),
        ("stiction = 0.2", |p| p.world.cables[0].motor.is_some_and(|m| m.stiction == 0.2)),
        ("gear_friction = 0.7", |p| p.world.cables[0].motor.is_some_and(|m| m.gear_friction == 0.7)),
        ("coulomb_n = 4", |p| p.world.cables[0].motor.is_some_and(|m| m.coulomb_n == 4.0)),
        ("viscous_n_s_m = 21", |p| p.world.cables[0].motor.is_some_and(|m| m.viscous_n_s_m == 21.0)),
        ("force_constant_n_a = 41", |p| p.world.cables[0].motor.is_some_and(|m| m.force_constant_n_a == 41.0)),
        ("resistance_ohm = 1.3", |p| p.world.cables[0].motor.is_some_and(|m| m.resistance_ohm == 1.3)),
        ("warming_k = 15\nwarming_s = 60", |p| p.world.warming.at_k(30.0) == 7.5),
        ("pole_stiffness_n_m = 5000", |p| p.world.cables[0].pole_stiffness_n_m == 5000.0),
        ("wind_m_s = [3, 4]", |p| p.world.wind.mean_m_s == [3.0, 4.0, 0.0]),
        ("gust_m_s = 2\ngust_length_m = 50", |p| p.world.wind.gust_m_s == 2.0 && p.world.wind.gust_length_m == 50.0),
        ("pendulum_m = 0.3\npendulum_damping = 0.1", |p| {
            (p.world.pendulum.length_m, p.world.pendulum.damping) == (0.3, 0.1)
        }),
        ("ground_m = -0.1", |p| p.node.ground_m == Some(-0.1)),
        ("name = \"x\"", |p| p.world.wind.is_calm()),
    ];
    for (text, holds) in cases {
        assert!(holds(&plant(text)), "{text}");
    }
    let named: String = cases.iter().map(|(text, _)| *text).collect();
    for key in keys() {
        assert!(named.contains(&key), "`{key}` is not tested");
    }
}
