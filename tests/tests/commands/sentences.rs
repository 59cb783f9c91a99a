//! How the command line reads to a person: refusals and verdicts, word for word, in `sentences.txt` beside this file.
//! The other tests of the command line compare exit codes, keys, paths and numbers.

use crate::command_line::{BAD_ARGUMENTS, BAD_MISSIONS, BAD_ROBOTS, BAD_SYSTEMS, ROBOT, SYSTEM, changed, nims, root};
use std::path::Path;

/// Lines of the file: a name, and what the command printed.
#[derive(Default)]
struct Printed(Vec<(String, String)>);

impl Printed {
    /// Runs a command and takes the last text line, the verdict. `folder` differs between runs and stands as `{folder}`
    /// in the file, the folder of the project as `{root}`.
    fn run(&mut self, name: &str, args: &[&str], folder: Option<&Path>) {
        let output = nims(args);
        let text = String::from_utf8_lossy(if output.stderr.is_empty() { &output.stdout } else { &output.stderr });
        let last = text.trim_end().lines().last().unwrap_or_default();
        self.0.push((name.to_owned(), without(last, folder)));
    }
}

fn without(text: &str, folder: Option<&Path>) -> String {
    let text = folder.map_or_else(|| text.to_owned(), |folder| text.replace(&folder.display().to_string(), "{folder}"));
    text.replace(&root().display().to_string(), "{root}")
}

fn named(what: &str, from: &str, to: &str) -> String {
    format!("{what}, {from} -> {to}").replace('\n', "\\n")
}

fn changed_files(printed: &mut Printed) {
    for (from, to, _) in BAD_ROBOTS {
        let files = changed("robots/lab3.toml", from, to);
        printed.run(&named("check", from, to), &["check", &files.file("robots/lab3.toml")], Some(files.folder.path()));
    }
    for (from, to, _) in BAD_SYSTEMS {
        let files = changed("systems/demo3.toml", from, to);
        let args = ["up", &files.file("systems/demo3.toml"), "--for", "1", "--run", &files.file("run")];
        printed.run(&named("up", from, to), &args, Some(files.folder.path()));
    }
    for (from, to, _) in BAD_MISSIONS {
        let files = changed("missions/spiral.toml", from, to);
        let args = ["demo", &files.file("systems/demo3.toml"), "--mission", &files.file("missions/spiral.toml")];
        printed.run(&named("demo", from, to), &args, Some(files.folder.path()));
    }
    for (file, from, to) in [
        ("robots/lab3.toml", "[4.7, 8.6, 2.98]", "[4.9, 0.0, 3.075]"),
        ("robots/aq4.toml", "[8.0, 0.3]", "[8.0, 0.0, 0.3]"),
        ("robots/aq4.toml", "[[0.0, 3.8], [8.0, 6.0]]", "[[0.0, 3.8], [8.0, 1.0, 6.0]]"),
        ("systems/aq4.toml", "start_m = [4.0, 2.0]", "start_m = [4.0, 1.0, 2.0]"),
        ("systems/demo3.toml", "\"../robots/lab3.toml\"", "\"demo3.toml\""),
    ] {
        let files = changed(file, from, to);
        printed.run(&named(file, from, to), &["check", &files.file(file)], Some(files.folder.path()));
    }
    let slow = changed("robots/lab3.toml", "# cable_speed_limit_m_s = 0.8 ", "cable_speed_limit_m_s = 0.1 ");
    let args = ["demo", &slow.file("systems/demo3.toml"), "--mission", &slow.file("missions/spiral.toml")];
    printed.run("demo, slow cables", &args, Some(slow.folder.path()));
}

fn no_runs(printed: &mut Printed) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    std::fs::write(&path, "not a run").unwrap();
    for command in ["recover", "info"] {
        printed.run(&format!("{command}, a text"), &[command, path.to_str().unwrap()], Some(folder.path()));
    }
    let pipe = folder.path().join("pipe.toml");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for command in ["check", "info", "replay"] {
        printed.run(&format!("{command}, a pipe"), &[command, pipe.to_str().unwrap()], Some(folder.path()));
    }
}

#[test]
fn the_command_line_reads_as_in_the_file() {
    let mut printed = Printed::default();
    for (args, _) in BAD_ARGUMENTS {
        printed.run(&format!("nims {}", args.join(" ")), args, None);
    }
    for args in [
        &["status", "--domain", "nobody-here"][..],
        &["check", "configs/missions/spiral.toml", "--for", SYSTEM],
        &["check", SYSTEM],
        &["run", "spiral", "--dry-run", "--config", "configs/systems/aq4.toml"],
        &["run", "cross-section", "--dry-run", "--config", SYSTEM],
        &["run", "demo", "--dry-run", "--config", ROBOT],
        &["doctor", ROBOT],
        &["run", SYSTEM, "--dry-run", "--config", SYSTEM],
        &["calibrate", SYSTEM],
        &["setup", ROBOT],
        &["loads", SYSTEM],
        &["check", "configs/measurements/lab3.toml"],
        &["ik", "--config", "configs/missions/demo.toml", "--at", "1,2,3"],
        &["ik", "--config", "configs/robots/aq4.toml", "--at", "2.5,0.1,3.0"],
        &["ik", "--config", ROBOT, "--at", "2.5,3.0"],
    ] {
        printed.run(&format!("nims {}", args.join(" ")), args, None);
    }
    changed_files(&mut printed);
    no_runs(&mut printed);
    sentences::compare_with(&root().join("tests/tests/commands/sentences.txt"), printed.0);
}
