//! `[motor_box]`, which this crate keeps without types.
#![allow(clippy::unwrap_used)]

use config::{ConfigError, Problem, SystemFile};
use serde::Deserialize;
use std::path::Path;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Example {
    supply_v: f64,
}

fn loaded(table: &str) -> SystemFile {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs");
    let text = std::fs::read_to_string(configs.join("systems/demo3.toml")).unwrap();
    let (before, _) = text.split_once("[motor_box]").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let robot = configs.join("robots/lab3.toml").canonicalize().unwrap();
    let before = before.replace("../robots/lab3.toml", &robot.to_string_lossy());
    let path = folder.path().join("system.toml");
    std::fs::write(&path, format!("{before}[motor_box]\n{table}")).unwrap();
    SystemFile::load(&path).unwrap()
}

#[test]
fn any_content_is_kept_and_read_with_the_type_of_another_crate() {
    let file = loaded("supply_v = 24.0\n");
    let table = file.motor_box.clone().unwrap();
    assert_eq!(table.section::<Example>().unwrap().supply_v, 24.0);
    let kept = file.resolved("robot.toml").unwrap();
    assert!(kept.contains("[motor_box]\nsupply_v = 24.0"), "{kept}");
    let folder = table.path(Path::new("x")).parent().unwrap().to_owned();
    let ground = loaded("ground = \"../g.toml\"\n").motor_box.unwrap().ground().unwrap();
    assert_eq!((ground.file_name(), folder.is_absolute()), (Some("g.toml".as_ref()), true));
}

#[test]
fn an_error_in_the_table_names_file_and_line() {
    let file = loaded("# a comment\nsuply_v = 24.0\n");
    let error = file.motor_box.clone().unwrap().section::<Example>().unwrap_err();
    let ConfigError::Text { path, line, problem, .. } = &error else { panic!("{error}") };
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems/demo3.toml");
    let text = std::fs::read_to_string(example).unwrap();
    let expected = text[..text.find("[motor_box]").unwrap()].lines().count() + 3;
    assert!(path.ends_with("system.toml") && *line == expected, "{error} {expected}");
    assert!(problem.contains("`suply_v`") && problem.contains("`supply_v`"), "{problem}");
    let named =
        loaded("supply_v = 99.0\n").motor_box.unwrap().error(&Problem::with_clause("motor_box.supply_v", "is 99"));
    assert!(named.to_string().ends_with("`motor_box.supply_v` is 99") && named.to_string().contains(", line "));
}

#[test]
fn a_copy_without_the_truth_says_only_that_the_drives_are_virtual() {
    let file = loaded("supply_v = 24.0\n[motor_box.truth]\nnode_mass_kg = 1.3\n").without_truth();
    let text = file.resolved("robot.toml").unwrap();
    assert!(text.contains("[motor_box]") && !text.contains("supply_v = 24") && !text.contains("truth"), "{text}");
    let read: SystemFile = toml::from_str(&text).unwrap();
    assert!(read.motor_box.is_some());
}
