//! `nims solve` compared with numpy, which shares no code with it; `nims plan` and `nims workspace` compared with known
//! results.
//!
//! `NIMS_SOLVE_ROUNDS=600 cargo test --workspace --test commands -- solve:: --nocapture` runs ten times as many cases.

use nims_tests::python;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn nims() -> PathBuf {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    assert!(program.is_file(), "{} is missing: run `cargo build --workspace --bins` first", program.display());
    program
}

fn run(args: &[&str]) -> Output {
    Command::new(nims()).args(args).current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("..")).output().unwrap()
}

fn answer(args: &[&str]) -> Value {
    let json: &[&str] = if args.contains(&"--json") { &[] } else { &["--json"] };
    let output = run(&[args, json].concat());
    assert_eq!(output.status.code(), Some(0), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn every_operation_agrees_with_numpy() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = python();
    let rounds = std::env::var("NIMS_SOLVE_ROUNDS").unwrap_or_else(|_| "60".to_owned());
    let output = Command::new(python).arg(root.join("python/check_solve.py")).arg(nims()).arg(rounds).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    println!("{text}");
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
}

const LAB3: [&str; 2] = ["--config", "configs/robots/lab3.toml"];
const LAB4: [&str; 2] = ["--config", "configs/robots/lab4.toml"];

fn plan(robot: [&str; 2], more: &[&str]) -> Value {
    answer(&[&["plan"], &robot[..], more].concat())
}

#[test]
fn a_planned_parabola_costs_less_than_the_straight_line() {
    let ends = ["--from", "2.5,2.0,2.2", "--to", "7.0,2.2,2.2"];
    let line = plan(LAB4, &ends);
    let best = plan(LAB4, &[&ends[..], &["--path", "parabola"]].concat());
    assert_eq!((&line["feasible"], &line["mu_per_m"]), (&Value::Bool(true), &0.0.into()));
    assert!(
        best["energy_j"].as_f64() < line["energy_j"].as_f64() && best["mu_per_m"].as_f64() > Some(0.0),
        "{best} {line}"
    );
    assert_eq!(best["line_energy_j"], line["energy_j"]);
    let power = best["energy_j"].as_f64().unwrap() / best["duration_s"].as_f64().unwrap();
    assert!((best["mean_power_w"].as_f64().unwrap() / power - 1.0).abs() < 1e-12);
    // At the same sag the result is the same; a price on time shortens the time.
    let mu = best["mu_per_m"].to_string();
    let again = plan(LAB4, &[&ends[..], &["--mu", &mu]].concat());
    let share = again["energy_j"].as_f64().unwrap() / best["energy_j"].as_f64().unwrap();
    assert!((share - 1.0).abs() < 1e-12, "{share}");
    let fast = plan(LAB4, &[&ends[..], &["--path", "parabola", "--time-weight", "5"]].concat());
    assert!(fast["duration_s"].as_f64() < best["duration_s"].as_f64());
    // With geared motors a path that swings sideways costs even less.
    let lateral = plan(LAB4, &[&ends[..], &["--path", "lateral"]].concat());
    assert!(lateral["energy_j"].as_f64() < best["energy_j"].as_f64(), "{lateral} {best}");
    assert!(lateral["side_m"][0].as_f64().unwrap().abs() > 0.1, "{lateral}");
}

#[test]
fn constant_speed_agrees_with_solve() {
    let ends = ["--from", "3.0,2.0,1.5", "--to", "6.0,3.0,1.2"];
    let found = plan(LAB3, &[&ends[..], &["--mu", "0.1", "--constant-speed", "--speed", "0.2"]].concat());
    let request = r#"{"op":"move_energy","anchors_m":[[0,0,3.05],[9.8,0,3.1],[4.7,8.6,2.98]],"from_m":[3,2,1.5],"to_m":[6,3,1.2],"mu_per_m":0.1,"node_mass_kg":1.2,"speed_m_s":0.2,"motor":{},"method":"unique","limits_n":[2,60],"intervals":64}"#;
    let expected = solve::answer(request);
    for key in ["energy_j", "duration_s"] {
        let (a, b) = (found[key].as_f64().unwrap(), expected["result"][key].as_f64().unwrap());
        assert!((a / b - 1.0).abs() < 1e-9, "{found} {expected}");
    }
}

#[test]
fn an_infeasible_path_is_an_answer_and_an_invalid_request_is_an_error() {
    for ends in [["--from", "3,3,1", "--to", "30,3,1"], ["--from", "3,3,1", "--to", "4,3,-1"]] {
        let found = plan(LAB3, &ends);
        assert_eq!(found["feasible"], Value::Bool(false), "{found}");
        assert!(found["why"].as_str().unwrap().len() > 20, "{found}");
    }
    for more in [
        &["--from", "3,3,1", "--to", "3,3,1"][..],
        &["--from", "3,3,1", "--to", "4,3,1", "--speed", "9"],
        &["--from", "3,3,1", "--to", "4,3,1", "--path", "parabola", "--time-weight", "-1"],
        &["--from", "3,3", "--to", "4,3,1"],
        &["--from", "3,3,1", "--to", "4,3,1", "--method", "least-sum"],
    ] {
        let output = run(&[&["plan"], &LAB3[..], more].concat());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{more:?} {words}");
        assert!(words.starts_with("nims: ") && words.trim_end().lines().count() == 1, "{words}");
    }
}

#[test]
fn a_fourth_cable_doubles_the_workspace_of_a_square() {
    let folder = tempfile::tempdir().unwrap();
    let robot = |name: &str, anchors: &str| {
        let path = folder.path().join(name);
        let text = format!(
            "name = \"square\"\n[robot]\nnode_mass_kg = 2.0\nanchors_m = [{anchors}]\ntension_limits_n = [1.0, 120.0]\nspeed_limit_m_s = 0.4\nacceleration_limit_m_s2 = 0.5\n"
        );
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let volume = |file: &str| {
        let found = answer(&["workspace", "--config", file, "--step", "0.4"]);
        assert!(found["best_margin_n"].as_f64() > Some(0.0), "{found}");
        found["feasible_volume_m3"].as_f64().unwrap()
    };
    let three = volume(&robot("three.toml", "[0.0, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 10.0, 6.0]"));
    let four = volume(&robot("four.toml", "[0.0, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 10.0, 6.0], [0.0, 10.0, 6.0]"));
    assert!((four / three - 2.0).abs() < 0.1, "{four} {three}");
}

#[test]
fn the_workspace_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let png = folder.path().join("workspace.png");
    let found = answer(&[&["workspace"], &LAB4[..], &["--step", "0.5", "--png", png.to_str().unwrap()]].concat());
    assert!(found["feasible_volume_m3"].as_f64() > Some(50.0), "{found}");
    let bytes = std::fs::read(png).unwrap();
    assert!(bytes.starts_with(b"\x89PNG\r\n\x1a\n") && bytes.len() > 5_000);
    let output = run(&["workspace", "--config", "configs/robots/lab4.toml", "--step", "1e-6"]);
    assert_eq!(output.status.code(), Some(2));
}
