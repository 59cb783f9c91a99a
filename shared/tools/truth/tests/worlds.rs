//! Drawn worlds as files.
#![allow(clippy::unwrap_used)]

use config::SystemFile;
use motor_box::{BoxConfig, MotorBoxSection};
use nims_truth::{Args, run};
use std::path::{Path, PathBuf};

fn system(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems").join(name)
}

fn drawn(name: &str, seed: u64, spread: f64, out: &Path) -> String {
    let args = Args { system: system(name), seed, spread, warming: 0.0, wind: 0.0, out: Some(out.to_owned()) };
    run(&args).unwrap();
    std::fs::read_to_string(out).unwrap()
}

fn truth(path: &Path) -> motor_box::section::TruthSection {
    let file = SystemFile::load(path).unwrap();
    MotorBoxSection::from_file(&file, &file.robot_file().unwrap()).unwrap().unwrap().truth.unwrap()
}

#[test]
fn the_same_seed_writes_the_same_bytes_and_another_one_others() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["demo3.toml", "demo4.toml", "aq4.toml"] {
        let first = drawn(name, 7, 1.0, &folder.path().join("a.toml"));
        assert_eq!(first, drawn(name, 7, 1.0, &folder.path().join("b.toml")), "{name}");
        assert_ne!(first, drawn(name, 8, 1.0, &folder.path().join("c.toml")), "{name}");
        // The paths of the file apply from anywhere.
        let file = SystemFile::load(&folder.path().join("a.toml")).unwrap();
        let original = SystemFile::load(&system(name)).unwrap();
        for (one, other) in [(&file.runs, &original.runs), (&file.planner.missions, &original.planner.missions)] {
            assert_eq!(std::path::absolute(one).unwrap().file_name(), other.file_name(), "{name}");
        }
        assert!(file.planner.missions.is_dir() && file.robot.is_file(), "{name}");
    }
}

#[test]
fn no_spread_is_the_model_and_more_of_it_is_farther_away() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.toml");
    drawn("demo3.toml", 7, 0.0, &out);
    let (file, original) = (SystemFile::load(&out).unwrap(), SystemFile::load(&system("demo3.toml")).unwrap());
    let plant =
        |file: &SystemFile| BoxConfig::from_files(file, &file.robot_file().unwrap(), Path::new("/")).unwrap().plant;
    let (drawn_plant, model) = (plant(&file), plant(&original));
    assert_eq!(
        (&drawn_plant.anchors_m, drawn_plant.node, &drawn_plant.idlers),
        (&model.anchors_m, model.node, &model.idlers)
    );
    for cable in &drawn_plant.world.cables {
        assert_eq!((cable.motor, cable.line, cable.drum), (Some(model.motor), Some(model.line), Some(model.drum)));
        assert_eq!((cable.count_scale, cable.mass_kg_m, cable.backlash_m), (1.0, 0.0, 0.0));
        assert!(!cable.counts_stretched && cable.pole_stiffness_n_m.is_infinite());
    }
    let anchors = original.robot_file().unwrap().robot.anchors_m;
    let farthest = |spread: f64| {
        drawn("demo3.toml", 7, spread, &out);
        let moved = truth(&out).anchors_m.unwrap();
        moved.iter().flatten().zip(anchors.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let (one, two) = (farthest(1.0), farthest(2.0));
    assert!(one > 0.001 && one < 0.0151 && (two - 2.0 * one).abs() < 3e-6, "{one} {two}");
}

#[test]
fn comments_stay_and_a_world_is_replaced_by_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let (out, again) = (folder.path().join("a.toml"), folder.path().join("b.toml"));
    let lines = |text: &str| text.lines().map(str::to_owned).collect::<std::collections::HashSet<_>>();
    let original = std::fs::read_to_string(system("demo3.toml")).unwrap();
    let second = drawn("demo3.toml", 2, 1.0, &out);
    // `robot` is a path, which has changed.
    let lost: Vec<_> = lines(&original).difference(&lines(&second)).cloned().collect();
    assert!(lost.len() == 1 && lost[0].starts_with("robot"), "{lost:?}");
    drawn("demo3.toml", 1, 1.0, &out);
    run(&Args { system: out, seed: 2, spread: 1.0, warming: 0.0, wind: 0.0, out: Some(again.clone()) }).unwrap();
    assert_eq!(second, std::fs::read_to_string(&again).unwrap());
}

#[test]
fn real_drives_have_no_drawn_world() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.toml");
    let text = drawn("demo3.toml", 1, 1.0, &out);
    std::fs::write(&out, text.split_once("[motor_box]").unwrap().0).unwrap();
    let failure = run(&Args { system: out, seed: 2, spread: 1.0, warming: 0.0, wind: 0.0, out: None }).unwrap_err();
    assert!(failure.exit_code() == 2 && failure.to_string().contains("has no [motor_box]"), "{failure}");
}

/// A hundred worlds of each example can be flown: the node hangs in them.
#[test]
fn the_node_hangs_in_every_plausible_world() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.toml");
    for seed in 0..100 {
        for name in ["demo3.toml", "demo4.toml"] {
            drawn(name, seed, 1.0, &out);
        }
    }
}

#[test]
fn a_world_in_which_the_node_cannot_hang_leaves_the_file_that_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("lab.toml");
    // Nearer and nearer to the border of where the model can hang.
    let moved = folder.path().join("moved.toml");
    let failure = (0..100).find_map(|step| {
        std::fs::write(&out, "the work of a day").unwrap();
        let text = drawn("demo3.toml", 3, 5.0, &moved).split_once("\n[motor_box.truth]").unwrap().0.to_owned();
        let start = format!("start_m = [{:.1}, ", 4.8 + 0.1 * f64::from(step));
        std::fs::write(&moved, text.replace("start_m = [4.8, ", &start)).unwrap();
        let (system, out) = (moved.clone(), Some(out.clone()));
        let failure = run(&Args { system, seed: 3, spread: 5.0, warming: 0.0, wind: 0.0, out }).err()?;
        Some(failure.to_string()).filter(|why| why.contains("in this world"))
    });
    assert!(failure.is_some());
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "the work of a day");
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 2, "nothing else is left");
}
