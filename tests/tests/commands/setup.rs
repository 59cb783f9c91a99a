//! `nims setup` as a process: with input from a pipe, interrupted and continued, and its result.

use serde_json::Value;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Answers for a site of three pulleys and nine points near their feet.
const SITE: [[f64; 3]; 3] = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];

fn setup(folder: &Path, args: &[&str], lines: &[String]) -> Output {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    assert!(program.is_file(), "{} is missing: run `cargo build --workspace --bins` first", program.display());
    let mut child = Command::new(program)
        .args(["setup", "site.toml"])
        .args(args)
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut typed = child.stdin.take().unwrap();
    // A program that rejects its arguments does not read the input.
    let _ = typed.write_all(lines.iter().map(|line| format!("{line}\n")).collect::<String>().as_bytes());
    drop(typed);
    child.wait_with_output().unwrap()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

fn answers() -> Vec<String> {
    let flat = SITE.map(|[x, y, _]| [x, y, 0.0]);
    let mut lines = vec!["3".to_owned()];
    lines.extend([(0, 1), (0, 2), (1, 2)].map(|(a, b)| format!("{:.3}", distance(flat[a], flat[b]))));
    // Measured heights: without them, wheels in place of eyes would not be excluded.
    lines.push("left".to_owned());
    lines.extend(SITE.map(|[_, _, z]| format!("{z:.2}")));
    lines.extend([String::new(), String::new()]);
    let middle = [4.83, 2.87];
    for k in 0..9 {
        let (foot, share) = (flat[k % 3], 0.9 - 0.05 * (k / 3) as f64);
        let at = [0, 1].map(|i| middle[i] + share * (foot[i] - middle[i]));
        lines.push(SITE.map(|pulley| format!("{:.2}", distance(pulley, [at[0], at[1], 0.0]))).join(" "));
    }
    lines
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_site_is_calibrated_from_a_pipe() {
    let folder = tempfile::tempdir().unwrap();
    let mut lines = answers();
    lines.push(String::new());
    let done = setup(folder.path(), &["--json"], &lines);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let value: Value = serde_json::from_slice(&done.stdout).unwrap();
    for (i, pulley) in SITE.iter().enumerate() {
        for (k, coordinate) in pulley.iter().enumerate() {
            assert!((value["anchors_m"][i][k].as_f64().unwrap() - coordinate).abs() < 0.03, "{value}");
        }
    }
    let asked = text(&done.stderr);
    for words in ["pulleys 1 and 2", "9 of 9", "±", "good: "] {
        assert!(asked.contains(words), "{words}: {asked}");
    }
    // The same numbers and words as those of `nims calibrate` for the same file.
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    let again = |args: &[&str]| {
        let again = Command::new(&program).args(args).arg("site.toml").current_dir(folder.path()).output().unwrap();
        text(&again.stdout)
    };
    assert_eq!(serde_json::from_str::<Value>(&again(&["--json", "calibrate"])).unwrap(), value);
    let words = again(&["calibrate"]);
    assert!(words.contains("good: ") && asked.contains(&words), "{words}\n{asked}");
    // A robot file can name the written file, and the next run does not overwrite it.
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let written: toml::Table = toml::from_str(&read("site-calibration.toml")).unwrap();
    assert_eq!(written["covariance_m2"].as_array().unwrap().len(), 9);
    let first = read("site-calibration.toml");
    let second = setup(folder.path(), &[], &[String::new()]);
    assert!(text(&second.stdout).contains("site-calibration-2.toml"), "{}", text(&second.stdout));
    assert_eq!(read("site-calibration.toml"), first);
    assert_eq!(read("site-calibration-2.toml").lines().count(), first.lines().count());
    let refused = setup(folder.path(), &["--out", "site-calibration.toml"], &[String::new()]);
    assert_eq!(refused.status.code(), Some(2));
    assert_eq!(read("site-calibration.toml"), first, "{}", text(&refused.stderr));
}

/// After the calibration the same command measures with a known weight, and writes the robot file.
#[test]
fn a_known_weight_renews_the_robot_file() {
    let folder = tempfile::tempdir().unwrap();
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
    let robot = folder.path().join("lab3.toml");
    std::fs::copy(configs.join("robots/lab3.toml"), &robot).unwrap();
    let mut lines = answers();
    lines.extend(["", "lab3.toml", "2 kg", "5.246 6.884 6.855", "63.5 mm", "3.840 8.001 7.987"].map(str::to_owned));
    let left = setup(folder.path(), &[], &lines);
    assert_eq!(left.status.code(), Some(1), "{}", text(&left.stderr));
    // The calibration is written, and the same command goes on with the weight.
    assert!(text(&left.stdout).contains("site-calibration.toml"), "{}", text(&left.stdout));
    let rest = ["46 mm", "", "4.9 6.7 7.1", "0.545 0.549 0.566", "-0.065 -0.065 -0.063", "1.254 1.264 1.308"];
    let last = ["-0.006 -0.005 -0.001", ""];
    let lines: Vec<String> = rest.into_iter().chain(last).map(str::to_owned).collect();
    let done = setup(folder.path(), &["--json"], &lines);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let value: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert!(value["loads"]["written"].as_str().unwrap().contains("lab3.toml"), "{value}");
    let found_n = value["loads"]["stiffness_n"]["value"].as_f64().unwrap();
    let [before, now] = [configs.join("robots/lab3.toml"), robot].map(|path| std::fs::read_to_string(path).unwrap());
    let parsed: toml::Table = toml::from_str(&now).unwrap();
    let written_n = parsed["lines"]["stiffness_n"].as_float().unwrap();
    assert!((written_n / found_n - 1.0).abs() < 1e-3 && written_n != 6000.0, "{written_n} {value}");
    // Comments stay.
    let comments = |text: &str| text.lines().filter(|line| line.contains('#')).count();
    assert_eq!(comments(&now), comments(&before));
    assert!(!folder.path().join("site-calibration-2.toml").exists());
    // A complete file is that of `nims loads`, and is not asked for again.
    let again = setup(folder.path(), &[], &[String::new()]);
    assert_eq!(again.status.code(), Some(0), "{}", text(&again.stderr));
    assert!(text(&again.stderr).contains("`nims loads site-loads.toml`"), "{}", text(&again.stderr));
}

#[test]
fn an_interruption_at_any_question_loses_no_answer() {
    let folder = tempfile::tempdir().unwrap();
    let whole = tempfile::tempdir().unwrap();
    let lines = answers();
    assert_eq!(setup(whole.path(), &[], &lines).status.code(), Some(1));
    for line in &lines {
        let left = setup(folder.path(), &[], std::slice::from_ref(line));
        assert_eq!(left.status.code(), Some(1));
        let said = text(&left.stderr);
        let last = said.lines().last().unwrap();
        // The command that continues.
        assert!(last.starts_with("nims: ") && last.contains("`nims setup site.toml`"), "{said}");
        assert!(left.stdout.is_empty());
    }
    let read = |folder: &Path| std::fs::read_to_string(folder.join("site.toml")).unwrap();
    assert_eq!(read(folder.path()), read(whole.path()));
    // No other files are left.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let quit = setup(folder.path(), &[], &["quit".to_owned()]);
    assert_eq!(quit.status.code(), Some(1));
    let last = setup(folder.path(), &[], &[String::new()]);
    assert_eq!(last.status.code(), Some(0), "{}", text(&last.stderr));
}

#[test]
fn invalid_files_are_rejected_before_any_question() {
    let folder = tempfile::tempdir().unwrap();
    let by_hand = "# mine\n[[range]]\nfrom = 1\nto = 2\nm = 9.0\n";
    std::fs::write(folder.path().join("site.toml"), by_hand).unwrap();
    let refused = setup(folder.path(), &[], &["3".to_owned()]);
    assert_eq!((refused.status.code(), text(&refused.stderr).lines().count()), (Some(2), 1));
    assert!(text(&refused.stderr).contains("comments"), "{}", text(&refused.stderr));
    assert_eq!(std::fs::read_to_string(folder.path().join("site.toml")).unwrap(), by_hand);
    std::fs::write(folder.path().join("site.toml"), "[setup]\npulleys = many\n").unwrap();
    let refused = setup(folder.path(), &[], &[]);
    assert_eq!((refused.status.code(), text(&refused.stderr).lines().count()), (Some(2), 1));
    // The place in the file.
    assert!(text(&refused.stderr).contains("site.toml, line 2"), "{}", text(&refused.stderr));
    std::fs::remove_file(folder.path().join("site.toml")).unwrap();
    std::fs::create_dir(folder.path().join("site.toml")).unwrap();
    let refused = setup(folder.path(), &[], &[]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("folder"), "{}", text(&refused.stderr));
    // Without an answer there is nothing to store.
    std::fs::remove_dir(folder.path().join("site.toml")).unwrap();
    let nothing = setup(folder.path(), &[], &[]);
    assert_eq!(nothing.status.code(), Some(1));
    assert!(!folder.path().join("site.toml").exists(), "{}", text(&nothing.stderr));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn the_transcript_in_the_documentation_equals_the_output() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/calibration.md");
    let page = std::fs::read_to_string(page).unwrap();
    let (_, shown) = page.split_once("$ nims setup site.toml\n").expect("the page has a transcript");
    let (shown, _) = shown.split_once("```").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut lines = answers();
    lines.insert(3, "99.8".to_owned());
    (lines[2], lines[4]) = ("9,801".to_owned(), "999.8 cm".to_owned());
    lines.insert(15, "9.56 3.52 9.73".to_owned());
    lines.insert(16, String::new());
    lines.insert(17, "again".to_owned());
    lines.push(String::new());
    let done = setup(folder.path(), &[], &lines);
    let came = text(&done.stderr) + &text(&done.stdout);
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut rest = words(&came);
    // Two dots mark what is left out.
    for part in shown.split("\n..\n").map(words) {
        let Some(at) = rest.find(&part) else { panic!("this does not come:\n{part}\nbut this does:\n{came}") };
        rest.drain(..at + part.len());
    }
}
