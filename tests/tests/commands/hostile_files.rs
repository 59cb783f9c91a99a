//! Invalid files and numbers: every command rejects them at once, in one sentence.

use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Time after which a command counts as hung or as reading without end. The commands here answer within milliseconds;
/// the margin allows for a machine that stands still.
const GIVE_UP: Duration = Duration::from_secs(60);
/// Bytes of the sparse table.
const LARGE: u64 = 3 << 30;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

/// The output of a program of the robot that ends by itself.
fn output(program: &str, args: &[&str]) -> Output {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join(program);
    let mut child = Command::new(program)
        .args(args)
        .current_dir(root())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if began.elapsed() > GIVE_UP {
            child.kill().unwrap();
            panic!("{args:?} does not end");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().unwrap()
}

/// Asserts exit code 2 and one short sentence that contains all of `words`.
fn refused(args: &[&str], words: &[&str]) {
    refused_by("nims", args, words);
}

/// The same for another program.
fn refused_by(program: &str, args: &[&str], words: &[&str]) {
    let output = output(program, args);
    let err = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{args:?}: {err}");
    assert!(output.stdout.is_empty(), "{args:?} printed an answer");
    let said = err.trim_end();
    assert!(said.lines().count() <= 3 && said.len() < 600, "{args:?}: the error is too long: {err}");
    for word in words {
        assert!(err.contains(word), "{args:?}: no {word:?} in: {err}");
    }
}

/// A folder with a pipe, a device, a folder without a socket and a table of gigabytes.
fn hostile() -> (tempfile::TempDir, Vec<(String, &'static str)>) {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let made = Command::new("mkfifo").arg(path("pipe.toml")).status().unwrap();
    assert!(made.success());
    symlink("/dev/zero", path("zero.toml")).unwrap();
    fs::create_dir(path("folder.toml")).unwrap();
    File::create(path("large.toml")).unwrap().set_len(LARGE).unwrap();
    let named = |name: &str| path(name).to_str().unwrap().to_owned();
    let files = vec![
        (named("pipe.toml"), "pipe"),
        (named("zero.toml"), "device"),
        (named("folder.toml"), "folder"),
        (named("large.toml"), "3072 MB"),
    ];
    (folder, files)
}

#[test]
fn every_command_that_reads_a_file_rejects_anything_but_a_small_file() {
    let (_folder, files) = hostile();
    for (file, says) in &files {
        let words = &[*says];
        refused(&["check", file], words);
        refused(&["check", "configs/missions/spiral.toml", "--for", file], words);
        refused(&["ik", "--config", file, "--at", "1,2,1"], words);
        refused(&["plan", "--config", file, "--from", "1,2,1", "--to", "2,2,1"], words);
        refused(&["calibrate", file], words);
        refused(&["setup", file], words);
        refused(&["up", file], words);
        refused(&["doctor", file], words);
    }
    // a mission name with a path must be a file
    refused(&["run", "--dry-run", "--config", "configs/systems/demo3.toml", &files[3].0], &["3072 MB"]);
}

#[test]
fn a_sensor_rejects_anything_but_a_small_file() {
    let (_folder, files) = hostile();
    let domain = bus::Domain::for_test();
    for (file, says) in &files {
        refused_by("sensor", &["--domain", domain.name(), file], &[says]);
    }
}

#[test]
fn files_named_in_a_robot_file_are_checked_in_the_same_way() {
    let (folder, files) = hostile();
    let robot = fs::read_to_string(root().join("configs/robots/lab3.toml")).unwrap();
    let begin = robot.find("anchors_m = [").unwrap();
    let end = begin + robot[begin..].find("\n]").unwrap() + 2;
    for (file, says) in &files {
        let path = folder.path().join("robot.toml");
        let name = path.to_str().unwrap();
        fs::write(&path, robot.replace(&robot[begin..end], &format!("calibration = \"{file}\""))).unwrap();
        refused(&["check", name], &[says]);
        fs::write(&path, robot.replace("[motor] ", &format!("[motor]\ntable = \"{file}\" #"))).unwrap();
        refused(&["check", name], &[says]);
    }
}

#[test]
fn what_is_no_run_is_bad_input() {
    let (folder, files) = hostile();
    for command in ["info", "recover", "export", "report", "map", "replay"] {
        refused(&[command, "configs/systems/demo3.toml"], &["demo3.toml"]);
        refused(&[command, &files[0].0], &["pipe.toml"]);
        refused(&[command, "no/such/run"], &["no/such/run"]);
    }
    // nor is a folder with a pipe that is named like a run file
    fs::rename(&files[0].0, folder.path().join("run.mcap")).unwrap();
    refused(&["info", folder.path().to_str().unwrap()], &["run.mcap"]);
}

/// A run without its folder is unpacked, and a table of flights alone has no folder.
#[test]
fn a_missing_folder_for_temporary_files_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run.mcap");
    fs::copy(root().join("tests/golden/run.mcap"), &run).unwrap();
    let (nims, run) =
        (std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims"), run.to_str().unwrap());
    for args in [["replay", run], ["report", run], ["sim", "configs/systems/aq4.toml"]] {
        let asked = Command::new(&nims).args(args).current_dir(root()).env("TMPDIR", "/nonexistent").output().unwrap();
        let said = String::from_utf8_lossy(&asked.stderr);
        assert_eq!(asked.status.code(), Some(1), "{args:?}: {said}");
        assert_eq!(said.trim_end().lines().count(), 1, "{args:?}: {said}");
        assert!(["temporary", "/nonexistent ", "TMPDIR"].iter().all(|word| said.contains(word)), "{args:?}: {said}");
    }
}

#[test]
fn anchors_in_a_row_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let robot = fs::read_to_string(root().join("configs/robots/lab3.toml")).unwrap();
    let row = robot.replace("[4.7, 8.6, 2.98]", "[4.9, 0.0, 3.075]");
    assert_ne!(row, robot);
    let path = folder.path().join("row.toml");
    fs::write(&path, row).unwrap();
    let name = path.to_str().unwrap();
    for command in [
        &["check"][..],
        &["ik", "--at", "4,3,1", "--config"],
        &["fk", "--lengths", "3,6,4", "--config"],
        &["tension", "--at", "4,3,1", "--config"],
        &["workspace", "--config"],
    ] {
        let args: Vec<&str> = command.iter().copied().chain([name]).collect();
        refused(&args, &["row.toml", "line 12", "anchors_m"]);
    }
}

#[test]
fn numbers_beyond_any_robot_are_refused_with_what_is_accepted() {
    const ROBOT: &str = "configs/robots/lab3.toml";
    refused(&["up", "configs/systems/demo3.toml", "--for", "1.7e150"], &["1.7e150", "accepted"]);
    refused(&["up", "configs/systems/demo3.toml", "--for", "1e8"], &["1e7 s"]);
    refused(&["ik", "--config", ROBOT, "--at", "1.7e150,1,1"], &["1.7e150", "accepted"]);
    refused(&["ik", "--config", ROBOT, "--at", "1e6,1,1"], &["1e5 m"]);
    refused(&["fk", "--config", ROBOT, "--lengths", "1e200,5,5"], &["1e200"]);
    refused(&["jog", "1", "1.7e150"], &["1.7e150"]);
    refused(&["goto", "1,2,1", "--speed", "1.7e150"], &["1.7e150"]);
    refused(
        &["plan", "--config", ROBOT, "--from", "4,3,1", "--to", "5,3,1", "--time-weight", "1e300"],
        &["1e300", "accepted"],
    );
    let keys = [
        ("tension_limits_n = [2.0, 60.0]", "tension_limits_n = [2.0, 1.7e150]", "100000 N"),
        ("ground_m = 0.0", "ground_m = -1.7e150", "500 m"),
        ("length_limits_m = [0.3, 14.0]", "length_limits_m = [0.3, 1.7e150]", "2000 m"),
        ("keep_out = []", "keep_out = [[[0, 0, 0], [1, 1, 1.7e150]]]", "10000 m"),
        ("# net_weight_n = 11.768", "net_weight_n = 1.7e150", "10000 N"),
        ("routed_length_m = [6.0, 6.0, 6.0]", "routed_length_m = [6.0, 6.0, 1.7e150]", "1000 m"),
    ];
    let folder = tempfile::tempdir().unwrap();
    let robot = fs::read_to_string(root().join(ROBOT)).unwrap();
    for (from, to, accepted) in keys {
        assert!(robot.contains(from), "{from}");
        let path = folder.path().join("robot.toml");
        fs::write(&path, robot.replace(from, to)).unwrap();
        refused(&["check", path.to_str().unwrap()], &["1.7e150;", accepted]);
    }
}

#[test]
fn a_number_too_many_or_too_few_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused_as = |name: &str, from: &str, to: &str, accepted: &str| {
        let text = fs::read_to_string(root().join("configs").join(name)).unwrap();
        assert!(text.contains(from), "{name} has no {from}");
        let text = text.replace(from, to).replace("../robots", root().join("configs/robots").to_str().unwrap());
        let path = folder.path().join("changed.toml");
        fs::write(&path, text).unwrap();
        refused(&["check", path.to_str().unwrap()], &["changed.toml, line", accepted]);
    };
    for numbers in ["[2.0, 60.0, 99.0, -7.0]", "[2.0]"] {
        let key = format!("tension_limits_n = {numbers}");
        refused_as("robots/lab3.toml", "tension_limits_n = [2.0, 60.0]", &key, "accepted: 2");
    }
    refused_as("systems/aq4.toml", "[planner] ", "[estimator]\nprior = [0.6, 0.4, 5.0]\n\n[planner] ", "accepted: 2");
    refused_as("systems/fast3.toml", "horizon_cycles = 31", "drive_lag_s = [0.03, 0.04, 0.05]", "accepted: 2");
    for (key, list) in [("height_m", "[0.0, 12.0, 5.0]"), ("corners_m", "[[8.0, 4.0, 0.0], [9.5, 4.3, 2.0]]")] {
        let height = if key == "height_m" { "" } else { "height_m = [0.0, 2.0]\n" };
        let center = if key == "height_m" { "center_m = [3.0, 6.0]\nradius_m = 0.2\n" } else { "" };
        let table = format!("[[obstacle]]\n{center}{height}{key} = {list}\n\n[lines] ");
        refused_as("robots/lab3.toml", "[lines] ", &table, "accepted: 2");
    }
    let boxes = "keep_out = [[[0, 0, 0], [1, 1, 1], [2, 2, 2]]]";
    refused_as("robots/lab3.toml", "keep_out = []", boxes, "accepted: 2");
    refused_as("ground/fig10.toml", "[3.9, 2.6]", "[3.9, 2.6, 0.0]", "accepted: 2");
}
