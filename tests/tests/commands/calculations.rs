//! The operator's calculations: tensions, lengths, energies and work areas, in words and as JSON.

use crate::command_line::{ROBOT, SYSTEM, answer, changed, nims, refused, root};
use serde_json::{Value, json};

mod tools {
    //! Compares with numbers that are computed here from the definitions.

    use super::*;

    const ANCHORS: [[f64; 3]; 3] = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];
    const MASS_KG: f64 = 1.2;
    const GRAVITY: f64 = 9.80665;

    fn length(anchor: [f64; 3], at: [f64; 3]) -> f64 {
        (0..3).map(|k| (anchor[k] - at[k]).powi(2)).sum::<f64>().sqrt()
    }

    fn numbers(value: &Value) -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-9 * (1.0 + b.abs())
    }

    #[test]
    fn lengths_are_distances_and_lead_back() {
        for at in [[4.8, 3.0, 0.3], [2.0, 1.0, 1.5], [5.0, 6.5, 0.0], [-1.0, -0.5, 1.0]] {
            let text = at.map(|value| value.to_string()).join(",");
            let found = numbers(&answer(&["ik", "--config", ROBOT, "--at", &text])["lengths_m"]);
            for (anchor, found) in ANCHORS.iter().zip(&found) {
                assert!(close(*found, length(*anchor, at)));
            }
            let text = found.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
            let back = answer(&["fk", "--config", ROBOT, "--lengths", &text, "--json"]);
            assert!(numbers(&back["position_m"]).iter().zip(at).all(|(found, at)| (found - at).abs() < 1e-8), "{back}");
            assert!(back["residual_m"].as_f64().unwrap() < 1e-9);
        }
    }

    #[test]
    fn tensions_balance_weight_and_acceleration() {
        for (robot, anchors) in [(ROBOT, 3), ("configs/robots/lab4.toml", 4)] {
            for accel in [[0.0; 3], [0.3, -0.2, 0.1]] {
                let text = accel.map(|value| value.to_string()).join(",");
                let value = answer(&["tension", "--config", robot, "--at", "4.8,3.0,0.9", "--accel", &text]);
                assert_eq!(value["feasible"], json!(true));
                let tensions = numbers(&value["tensions_n"]);
                assert_eq!(tensions.len(), anchors);
                assert!(close(value["sum_n"].as_f64().unwrap(), tensions.iter().sum()));
                assert!(close(
                    value["norm_sq_n2"].as_f64().unwrap(),
                    tensions.iter().map(|tension| tension * tension).sum()
                ));
                let file: toml::Table = std::fs::read_to_string(root().join(robot)).unwrap().parse().unwrap();
                let mut force = [0.0; 3];
                for (anchor, tension) in file["robot"]["anchors_m"].as_array().unwrap().iter().zip(&tensions) {
                    let anchor: Vec<f64> =
                        anchor.as_array().unwrap().iter().map(|value| value.as_float().unwrap()).collect();
                    let toward: Vec<f64> = anchor.iter().zip([4.8, 3.0, 0.9]).map(|(a, b)| a - b).collect();
                    let distance = toward.iter().map(|value| value * value).sum::<f64>().sqrt();
                    for k in 0..3 {
                        force[k] += tension * toward[k] / distance;
                    }
                }
                let expected = [MASS_KG * accel[0], MASS_KG * accel[1], MASS_KG * (accel[2] + GRAVITY)];
                assert!(force.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{force:?} {expected:?}");
            }
        }
    }

    #[test]
    fn methods_differ_as_they_should() {
        let of = |method: &str| {
            answer(&["tension", "--config", "configs/robots/lab4.toml", "--at", "4.0,3.0,1.2", "--method", method])
        };
        let (norm, sum, safest) = (of("least-norm"), of("min-sum"), of("safest"));
        let get = |value: &Value, key: &str| value[key].as_f64().unwrap();
        assert!(get(&norm, "norm_sq_n2") <= get(&sum, "norm_sq_n2") + 1e-9);
        assert!(get(&norm, "norm_sq_n2") <= get(&safest, "norm_sq_n2") + 1e-9);
        assert!(get(&sum, "sum_n") <= get(&norm, "sum_n") + 1e-9);
        let margin = |value: &Value| {
            numbers(&value["tensions_n"])
                .iter()
                .map(|tension| (tension - 2.0).min(60.0 - tension))
                .fold(f64::INFINITY, f64::min)
        };
        assert!(margin(&safest) >= margin(&norm) - 1e-9 && margin(&safest) >= margin(&sum) - 1e-9);
    }

    #[test]
    fn a_position_without_equilibrium_is_answered_with_its_cause() {
        for at in ["4.8,3.0,3.0", "-5,-5,1", "4.8,3.0,5.0"] {
            let value = answer(&["tension", "--config", ROBOT, "--at", at]);
            assert_eq!(value["feasible"], json!(false), "{at}");
            assert!(!value["why"].as_str().unwrap().is_empty());
            assert!(value.get("tensions_n").is_none());
        }
    }
}

mod planar {
    //! A planar robot whose node floats: points have two coordinates, here in an area of 8 x 4 m.

    use super::*;

    const AQ: [&str; 2] = ["--config", "configs/robots/aq4.toml"];
    const ANCHORS: [[f64; 2]; 4] = [[0.0, 4.2], [8.0, 4.2], [8.0, 0.3], [0.0, 0.3]];

    fn aq(command: &str, more: &[&str]) -> Value {
        answer(&[&[command], &AQ[..], more].concat())
    }

    fn numbers(value: &Value) -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    }

    #[test]
    fn lengths_lead_to_the_point_and_back() {
        let lengths = numbers(&aq("ik", &["--at", "2.5,3.0"])["lengths_m"]);
        for (anchor, length) in ANCHORS.iter().zip(&lengths) {
            assert!((length - (anchor[0] - 2.5).hypot(anchor[1] - 3.0)).abs() < 1e-12);
        }
        let text = lengths.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let back = numbers(&aq("fk", &["--lengths", &text])["position_m"]);
        assert!(back.len() == 2 && (back[0] - 2.5).abs() < 1e-9 && (back[1] - 3.0).abs() < 1e-9, "{back:?}");
        // With a zero in the middle it is the same point; any other value is invalid.
        assert_eq!(aq("ik", &["--at", "2.5,0,3.0"])["lengths_m"], json!(lengths));
        refused(&[&["ik"], &AQ[..], &["--at", "2.5,0.1,3.0"]].concat(), 2, &["0.1"]);
        refused(&["ik", "--config", ROBOT, "--at", "2.5,3.0"], 2, &[]);
    }

    #[test]
    fn preload_holds_what_floats_and_an_acceleration_takes_more() {
        for (accel, method) in
            [("0,0", "least-norm"), ("0.3,-0.2", "least-norm"), ("0.3,-0.2", "safest"), ("0,0", "min-sum")]
        {
            let value = aq("tension", &["--at", "2.5,3.0", "--accel", accel, "--method", method]);
            let tensions = numbers(&value["tensions_n"]);
            let mut force = [0.0; 2];
            for (anchor, tension) in ANCHORS.iter().zip(&tensions) {
                let toward = [anchor[0] - 2.5, anchor[1] - 3.0];
                for k in 0..2 {
                    force[k] += tension * toward[k] / toward[0].hypot(toward[1]);
                }
                assert!((10.0 - 1e-6..=80.0 + 1e-6).contains(tension), "{value}");
            }
            let expected = if accel == "0,0" { [0.0, 0.0] } else { [6.0 * 0.3, -6.0 * 0.2] };
            assert!((0..2).all(|k| (force[k] - expected[k]).abs() < 1e-7), "{force:?}");
        }
        refused(&[&["tension"], &AQ[..], &["--at", "2.5,3.0", "--method", "unique"]].concat(), 2, &["least-norm"]);
    }

    #[test]
    fn a_move_costs_more_against_more_drag() {
        let ends = ["--from", "2.5,2.0", "--to", "5.5,2.5", "--speed", "0.2"];
        let water = aq("plan", &ends);
        let thick = changed("robots/aq4.toml", "drag_n_s2_m2 = 25.0", "drag_n_s2_m2 = 250.0");
        let thick = answer(&[&["plan", "--config", &thick.file("robots/aq4.toml")], &ends[..]].concat());
        assert!((water["length_m"].as_f64().unwrap() - 3.0f64.hypot(0.5)).abs() < 1e-9, "{water}");
        let energy = |value: &Value| value["energy_j"].as_f64().unwrap();
        assert!(energy(&thick) > 1.05 * energy(&water) && energy(&water) > 0.0, "{thick} {water}");
        let best = aq("plan", &[&ends[..], &["--path", "parabola"]].concat());
        assert!(energy(&best) <= energy(&water) + 1e-9, "{best}");
        let above = aq("plan", &["--from", "2.5,2.0", "--to", "5.5,4.0"]);
        assert_eq!(above["feasible"], json!(false));
        assert!(above["why"].as_str().unwrap().contains("keep-out"), "{above}");
    }

    #[test]
    fn its_workspace_is_an_area() {
        let folder = tempfile::tempdir().unwrap();
        let png = folder.path().join("plane.png");
        let found = aq("workspace", &["--step", "0.2", "--png", png.to_str().unwrap()]);
        // Below the surface and above the bed all of 8 x 3.6 m could be reached, but near the banks the cables do not
        // hold the node.
        let area = found["feasible_area_m2"].as_f64().unwrap();
        assert!(area > 15.0 && area < 8.0 * 3.6, "{found}");
        assert_eq!(found["safest_position_m"].as_array().unwrap().len(), 2);
        let pixels = std::fs::read(png).unwrap();
        assert!(pixels.starts_with(b"\x89PNG\r\n\x1a\n") && pixels.len() > 5_000);
    }

    #[test]
    fn its_files_are_checked_and_missions_of_the_other_kind_are_refused() {
        let good =
            answer(&["check", "configs/missions/cross-section.toml", "--for", "configs/systems/aq4.toml", "--json"]);
        assert_eq!(good["usable"], json!(true), "{good}");
        let own = answer(&["check", "configs/systems/aq4.toml", "--json"]);
        assert_eq!(own["usable"], json!(true), "{own}");
        // The uncertainty of the file is more than its preload; softer cables make less of the same errors.
        let softer = changed("robots/aq4.toml", "stiffness_n = 12000.0", "stiffness_n = 1000.0");
        let softer = answer(&["check", &softer.file("systems/aq4.toml"), "--json"]);
        for (checked, level) in [(&own, "warning"), (&softer, "note")] {
            let findings = checked["findings"].as_array().unwrap();
            let preload = findings.iter().find(|one| one["finding"].as_str().unwrap().contains("[uncertainty]"));
            assert_eq!(preload.unwrap()["level"], level, "{checked}");
        }
        for (mission, file) in [("spiral", "configs/systems/aq4.toml"), ("cross-section", SYSTEM)] {
            let value = answer(&["run", mission, "--dry-run", "--config", file, "--json"]);
            assert_eq!(value["feasible"], json!(false));
            assert!(value["why"].as_str().unwrap().starts_with("leg 1"), "{value}");
        }
        for (from, to, says) in [
            ("[8.0, 0.3]", "[8.0, 0.0, 0.3]", &["anchors_m", "point 3"][..]),
            ("drag_n_s2_m2 = 25.0", "drag_n_s2_m2 = -1.0", &["drag_n_s2_m2"]),
            ("[[0.0, 3.8], [8.0, 6.0]]", "[[0.0, 3.8], [8.0, 1.0, 6.0]]", &["keep_out"]),
        ] {
            let files = changed("robots/aq4.toml", from, to);
            refused(&["check", &files.file("robots/aq4.toml")], 2, says);
        }
        let files = changed("systems/aq4.toml", "start_m = [4.0, 2.0]", "start_m = [4.0, 1.0, 2.0]");
        refused(&["check", &files.file("systems/aq4.toml")], 2, &["start_m"]);
    }
}

#[test]
fn calculations_answer_readably_and_as_json_on_request() {
    let at = ["--at", "4.8,3.0,0.9"];
    let move_ends = ["--from", "4.0,3.0,0.9", "--to", "5.0,3.2,1.1"];
    for (args, word) in [
        ([&["ik", "--robot", ROBOT][..], &at].concat(), "length"),
        ([&["tension", "--system", SYSTEM][..], &at].concat(), "tension"),
        (vec!["fk", "--config", ROBOT, "--lengths", "5.5,6.0,6.1"], "node"),
        ([&["plan", "--config", ROBOT][..], &move_ends].concat(), "energy"),
        (vec!["workspace", "--config", ROBOT, "--step", "1"], "volume"),
    ] {
        let output = nims(&args);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && text.contains(word) && !text.contains(['{', '"']), "{args:?}: {text}");
        assert!(answer(&args).is_object());
    }
    // The lengths of the text are those of the JSON.
    let args = [&["ik", "--config", ROBOT][..], &at].concat();
    let text = String::from_utf8(nims(&args).stdout).unwrap();
    let shown: Vec<f64> = text.lines().map(|line| line.split_whitespace().nth(3).unwrap().parse().unwrap()).collect();
    let answered = answer(&args);
    let exact: Vec<f64> = answered["lengths_m"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
    assert_eq!(shown.len(), exact.len());
    assert!(shown.iter().zip(&exact).all(|(shown, exact)| (shown - exact).abs() < 1e-4), "{shown:?} {exact:?}");
}
