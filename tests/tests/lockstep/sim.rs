//! `nims sim`: its figures are those of the same flight made by hand, its runs those of the recorder, and a law in a
//! program of its own flies as one that is built in.

use crate::method::MyEstimator;
use clap::Parser;
use command::Output;
use estimator::Estimator;
use nims_sim::Args;
use nims_tests::lockstep::{Chain, fly_chain};
use nims_tests::scenarios::planar;
use serde_json::Value;
use std::path::{Path, PathBuf};

#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    args: Args,
}

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// Flies with these options after the system file.
fn fly(system: &str, options: &[&str]) -> Output {
    let system = project().join("configs/systems").join(system).with_extension("toml");
    let words = ["sim", system.to_str().unwrap()].into_iter().chain(options.iter().copied());
    nims_sim::run(&Cli::parse_from(words).args).unwrap()
}

fn flights(output: &Output) -> Vec<Value> {
    output.value["flights"].as_array().unwrap().clone()
}

fn number(value: &Value, pointer: &str) -> f64 {
    value.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer} in {value}"))
}

/// The oracle is the flight that tests of the chain make.
#[test]
fn the_figures_are_those_of_the_chain_of_the_system_file() {
    let output = fly("aq4", &[]);
    let [flight] = &flights(&output)[..] else { panic!("{}", output.value) };
    let file = config::SystemFile::load(&project().join("configs/systems/aq4.toml")).unwrap();
    let by_hand = fly_chain(planar().unwrap(), Chain::from_file(&file).unwrap(), |_| Ok(())).unwrap();
    assert_eq!(number(flight, "/tracking/rms_m"), by_hand.estimate.rms_m);
    assert_eq!(number(flight, "/truth/max_m"), by_hand.truth.max_m);
    assert_eq!(number(flight, "/energy_j"), by_hand.energy_j);
    assert_eq!(flight["completed"], true);
    assert!(output.failure.is_none());
}

#[test]
fn a_sweep_flies_every_combination_with_its_values() {
    let sweep = ["--sweep", "controller.law=lq-endpoint,p-feedforward", "--set", "robot.net_weight_n=15.0"];
    let output = fly("aq4", &[&sweep[..], &["--world", "1..2"]].concat());
    let found = flights(&output);
    assert_eq!(found.len(), 4);
    let rms: Vec<f64> = found.iter().map(|flight| number(flight, "/tracking/rms_m")).collect();
    // The laws differ more than the worlds, in which both follow their estimate.
    assert!(rms[2] > 1.5 * rms[0] && rms[3] > 1.5 * rms[1], "{rms:?}");
    assert!(number(&found[0], "/truth/rms_m") != number(&found[1], "/truth/rms_m"));
    // A heavier node hangs on tighter cables.
    let floating = flights(&fly("aq4", &["--world", "1"]));
    assert!(number(&found[0], "/tension_n/1") > number(&floating[0], "/tension_n/1"));
}

#[test]
fn a_run_is_one_that_reports_and_replays_open() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("flights");
    let output = fly("aq4", &["--set", "controller.law=preview", "--out", out.to_str().unwrap()]);
    let [flight] = &flights(&output)[..] else { panic!("{}", output.value) };
    let run = out.join(flight["folder"].as_str().unwrap());
    let report = analysis::report::report(std::slice::from_ref(&run), None).unwrap().value;
    let tracked = number(&report, "/runs/0/analysis/estimate/rms_m");
    let stated = number(flight, "/tracking/rms_m");
    // The report counts only the cycles in which the setpoint is faster than some limit.
    assert!((tracked / stated - 1.0).abs() < 0.02, "{tracked} m, {stated} m");
    let replayed = replay::run(&run, &Default::default(), &mut |_| ()).unwrap();
    assert!(replayed.different() == 0 && replayed.equal() > 1000, "{} differ", replayed.different());
    for picture in ["sim.svg", "sim.png", "sim.json"] {
        assert!(out.join(picture).metadata().unwrap().len() > 500, "{picture}");
    }
    let again = fly("aq4", &["--set", "controller.law=preview", "--jobs", "1"]);
    assert_eq!(flights(&again), flights(&output), "the same files, other figures");
}

/// Both templates compute the built-in p-feedforward law with its default gain, so all three fly alike, bit for bit.
#[test]
fn a_law_in_its_own_program_flies_as_a_built_in_one() {
    let built_in = flights(&fly("aq4", &["--law", "p-feedforward", "--set", "controller.length_gain_per_s=1.5"]));
    let rust = env!("CARGO_BIN_EXE_my-law").to_owned();
    let script = project().join("scripts/templates/law.py");
    let modules = project().join("scripts/python");
    let python = format!("env PYTHONPATH={} python3 {}", modules.display(), script.display());
    for program in [rust, python] {
        let own = flights(&fly("aq4", &["--program", &program]));
        for figure in ["/tracking/rms_m", "/truth/max_m", "/energy_j", "/tension_n/0"] {
            assert_eq!(number(&own[0], figure), number(&built_in[0], figure), "{figure} of {program}");
        }
    }
}

/// The page has the file that is compiled here, and the whole script.
#[test]
fn the_laws_of_the_page_fly_alike_in_both_languages() {
    let page = std::fs::read_to_string(project().join("docs/simulation.md")).unwrap();
    let block = |language: &str| {
        let begun = page.split_once(&format!("```{language}\n")).unwrap().1;
        let indent = if language == "python" { "   " } else { "" };
        let lines = begun.lines().take_while(|line| line.trim() != "```");
        lines.map(|line| line.strip_prefix(indent).unwrap_or(line).to_owned() + "\n").collect::<String>()
    };
    let compiled = std::fs::read_to_string(project().join("tests/src/pi/law.rs")).unwrap();
    assert_eq!(block("rust"), compiled);
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("pi.py");
    std::fs::write(&script, block("python")).unwrap();
    let python = format!("env PYTHONPATH={} python3 {}", project().join("scripts/python").display(), script.display());
    let [rust, python] = [env!("CARGO_BIN_EXE_pi-law"), &python].map(|program| {
        let all = flights(&fly("aq4", &["--program", program]));
        assert_eq!(all[0]["completed"], true, "{}", all[0]);
        all
    });
    assert_eq!(rust[0]["tracking"], python[0]["tracking"]);
    assert_eq!(rust[0]["energy_j"], python[0]["energy_j"]);
    let without = flights(&fly("aq4", &["--law", "p-feedforward", "--set", "controller.length_gain_per_s=1.5"]));
    assert_ne!(rust[0]["tracking"], without[0]["tracking"], "the integral makes no difference");
}

/// Both templates compute the same as the method of the template inside the flight, bit for bit.
#[test]
fn an_estimator_in_its_own_program_flies_as_one_inside() {
    let file = config::SystemFile::load(&project().join("configs/systems/aq4.toml")).unwrap();
    let chain = Chain::from_file(&file).unwrap();
    let estimator = Estimator::with_method(chain.estimator.config(), Box::new(MyEstimator::default()));
    let inside = fly_chain(planar().unwrap(), Chain { estimator, ..chain }, |_| Ok(())).unwrap();
    let standard = flights(&fly("aq4", &[]));
    assert_ne!(number(&standard[0], "/truth/max_m"), inside.truth.max_m, "the method makes no difference");
    let rust = env!("CARGO_BIN_EXE_my-estimator").to_owned();
    let script = project().join("scripts/templates/estimator.py");
    let python = format!("env PYTHONPATH={} python3 {}", project().join("scripts/python").display(), script.display());
    for program in [rust, python] {
        let own = flights(&fly("aq4", &["--estimator-program", &program]));
        assert_eq!(number(&own[0], "/tracking/rms_m"), inside.estimate.rms_m, "{program}");
        assert_eq!(number(&own[0], "/truth/max_m"), inside.truth.max_m, "{program}");
        assert_eq!(number(&own[0], "/energy_j"), inside.energy_j, "{program}");
    }
}

/// One that leaves out cables has no estimate, so the mission is not flown; a wrong answer fails the flight.
#[test]
fn an_estimator_without_an_answer_does_not_fly() {
    let folder = tempfile::tempdir().unwrap();
    for (answer, named) in [("null", None), ("[null,null,null,null]", None), ("[null]", Some("1 for 4 cables"))] {
        let program = script(folder.path(), &format!(r"{answer}\n"));
        let output = fly("aq4", &["--estimator-program", &program, "--longest", "5"]);
        let flight = &flights(&output)[0];
        assert!(output.failure.is_some() && flight["completed"] != true, "{flight}");
        if let Some(named) = named {
            assert!(flight["failed"].as_str().unwrap().contains(named), "{flight}");
        }
    }
}

#[test]
fn a_flight_that_fails_says_why_and_the_others_go_on() {
    let output = fly("aq4", &["--sweep", "planner.speed_m_s=0.2,9.0"]);
    let found = flights(&output);
    assert_eq!(found[0]["completed"], true);
    assert!(found[1]["failed"].is_string() || found[1]["completed"] == true, "{}", found[1]);
    for (program, named) in [("false", "false"), ("echo hello", "echo hello"), ("no-such-program", "no-such-program")] {
        let output = fly("aq4", &["--program", program]);
        let why = flights(&output)[0]["failed"].as_str().unwrap().to_owned();
        assert!(why.contains(named) && output.failure.is_some(), "{why}");
    }
}

/// A program as a shell script: it greets, and then answers each question with these lines.
fn script(folder: &Path, answers: &str) -> String {
    let path = folder.join("law.sh");
    let text =
        format!("read hello\necho '{{\"parameters\":\"\"}}'\nwhile read question; do printf '{answers}'; done\n");
    std::fs::write(&path, text).unwrap();
    format!("sh {}", path.display())
}

#[test]
fn a_flight_that_does_not_reach_the_end_is_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let output = fly("aq4", &["--program", &script(folder.path(), r"null\n"), "--longest", "5"]);
    assert_ne!(flights(&output)[0]["completed"], true);
    assert!(output.failure.is_some());
}

/// Its later answers would be taken for those of the questions before.
#[test]
fn a_law_that_answers_without_a_question_is_told_so() {
    let folder = tempfile::tempdir().unwrap();
    let output = fly("aq4", &["--program", &script(folder.path(), r"[0,0,0,0]\n[0,0,0,0]\n"), "--longest", "5"]);
    let why = flights(&output)[0]["failed"].as_str().unwrap().to_owned();
    assert!(why.contains("without a question") && output.failure.is_some(), "{why}");
}

#[test]
fn a_key_that_does_not_exist_is_refused_by_its_name() {
    let system = project().join("configs/systems/aq4.toml");
    let words = ["sim", system.to_str().unwrap(), "--set", "controller.no_such_key=1"];
    let output = nims_sim::run(&Cli::parse_from(words).args).unwrap();
    let why = output.value["flights"][0]["failed"].as_str().unwrap();
    assert!(why.contains("no_such_key"), "{why}");
}

/// The script says what it leaves out, because a package is not installed.
#[test]
fn a_flight_from_python_is_that_of_the_same_law_inside() {
    let folder = tempfile::tempdir().unwrap();
    let program = std::env::current_exe().unwrap().parent().unwrap().join("../nims-sim");
    let output = std::process::Command::new(nims_tests::python())
        .env("PYTHONPATH", project().join("scripts/python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .arg(project().join("tests/python/check_package.py"))
        .args([&project().join("configs/systems/demo3.toml"), &program, folder.path()])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    for line in said.lines() {
        let (what, why) = line.strip_prefix("left out: ").and_then(|line| line.split_once(", which ")).expect(line);
        notes::left_out(what, format!("it needs a package that {why}"));
    }
}
