//! `nims new-law` and `nims new-estimator`: what they write flies unchanged, and nothing is overwritten.

use crate::command_line::root;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// A short flight of the planar robot.
const MISSION: &str = "name = \"near\"\n\n[[leg]]\npolyline = { points_m = [[4.3, 2.0], [4.0, 2.2]] }\n";

fn nims(folder: &Path, args: &[&str]) -> Output {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    Command::new(program).args(args).current_dir(folder).output().unwrap()
}

fn answer(folder: &Path, args: &[&str]) -> Value {
    let output = nims(folder, &[args, &["--json"]].concat());
    assert_eq!(output.status.code(), Some(0), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(folder: &Path, args: &[&str]) {
    let output = nims(folder, args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{args:?}: {said}");
}

/// Flies in lockstep from that folder.
fn fly(folder: &Path, options: &[&str]) -> Vec<Value> {
    std::fs::write(folder.join("near.toml"), MISSION).unwrap();
    let (system, mission) = (root().join("configs/systems/aq4.toml"), folder.join("near.toml"));
    let args = [&["sim", system.to_str().unwrap(), "--mission", mission.to_str().unwrap()][..], options].concat();
    let flights = answer(folder, &args)["flights"].as_array().unwrap().clone();
    assert!(flights.iter().all(|flight| flight["completed"] == true), "{flights:?}");
    flights
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The section with which a robot starts it, as a table.
fn process(written: &Value) -> toml::Table {
    let section: toml::Table = written["process"].as_str().unwrap().parse().unwrap();
    section["process"][0].as_table().unwrap().clone()
}

/// The template computes the built-in p-feedforward law with its default gain.
#[test]
fn a_new_law_and_a_new_estimator_in_python_fly_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let written = answer(folder, &["new-law", "gain-2"]);
    assert_eq!(written["written"], serde_json::json!(["gain-2.py", "nims_law.py"]));
    assert_eq!(written["next"][0], "nims sim SYSTEM.toml --program \"python3 gain-2.py\"");
    let section = process(&written);
    assert_eq!((section["name"].as_str(), section["role"].as_str()), (Some("gain-2"), Some("controller")));
    let command = section["command"].as_array().unwrap();
    let script = format!("python3 {}", folder.canonicalize().unwrap().join("gain-2.py").display());
    assert_eq!(command[2].as_str(), Some(script.as_str()), "a path that holds in any folder");
    let built_in = ["--law", "p-feedforward", "--set", "controller.length_gain_per_s=1.5"];
    let both = fly(folder, &[&built_in[..], &["--program", "python3 gain-2.py"]].concat());
    assert_eq!(both.len(), 2);
    assert_eq!((&both[0]["tracking"], &both[0]["energy_j"]), (&both[1]["tracking"], &both[1]["energy_j"]));

    let spaced = folder.join("my laws");
    std::fs::create_dir(&spaced).unwrap();
    assert!(answer(&spaced, &["new-law", "mine"])["process"].is_null(), "no section that would not start");
    let said = nims(&spaced, &["new-estimator", "other"]).stdout;
    assert!(String::from_utf8_lossy(&said).contains("without spaces"));

    // The module that is there may have been changed.
    let written = answer(folder, &["new-estimator", "mine", "--python"]);
    assert_eq!(written["written"], serde_json::json!(["mine.py", "nims_estimator.py"]));
    assert_eq!(process(&written)["role"].as_str(), Some("estimator"));
    fly(folder, &["--estimator-program", "python3 mine.py"]);
    std::fs::write(folder.join("mine.py"), "mine").unwrap();
    refused(folder, &["new-law", "mine"]);
    assert_eq!(read(&folder.join("mine.py")), "mine");
}

/// Other tests build and fly the templates themselves.
#[test]
fn a_new_crate_is_the_template_under_its_name_with_paths_that_hold_anywhere() {
    for (kind, source, plain, camel) in
        [("law", "src/law.rs", "my-law", "MyLaw"), ("estimator", "src/method.rs", "my-estimator", "MyEstimator")]
    {
        let folder = tempfile::tempdir().unwrap();
        let (folder, command) = (folder.path(), format!("new-{kind}"));
        let written = answer(folder, &[&command, "own-2", "--rust"]);
        assert_eq!(written["next"][0], "(cd own-2 && cargo build)");
        for file in ["src/main.rs", source, "README.md"] {
            let template = read(&root().join("scripts/templates").join(kind).join(file));
            assert_eq!(
                read(&folder.join("own-2").join(file)),
                template.replace(plain, "own-2").replace(camel, "Own2"),
                "{file}"
            );
        }
        let manifest: toml::Table = read(&folder.join("own-2/Cargo.toml")).parse().unwrap();
        assert_eq!(manifest["package"]["name"].as_str(), Some("own-2"));
        assert!(manifest.contains_key("workspace"), "the new crate is its own workspace");
        for (name, dependency) in manifest["dependencies"].as_table().unwrap() {
            let path = Path::new(dependency["path"].as_str().unwrap());
            assert!(path.is_absolute() && path.join("Cargo.toml").is_file(), "{name}: {}", path.display());
        }
        for args in [
            &["own-2", "--rust"][..],
            &["Own"],
            &["own-3", "--rust", "--python"],
            &["own-3", "--rust", "--nims", "/nowhere"],
            &["own-3", "--nims", "/nowhere"],
        ] {
            refused(folder, &[&[command.as_str()], args].concat());
        }
        assert!(!folder.join("own-3").exists() && !folder.join("own-3.py").exists());
    }
}
