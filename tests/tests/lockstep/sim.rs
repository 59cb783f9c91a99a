//! `nims sim`: its figures are those of the same flight made by hand, its runs those of the recorder, and a law in a
//! program of its own flies as one that is built in.

use clap::Parser;
use command::Output;
use nims_sim::Args;
use nims_tests::lockstep::{Chain, fly_chain};
use nims_tests::scenarios::planar;
use serde_json::Value;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    args: Args,
}

pub fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// Flies with these options after the system file.
pub fn fly(system: &str, options: &[&str]) -> Output {
    let system = project().join("configs/systems").join(system).with_extension("toml");
    let words = ["sim", system.to_str().unwrap()].into_iter().chain(options.iter().copied());
    nims_sim::run(&Cli::parse_from(words).args).unwrap()
}

pub fn flights(output: &Output) -> Vec<Value> {
    output.value["flights"].as_array().unwrap().clone()
}

pub fn number(value: &Value, pointer: &str) -> f64 {
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

/// The lines of the page: the shell finds the runs, and not the table and the charts beside them.
#[test]
fn the_lines_for_continuous_integration_check_every_flight() {
    let page = std::fs::read_to_string(project().join("docs/analysis.md")).unwrap();
    let words = |beginning: &str| -> Vec<String> {
        let line = page.lines().find(|line| line.starts_with(beginning)).unwrap();
        line.split(' ').skip(2).map(str::to_owned).collect()
    };
    let [system, out, name] = &words("nims sim ")[..] else { panic!("{page}") };
    let [runs, check, limits] = &words("nims report flights/")[..] else { panic!("{page}") };
    assert_eq!((system.as_str(), out.as_str(), check.as_str()), ("configs/systems/demo3.toml", "--out", "--check"));
    let folder = tempfile::tempdir().unwrap();
    fly("demo3", &["--world", "1..2", "--out", folder.path().join(name).to_str().unwrap()]);
    let found = Command::new("sh").args(["-c", &format!("echo {runs}")]).current_dir(folder.path()).output().unwrap();
    let found = String::from_utf8(found.stdout).unwrap();
    let runs: Vec<PathBuf> = found.split_whitespace().map(|run| folder.path().join(run)).collect();
    assert_eq!(runs.len(), 2, "{found}");
    let args = analysis::report::Args { runs, out: None, between: None, check: Some(project().join(limits)) };
    let output = args.run().unwrap();
    assert!(output.failure.is_none(), "{}", output.words);
    assert!(output.value["limits"].as_array().unwrap().len() > 20, "{}", output.value["limits"]);
}

#[test]
fn flights_of_before_are_neither_replaced_nor_mixed_with_new_ones() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    fly("aq4", &["--longest", "1", "--out", out]);
    let run = folder.path().join("001-as-configured/run.mcap");
    let before = std::fs::read(&run).unwrap();
    let system = project().join("configs/systems/aq4.toml");
    let words = ["sim", system.to_str().unwrap(), "--world", "1", "--out", out];
    let refused = nims_sim::run(&Cli::parse_from(words).args).unwrap_err();
    assert!(refused.exit_code() == 2 && refused.to_string().contains("001-as-configured"), "{refused}");
    assert!(std::fs::read(&run).unwrap() == before && !folder.path().join("001-world-1").exists());
    // A program that steps flights itself flies one after the other, and continues the numbers.
    for name in ["002-as-configured", "003-as-configured"] {
        let program = std::env::current_exe().unwrap().parent().unwrap().join("../nims-sim");
        let mut child = Command::new(program)
            .args([system.to_str().unwrap(), "--steps", "--out", out])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(b"{\"reset\": {}}\n").unwrap();
        let output = child.wait_with_output().unwrap();
        let begun = String::from_utf8_lossy(&output.stdout).lines().next().unwrap().to_owned();
        assert!(begun.contains(name) && folder.path().join(name).join("run.mcap").exists(), "{begun}");
    }
}

/// Median and largest figure of the flights that reached the end.
#[test]
fn flights_that_differ_only_in_their_worlds_are_one_line() {
    let output = fly("demo3", &["--sweep", "controller.law=lq-endpoint,p-feedforward", "--world", "1..2"]);
    let rms: Vec<f64> = flights(&output).iter().map(|flight| number(flight, "/tracking/rms_m")).collect();
    let over = output.value["over_worlds"].as_array().unwrap();
    assert_eq!(over.iter().map(|one| &one["name"]).collect::<Vec<_>>(), ["law=lq-endpoint", "law=p-feedforward"]);
    let spread = [number(&over[1], "/tracking_rms_m/median"), number(&over[1], "/tracking_rms_m/max")];
    assert_eq!(spread, [0.5 * (rms[2] + rms[3]), rms[2].max(rms[3])]);
    assert!(over[1]["flights"] == serde_json::json!([3, 4]) && over[1]["completed"] == 2, "{}", over[1]);
    assert!(output.words.contains("over the worlds"), "{}", output.words);
    let heavy = fly("aq4", &["--set", "robot.net_weight_n=15.0", "--world", "1..2"]);
    assert!(heavy.value["over_worlds"][0]["completed"] == 0, "{}", heavy.value);
    assert!(heavy.value["over_worlds"][0]["truth_rms_m"].is_null(), "{}", heavy.value);
    let why = heavy.value["flights"][0]["gave_up"].as_str().unwrap();
    assert!(!why.is_empty() && heavy.words.contains(why), "{}", heavy.words);
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

/// Without its integral, the law of the page computes p-feedforward with the same gain, bit for bit.
#[test]
fn a_sweep_gives_a_program_its_gains_and_flies_a_built_in_law_beside_it() {
    let program =
        format!("env P_PER_S={{controller.length_gain_per_s}} I_PER_S2={{i}} {}", env!("CARGO_BIN_EXE_pi-law"));
    let sweeps = ["--sweep", "i=0,0.5", "--sweep", "controller.length_gain_per_s=1,3"];
    let options = ["--law", "p-feedforward", "--program", &program, "--world", "2"];
    let all = flights(&fly("aq4", &[&options[..], &sweeps[..]].concat()));
    let names: Vec<&str> = all.iter().map(|flight| flight["name"].as_str().unwrap()).collect();
    assert_eq!(
        names[..2],
        ["law=p-feedforward, length_gain_per_s=1, world 2", "law=p-feedforward, length_gain_per_s=3, world 2"]
    );
    assert_eq!(
        names[2..4],
        ["program, length_gain_per_s=1, i=0, world 2", "program, length_gain_per_s=3, i=0, world 2"]
    );
    assert_eq!(all.len(), 6);
    for (built_in, own) in [(0, 2), (1, 3)] {
        assert_eq!(all[built_in]["tracking"], all[own]["tracking"], "{own}");
        assert_ne!(all[own]["tracking"], all[own + 2]["tracking"], "the integral makes no difference");
    }
    assert!(all[0]["program"].is_null() && all[0]["values"]["controller.law"] == "p-feedforward", "{}", all[0]);
    assert!(all[5]["program"].as_str().unwrap().starts_with("env P_PER_S=3 I_PER_S2=0.5 "), "{}", all[5]);
    assert!(all[5]["values"]["i"] == "0.5" && all[5]["number"] == 6, "{}", all[5]);
    // One without a value is none of its own.
    let system = project().join("configs/systems/aq4.toml");
    let refused = nims_sim::run(&Cli::parse_from(["sim", system.to_str().unwrap(), "--program", "law {p}"]).args);
    assert!(refused.is_err_and(|refused| refused.exit_code() == 2 && refused.to_string().contains("{p}")));
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

/// A robot whose mass and drives come from a file of `nims identify` beside the robot file.
fn with_identified(folder: &Path) -> PathBuf {
    let system = std::fs::read_to_string(project().join("configs/systems/demo3.toml")).unwrap();
    let robot = std::fs::read_to_string(project().join("configs/robots/lab3.toml")).unwrap();
    let named = robot.replacen("[robot]\n", "[robot]\nidentified = \"found.toml\"\n", 1);
    assert_ne!(robot, named);
    std::fs::write(folder.join("robot.toml"), named).unwrap();
    std::fs::write(folder.join("found.toml"), "node_mass_kg = 2.25\ndelay_s = 0.03\nlag_s = 0.04\n").unwrap();
    let mut system: toml::Table = system.parse().unwrap();
    system.insert("robot".to_owned(), "robot.toml".into());
    let missions = project().join("configs/missions");
    let planner = system.entry("planner").or_insert_with(|| toml::Table::new().into()).as_table_mut().unwrap();
    planner.insert("missions".to_owned(), missions.to_str().unwrap().into());
    let path = folder.join("system.toml");
    std::fs::write(&path, system.to_string()).unwrap();
    path
}

#[test]
fn a_robot_with_an_identified_file_flies_with_changed_values_and_its_runs_have_it() {
    let folder = tempfile::tempdir().unwrap();
    let system = with_identified(folder.path());
    let run = |options: &[&str]| {
        let words = ["sim", system.to_str().unwrap()].into_iter().chain(options.iter().copied());
        nims_sim::run(&Cli::parse_from(words).args)
    };
    let out = folder.path().join("flights");
    let flown = run(&["--set", "robot.speed_limit_m_s=0.9", "--out", out.to_str().unwrap()]).unwrap();
    assert!(flown.value["flights"][0]["failed"].is_null(), "{}", flown.value);
    let refused = run(&["--sweep", "robot.node_mass_kg=2,3"]).unwrap_err();
    let named = ["robot.node_mass_kg", "found.toml"].iter().all(|named| refused.to_string().contains(named));
    assert!(refused.exit_code() == 2 && named, "{refused}");
    // The run file alone, as another computer gets it.
    let file = folder.path().join("alone").join("run.mcap");
    std::fs::create_dir(file.parent().unwrap()).unwrap();
    std::fs::copy(out.join("001-as-configured/run.mcap"), &file).unwrap();
    let set = |key: &str| replay::Changes { set: vec![(key.to_owned(), "2.0".to_owned())], ..Default::default() };
    let replayed = replay::run(&file, &Default::default(), &mut |_| ()).unwrap();
    assert!(replayed.different() == 0 && replayed.equal() > 1000, "{} differ", replayed.different());
    assert_eq!(replay::run(&file, &set("robot.node_mass_kg"), &mut |_| ()).unwrap_err().exit_code(), 2);
    let figures = analysis::report::figures(&file).unwrap();
    assert!(!figures["lacks"].to_string().contains("robot.toml"), "{}", figures["lacks"]);
    let name = config::SystemFile::load(&system).unwrap().name;
    assert_eq!(figures["recording"]["about"]["system"], name);
}

/// A custom program that runs with the modules of `scripts/python`.
pub fn python(script: &Path) -> String {
    format!("env PYTHONPATH={} python3 {}", project().join("scripts/python").display(), script.display())
}

/// Velocities that are no numbers are no answer in their cycle, as those of a law inside are.
#[test]
fn a_law_with_an_answer_that_is_not_finite_flies_on() {
    let folder = tempfile::tempdir().unwrap();
    let (template, path) = (project().join("scripts/templates/law.py"), folder.path().join("law.py"));
    let law = std::fs::read_to_string(template).unwrap();
    let broken = law.replace(
        "    return [speed",
        "    if asked.cycle % 100 == 0:\n        return [float(\"nan\")] * 4\n    return [speed",
    );
    assert_ne!(law, broken);
    std::fs::write(&path, broken).unwrap();
    let flown = &flights(&fly("aq4", &["--program", &python(&path)]))[0];
    assert!(flown["completed"] == true && flown["failed"].is_null(), "{flown}");
    assert!(number(flown, "/unsteered_cycles") > 0.0, "{flown}");
}

/// Lines of a program of Python: what it answers to the greeting, and what it says where it fails.
fn greeted(script: &str) -> (String, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("program.py");
    std::fs::write(&path, script).unwrap();
    let mut child = Command::new("sh")
        .args(["-c", &python(&path)])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // One that fails before it reads has closed the pipe.
    let _ = child.stdin.take().unwrap().write_all(b"{\"system\": \"\", \"cables\": 3}\n");
    let output = child.wait_with_output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (text(&output.stdout), text(&output.stderr))
}

#[test]
fn parameters_of_python_are_values_of_toml() {
    let call =
        |parameters: &str| greeted(&format!("import math, nims_law\nnims_law.run(lambda asked: None, {parameters})\n"));
    let (answer, _) = call(
        "gain=1.5, count=3, tiny=1e-9, most=math.inf, name='a \"b\" \\x7f \\U0001f600\\n', on=True, \
         rows=[[1, 2], [3.5]], inner={'x': 1, 'a b': ['c']}, **{'a key': -0.0}",
    );
    let answer: Value = serde_json::from_str(&answer).unwrap();
    let read: toml::Table = answer["parameters"].as_str().unwrap().parse().unwrap();
    let wanted = "gain = 1.5\ncount = 3\ntiny = 1e-9\nmost = inf\nname = \"a \\\"b\\\" \\u007f \\U0001F600\\n\"\non = true\n\
                  rows = [[1, 2], [3.5]]\n\"a key\" = -0.0\n[inner]\nx = 1\n\"a b\" = [\"c\"]\n";
    assert_eq!(read, wanted.parse().unwrap());
    for (parameters, named) in [("gain=None", "gain"), ("a={'b': [1, {2}]}", "a.b[1]"), ("n=2**64", "n is 18446")] {
        let (answer, why) = call(parameters);
        assert!(answer.is_empty() && why.contains(named) && why.contains("accepted"), "{answer}{why}");
    }
}

/// A program as a shell script: it greets, and then answers each question with these lines.
pub fn script(folder: &Path, answers: &str) -> String {
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
    let output = Command::new(nims_tests::python())
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
