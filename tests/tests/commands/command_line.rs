//! The operator's commands: bad input is rejected with one clear sentence and moves nothing.

use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

pub fn nims(args: &[&str]) -> Output {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    assert!(program.is_file(), "{} is missing: run `cargo build --workspace --bins` first", program.display());
    Command::new(program).args(args).current_dir(root()).output().unwrap()
}

/// The answer of a command that must succeed.
pub fn answer(args: &[&str]) -> Value {
    let json: &[&str] = if args.contains(&"--json") { &[] } else { &["--json"] };
    let output = nims(&[args, json].concat());
    assert_eq!(output.status.code(), Some(0), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{args:?}: {error}"))
}

/// Asserts one sentence on stderr that contains all of `words`, nothing on stdout, and the exit code.
pub fn refused(args: &[&str], code: i32, words: &[&str]) {
    let output = nims(args);
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{args:?}: {err}");
    assert_eq!(err.trim_end().lines().count(), 1, "{args:?}: the error has more than one text line: {err}");
    assert!(err.starts_with("nims: "), "{args:?}: {err}");
    assert!(err.len() < 500, "{args:?}: the error is too long: {err}");
    assert!(out.is_empty(), "{args:?} printed an answer: {out}");
    for word in words {
        assert!(err.contains(word), "{args:?}: no {word:?} in: {err}");
    }
}

pub const ROBOT: &str = "configs/robots/lab3.toml";
pub const SYSTEM: &str = "configs/systems/demo3.toml";

/// A folder with the project's configuration, in which one line of one file is changed.
pub struct Changed {
    pub folder: tempfile::TempDir,
}

impl Changed {
    pub fn file(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }
}

pub fn changed(file: &str, from: &str, to: &str) -> Changed {
    let folder = tempfile::tempdir().unwrap();
    for place in ["robots", "systems", "missions"] {
        std::fs::create_dir(folder.path().join(place)).unwrap();
        for entry in std::fs::read_dir(root().join("configs").join(place)).unwrap() {
            let entry = entry.unwrap();
            std::fs::copy(entry.path(), folder.path().join(place).join(entry.file_name())).unwrap();
        }
    }
    let path = folder.path().join(file);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{file} has no {from:?}");
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    Changed { folder }
}

/// What is changed in `lab3.toml`, into what, and what the refusal names.
pub const BAD_ROBOTS: &[(&str, &str, &[&str])] = &[
    ("node_mass_kg = 1.2", "node_mass_kg = 1.2.3", &["lab3.toml", "line 7"]),
    ("node_mass_kg = 1.2", "node_mass_kg = nan", &["node_mass_kg", "NaN", "kg"]),
    ("node_mass_kg = 1.2", "node_mass_kg = -1.2", &["node_mass_kg", "-1.2"]),
    ("node_mass_kg = 1.2", "node_mass_kg = 12000.0", &["node_mass_kg", "1000 kg"]),
    ("node_mass_kg = 1.2", "node_mass_kg = \"1.2\"", &["node_mass_kg", "line 7"]),
    ("node_mass_kg = 1.2", "node_mas_kg = 1.2", &["node_mas_kg", "node_mass_kg"]),
    ("node_mass_kg = 1.2", "", &["node_mass_kg", "missing"]),
    ("[9.8, 0.0, 3.10]", "[9800.0, 0.0, 3100.0]", &["anchors_m", "millimetres"]),
    ("[9.8, 0.0, 3.10]", "[inf, 0.0, 3.10]", &["anchors_m"]),
    ("[9.8, 0.0, 3.10]", "[0.0, 0.0, 3.05]", &["anchors_m", "1", "2"]),
    ("[9.8, 0.0, 3.10]", "[9.8, 0.0, -3.10]", &["anchors_m", "2", "ground_m"]),
    ("tension_limits_n = [2.0, 60.0]", "tension_limits_n = [60.0, 2.0]", &["tension_limits_n", "60"]),
    ("speed_limit_m_s = 0.4 ", "speed_limit_m_s = 400.0 ", &["speed_limit_m_s", "10 m/s"]),
    ("acceleration_limit_m_s2 = 0.5", "acceleration_limit_m_s2 = 0.0", &["acceleration_limit_m_s2"]),
    ("routed_length_m = [6.0, 6.0, 6.0]", "routed_length_m = [6.0, 6.0]", &["routed_length_m", "2", "3"]),
    ("stiffness_n = 6000.0", "stiffness_n = 6.0", &["stiffness_n", "EA"]),
    ("[motor]", "[moter]", &["moter", "motor"]),
];

#[test]
fn bad_robot_files_are_named_by_file_key_and_cure() {
    for (from, to, words) in BAD_ROBOTS {
        let changed = changed("robots/lab3.toml", from, to);
        for command in [&["check"][..], &["ik", "--at", "4,3,1", "--config"]] {
            let path = changed.file("robots/lab3.toml");
            let args: Vec<&str> = command.iter().copied().chain([path.as_str()]).collect();
            refused(&args, 2, words);
        }
    }
}

/// The same for `demo3.toml`.
pub const BAD_SYSTEMS: &[(&str, &str, &[&str])] = &[
    ("rate_hz = 100.0", "rate_hz = 1000.0", &["rate_hz", "10", "500"]),
    ("rate_hz = 100.0", "rate_hz = 100.0\nrate = 3", &["rate", "rate_hz"]),
    ("name = \"demo3\"", "name = \"The demo\"", &["name", "a-z"]),
    ("robot = \"../robots/lab3.toml\"", "robot = \"../robots/lab9.toml\"", &["lab9.toml"]),
    ("baud = 230400", "baud = 230000", &["baud", "230400"]),
    ("path = \"{domain}/drive0\"", "path = \"/dev/no-such-port\"", &["/dev/no-such-port", "plug"]),
    ("address = 129", "address = 128", &["128", "once"]),
    ("address = 129", "address = 0x10", &["16", "128", "135"]),
    ("cables = [3]", "cables = [2]", &["cable 2"]),
    ("cables = [3]", "cables = [4]", &["cable 4", "3"]),
    ("counts_per_m = [10865.0, 10865.0, 10865.0]", "counts_per_m = [10865.0, 10865.0]", &["counts_per_m", "3"]),
    ("counts_per_m = [10865.0, 10865.0, 10865.0]", "counts_per_m = [10865.0, 0.0, 10865.0]", &["counts_per_m"]),
    ("# watchdog_s = 0.3 ", "watchdog_s = 0.25 ", &["watchdog_s", "0.1"]),
    ("start_m = [4.8, 3.0, 0.3]", "start_m = [4.8, 3.0, -0.3]", &["start_m", "ground_m"]),
    ("start_m = [4.8, 3.0, 0.3]", "start_m = [4.8, nan, 0.3]", &["start_m", "NaN"]),
    ("[motor_box]", "[bus]\nprocesses = 63\n[motor_box]", &["bus.processes", "63", "64", "4096"]),
];

#[test]
fn bad_system_files_start_nothing() {
    for (from, to, words) in BAD_SYSTEMS {
        let changed = changed("systems/demo3.toml", from, to);
        let run = changed.file("run");
        refused(&["up", &changed.file("systems/demo3.toml"), "--for", "1", "--run", &run], 2, words);
        assert!(!Path::new(&run).exists(), "{to:?} made a run folder");
    }
    let changed = changed("systems/demo3.toml", "[motor_box]", "[recorder]\n[controller]\nlaw = \"pid\"\n[motor_box]");
    refused(&["up", &changed.file("systems/demo3.toml")], 2, &["controller.law", "pid", "lq-endpoint"]);
}

/// The same for `spiral.toml`.
pub const BAD_MISSIONS: &[(&str, &str, &[&str])] = &[
    ("rise_m = 1.125", "rise_m = 3.5", &["leg", "cable"]),
    ("rise_m = 1.125", "rise_m = -1.125", &["leg", "ground"]),
    ("rise_m = 1.125", "rise_mm = 1125", &["rise_mm", "rise_m"]),
    ("radius_m = 0.60", "radius_m = nan", &["radius_m", "NaN"]),
    ("speed_m_s = 0.2", "speed_m_s = 20.0", &["20", "speed_limit_m_s"]),
];

#[test]
fn bad_missions_are_refused_before_anything_starts() {
    for (from, to, words) in BAD_MISSIONS {
        let changed = changed("missions/spiral.toml", from, to);
        let (mission, run) = (changed.file("missions/spiral.toml"), changed.file("run"));
        refused(&["demo", &changed.file("systems/demo3.toml"), "--mission", &mission, "--run", &run], 2, words);
        assert!(!Path::new(&run).exists(), "{to:?} made a run folder");
    }
    // The limit of the cables, below what the mission requires.
    let changed = changed("robots/lab3.toml", "# cable_speed_limit_m_s = 0.8 ", "cable_speed_limit_m_s = 0.1 ");
    let (mission, run) = (changed.file("missions/spiral.toml"), changed.file("run"));
    let words = ["leg", "cable", "cable_speed_limit_m_s", "0.100 m/s"];
    refused(&["demo", &changed.file("systems/demo3.toml"), "--mission", &mission, "--run", &run], 2, &words);
    assert!(!Path::new(&run).exists());
    refused(&["demo", SYSTEM, "--mission", "no-such-mission"], 2, &["no-such-mission"]);
    let folder = tempfile::tempdir().unwrap();
    let far = folder.path().join("far.toml");
    std::fs::write(&far, "name = \"far\"\n[[leg]]\nline = { to_m = [40.0, 30.0, 0.3] }\n").unwrap();
    refused(&["demo", SYSTEM, "--mission", far.to_str().unwrap()], 2, &["leg 1", "cable"]);
}

/// Arguments, and what the refusal names.
pub const BAD_ARGUMENTS: &[(&[&str], &[&str])] = &[
    (&[], &["--help"]),
    (&["fly"], &["fly"]),
    (&["up"], &["CONFIG"]),
    (&["up", "no-such-system.toml"], &["no-such-system.toml"]),
    (&["up", SYSTEM, "--for", "soon"], &["soon"]),
    (&["up", SYSTEM, "--for", "-1"], &["--for"]),
    (&["up", SYSTEM, "--domain", "My Robot"], &["My Robot"]),
    (&["up", ROBOT], &["lab3.toml"]),
    (&["ik", "--config", ROBOT, "--at", "1,2"], &[]),
    (&["ik", "--config", ROBOT, "--at", "1,2,nan"], &["nan", "finite"]),
    (&["ik", "--config", ROBOT, "--at", "1m,2m,3m"], &["1m"]),
    (&["ik", "--config", "configs", "--at", "1,2,3"], &["configs", "folder"]),
    (&["fk", "--config", ROBOT, "--lengths", "5,5"], &["2", "3"]),
    (&["fk", "--config", ROBOT, "--lengths", "1,1,1"], &[]),
    (&["fk", "--config", ROBOT, "--lengths", "5,-5,5"], &["cable 2"]),
    (&["tension", "--config", ROBOT, "--at", "4.8,3,1", "--accel", "0,0"], &[]),
    (&["tension", "--config", ROBOT, "--at", "4.8,3,1", "--method", "best"], &["best", "least-norm"]),
    (&["goto", "1"], &["1"]),
    (&["goto", "1,2,inf"], &["inf", "finite"]),
    (&["jog", "0", "0.1"], &["0"]),
    (&["jog", "1", "NaN"], &["NaN", "finite"]),
    (&["speed", "fast"], &["fast"]),
    (&["zero"], &["--at"]),
    (&["zero", "--at", "1,2,3", "--lengths", "1,2,3"], &["--lengths"]),
    (&["check", "README.md"], &["README.md"]),
    (&["check", "Cargo.toml"], &["Cargo.toml", "[robot]"]),
    (&["info", "no-such-run"], &["no-such-run"]),
    (&["recover", "no-such-run"], &["no-such-run"]),
    (&["run", "demo", "--dry-run", "--config", "no-such-system.toml"], &["no-such-system.toml"]),
    (&["bench", "drives"], &["drives", "tick", "bus", "chain", "disk"]),
    (&["bench", "--rate", "1000"], &["--rate", "1000", "10", "500"]),
    (&["bench", "--rate", "-100"], &["--rate", "-100", "10", "500"]),
    (&["bench", "--rate", "fast"], &["fast"]),
    (&["bench", "--seconds", "0"], &["--seconds", "0"]),
    (&["bench", "--seconds", "inf"], &["inf", "finite"]),
    (&["bench", "--seconds", "1e9"], &["hour"]),
    (&["bench", "--system", "no-such-system.toml"], &["no-such-system.toml"]),
    (&["bench", "--system", ROBOT], &["lab3.toml"]),
    (&["bench", "disk", "--runs", "no-such-folder"], &["no-such-folder", "--runs"]),
    (&["bench", "disk", "--runs", "README.md"], &["README.md", "--runs"]),
    (&["bench", "bench-peer", "nobody"], &["nims bench"]),
];

#[test]
fn bad_arguments_are_answered_by_one_sentence() {
    for (args, words) in BAD_ARGUMENTS {
        refused(args, 2, words);
    }
}

#[test]
fn every_installed_program_states_its_version() {
    let list = std::fs::read_to_string(root().join("configs/host/files")).unwrap();
    let names: Vec<_> = list.split_whitespace().filter_map(|word| word.strip_prefix("@bin@/")).collect();
    for (companion, _) in nims::programs::COMPANIONS {
        assert!(companion == "page" || names.contains(&format!("nims-{companion}").as_str()), "{companion}");
    }
    for name in names {
        let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join(name);
        let output = Command::new(program).arg("--version").output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        let own = said.starts_with(name) || ["supervisor", "nims-"].iter().any(|other| name.starts_with(other));
        // `scripts/package` compares version and commit.
        let is_stated = said.trim_end().ends_with(&format!(" {}", runtime::build::description()));
        assert!(output.status.success() && own && is_stated, "{name}: {said}");
    }
}

#[test]
fn sensor_and_scene_files_are_checked_too() {
    let finding = |file: &str| answer(&["check", file, "--json"])["findings"][0]["finding"].to_string();
    assert!(finding("configs/sensors/tfmini.toml").contains("distance"));
    assert!(finding("configs/ground/fig10.toml").contains("prisms"));
    let folder = tempfile::tempdir().unwrap();
    let spoilt = |from: &str, what: &str, with: &str| {
        let text = std::fs::read_to_string(root().join(from)).unwrap();
        assert!(text.contains(what), "{from} has no {what}");
        let path = folder.path().join(Path::new(from).file_name().unwrap());
        std::fs::write(&path, text.replacen(what, with, 1)).unwrap();
        path.display().to_string()
    };
    let sensor = spoilt("configs/sensors/tfmini.toml", "[tfmini]", "[tfmeani]");
    refused(&["check", &sensor], 2, &["tfmini.toml", "tfmeani"]);
    let ground = spoilt("configs/ground/fig10.toml", "height_m = ", "height_m = -");
    refused(&["check", &ground], 2, &["fig10.toml", "height_m", "-"]);
}

#[test]
fn commands_need_a_robot_that_runs() {
    for args in [
        &["status"][..],
        &["arm"],
        &["stop"],
        &["estop"],
        &["goto", "4.8,3,0.5"],
        &["run", "demo"],
        &["channel", "list"],
    ] {
        let args: Vec<&str> = args.iter().copied().chain(["--domain", "nobody-here"]).collect();
        refused(&args, 1, &["nobody-here", "nims up"]);
    }
}

#[test]
fn a_file_that_is_no_run_is_not_taken_for_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    std::fs::write(&path, "not a run").unwrap();
    for command in ["recover", "info"] {
        refused(&[command, path.to_str().unwrap()], 2, &["run.mcap"]);
    }
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "not a run");
}

/// Every speed in millimetres per second that a text states.
fn speeds_mm_s(text: &str) -> Vec<f64> {
    let ends = text.match_indices(" mm/s").map(|(end, _)| &text[..end]);
    ends.filter_map(|before| before.rsplit(' ').next()?.parse().ok()).collect()
}

#[test]
fn check_reports_the_watchdog_distance_and_the_sinking_speed() {
    let value = answer(&["check", SYSTEM, "--json"]);
    assert_eq!(value["usable"], json!(true));
    let all = value["findings"].to_string();
    // The figures in the findings: 0.3 s at the robot's 0.4 m/s, and gears that hold.
    assert!(all.contains("120 mm"), "{all}");
    assert!(speeds_mm_s(&all).contains(&0.0), "{all}");

    // Without friction the load drives the motor against its braking torque: v = T R / Kf^2.
    let ideal = changed("robots/lab3.toml", "gear_friction = 0.85 ", "gear_friction = 0.0 ");
    let text = std::fs::read_to_string(ideal.file("robots/lab3.toml")).unwrap();
    std::fs::write(
        ideal.file("robots/lab3.toml"),
        text.replace("coulomb_n = 3.0 ", "coulomb_n = 0.0 ").replace("viscous_n_s_m = 20.0", "viscous_n_s_m = 0.0"),
    )
    .unwrap();
    let all = answer(&["check", &ideal.file("robots/lab3.toml"), "--json"])["findings"].to_string();
    let expected = 1000.0 * 10.5 * 1.2 / (40.0 * 40.0);
    let speeds = speeds_mm_s(&all);
    // The first is that of an unwinding cable; the node sinks faster.
    assert!((speeds[0] - expected).abs() < 0.2, "{expected}: {all}");
}

#[test]
fn check_tells_whether_a_mission_can_be_flown() {
    let good = answer(&["check", "configs/missions/spiral.toml", "--for", SYSTEM, "--json"]);
    assert_eq!(good["usable"], json!(true));
    let high = changed("missions/spiral.toml", "rise_m = 1.125", "rise_m = 2.6");
    let output = nims(&["check", &high.file("missions/spiral.toml"), "--for", SYSTEM, "--json"]);
    assert_eq!(output.status.code(), Some(2));
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(value["usable"], json!(false));
    assert!(value["findings"][0]["finding"].as_str().unwrap().contains("cable"), "{value}");
}

#[test]
fn a_dry_run_needs_no_robot() {
    let value = answer(&["run", "spiral", "--dry-run", "--config", SYSTEM, "--json"]);
    assert_eq!(value["feasible"], json!(true));
    // Archimedean spiral to 0.6 m in 4 turns, rising 1.125 m: the flat length is about half the outermost circumference
    // per turn.
    let length = value["length_m"].as_f64().unwrap();
    assert!((7.4..8.0).contains(&length), "{length}");
    let value = answer(&["run", "spiral", "--dry-run", "--config", SYSTEM, "--from", "9.7,0.1,0.3", "--json"]);
    assert_eq!(value["feasible"], json!(false));
    assert!(value["why"].as_str().unwrap().contains("cable"), "{value}");
}

#[test]
fn a_file_of_another_kind_is_named() {
    let mission = "configs/missions/demo.toml";
    for (args, words) in [
        (&["run", "demo", "--dry-run", "--config", ROBOT][..], &[ROBOT][..]),
        (&["doctor", ROBOT], &[ROBOT, "configs/systems"]),
        (&["run", SYSTEM, "--dry-run", "--config", SYSTEM], &[SYSTEM, "configs/missions"]),
        (&["calibrate", SYSTEM], &[SYSTEM, "configs/measurements"]),
        (&["setup", ROBOT], &[ROBOT, "configs/measurements"]),
        (&["loads", SYSTEM], &[SYSTEM, "configs/measurements"]),
        (&["check", "configs/measurements/lab3.toml"], &["configs/measurements/lab3.toml", "nims calibrate"]),
        (&["ik", "--config", mission, "--at", "1,2,3"], &[mission]),
    ] {
        refused(args, 2, words);
    }
    // A system file that names a system file as its robot.
    let wrong = changed("systems/demo3.toml", "\"../robots/lab3.toml\"", "\"demo3.toml\"");
    refused(&["check", &wrong.file("systems/demo3.toml")], 2, &["demo3.toml"]);
}

#[test]
fn a_check_without_complaints_is_fine() {
    let output = nims(&["check", "configs/missions/spiral.toml", "--for", SYSTEM]);
    let text = String::from_utf8_lossy(&output.stdout);
    let fine = text.trim_end().lines().last().unwrap().starts_with("fine: ");
    assert!(fine && !text.lines().any(|line| line.starts_with("warning: ")), "{text}");
    let output = nims(&["check", SYSTEM]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let warnings = text.lines().filter(|line| line.starts_with("warning: ")).count();
    assert!(warnings > 0 && text.trim_end().lines().last().unwrap().starts_with("usable: "), "{text}");
    assert!(text.trim_end().lines().last().unwrap().contains(&format!(" {warnings} ")), "{text}");
}
