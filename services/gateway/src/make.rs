//! What the `nims` beside this program does for clients: files of a finished run, findings about the machine; and the
//! removal of runs.
//!
//! Which program runs, and with which arguments, is written here; of a client comes the name of a run in the list.

use crate::runs;
use gateway_protocol::{FindingRow, RunFiles};
use robot_state::Reason;
use robot_state::answers::detail;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest time for the files of a run: those of a day at 100 Hz take some minutes.
const LONGEST: Duration = Duration::from_secs(15 * 60);
/// Time between two looks at whether they are made.
const LOOK: Duration = Duration::from_millis(50);
/// Largest part of a failure's sentence that is read, bytes.
const SENTENCE: u64 = 4096;
/// The figures of a report, beside its page.
const FIGURES: &str = "report.json";

/// Makes files of a finished run; `present`: the run folder of the robot that runs.
///
/// # Errors
/// There is no such run, or why the files cannot be made.
pub(crate) fn make(runs: &Path, present: Option<&Path>, run: &str, what: RunFiles) -> Result<(), Box<Reason>> {
    let nims = std::env::current_exe().map_err(|error| refused(&error))?.with_file_name("nims");
    make_by(&nims, runs, present, run, what)
}

fn make_by(nims: &Path, runs: &Path, present: Option<&Path>, run: &str, what: RunFiles) -> Result<(), Box<Reason>> {
    let folder = finished(runs, present, run)?;
    let figures = folder.join(format!(".{FIGURES}"));
    // The robot comes first, also with every processor that it does not need at the moment.
    let mut command = Command::new("nice");
    command.args(["-n", "19"]).arg(nims).arg("--json");
    match what {
        RunFiles::Report => command.arg("report").arg(&folder),
        RunFiles::Maps => command.arg("map").arg(&folder),
        RunFiles::Csv => command.arg("export").arg(&folder).args(["--format", "csv"]),
        RunFiles::Parquet => command.arg("export").arg(&folder).args(["--format", "parquet"]),
    };
    let out = match what {
        RunFiles::Report => Stdio::from(File::create(&figures).map_err(|error| refused(&error))?),
        _ => Stdio::null(),
    };
    let begun = command.stdin(Stdio::null()).stdout(out).stderr(Stdio::piped()).spawn();
    let made = begun.map_err(|error| refused(&error)).and_then(|child| ended(child, run));
    if what == RunFiles::Report {
        let put =
            if made.is_ok() { std::fs::rename(&figures, folder.join(FIGURES)) } else { std::fs::remove_file(&figures) };
        put.map_err(|error| refused(&error))?;
    }
    made
}

/// Finds what is wrong with this machine for the robot of a system file.
///
/// # Errors
/// Why that cannot be found out.
pub(crate) fn doctor(system: &Path) -> Result<Vec<FindingRow>, Box<Reason>> {
    let nims = std::env::current_exe().map_err(|error| refused(&error))?.with_file_name("nims");
    let mut command = Command::new("nice");
    command.args(["-n", "19"]).arg(nims).args(["--json", "doctor"]).arg(system).stdin(Stdio::null());
    // With an error among the findings it ends with 1, and prints them too.
    let output = command.output().map_err(|error| refused(&error))?;
    match serde_json::from_slice::<Doctor>(&output.stdout) {
        Ok(found) => Ok(found.findings),
        Err(_) => Err(refused(&last_line(&String::from_utf8_lossy(&output.stderr), "nims doctor prints no findings"))),
    }
}

/// What `nims doctor` prints.
#[derive(serde::Deserialize)]
struct Doctor {
    findings: Vec<FindingRow>,
}

fn last_line(text: &str, otherwise: &str) -> String {
    text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or(otherwise).to_owned()
}

/// Deletes a finished run.
///
/// # Errors
/// There is no such run, or why it cannot be deleted.
pub(crate) fn remove(runs: &Path, present: Option<&Path>, run: &str) -> Result<(), Box<Reason>> {
    let folder = finished(runs, present, run)?;
    // A list never has a part of a run.
    let hidden = runs.join(format!(".deleted-{run}"));
    std::fs::rename(&folder, &hidden).map_err(|error| refused(&error))?;
    std::fs::remove_dir_all(&hidden).map_err(|error| refused(&error))
}

fn finished(runs: &Path, present: Option<&Path>, run: &str) -> Result<PathBuf, Box<Reason>> {
    match runs::files(runs, present, run) {
        Some(_) => Ok(runs.join(run)),
        None => Err(Box::new(Reason::NoFinishedRun { run: detail(run) })),
    }
}

fn ended(mut child: Child, run: &str) -> Result<(), Box<Reason>> {
    let begun = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok(()),
            Ok(Some(_)) => {
                let mut sentence = String::new();
                if let Some(pipe) = child.stderr.take() {
                    // Without it the sentence is the one below.
                    let _ = pipe.take(SENTENCE).read_to_string(&mut sentence);
                }
                return Err(refused(&last_line(&sentence, &format!("the files of the run {run} could not be made"))));
            }
            Ok(None) if begun.elapsed() < LONGEST => std::thread::sleep(LOOK),
            Ok(None) | Err(_) => {
                let _ = child.kill();
                let _ = child.wait();
                let minutes = LONGEST.as_secs() / 60;
                let why =
                    format!("the files of the run {run} take more than {minutes} minutes; copy it with nims fetch");
                return Err(refused(&why));
            }
        }
    }
}

fn refused(why: &dyn std::fmt::Display) -> Box<Reason> {
    Box::new(Reason::DiskRefused { why: detail(why) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    /// A folder with a finished run, and a program in place of `nims`.
    fn place(script: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("runs/done")).unwrap();
        for name in ["manifest.json", "run.mcap"] {
            std::fs::write(folder.path().join("runs/done").join(name), "x").unwrap();
        }
        let nims = folder.path().join("nims");
        std::fs::write(&nims, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&nims, std::fs::Permissions::from_mode(0o700)).unwrap();
        (folder, nims)
    }

    #[test]
    fn files_are_made_of_a_finished_run_by_a_fixed_command() {
        let (folder, nims) = place("echo \"$@\"; echo made > \"$3/report.html\"");
        let runs = folder.path().join("runs");
        make_by(&nims, &runs, None, "done", RunFiles::Report).unwrap();
        let figures = std::fs::read_to_string(runs.join("done/report.json")).unwrap();
        assert_eq!(figures, format!("--json report {}\n", runs.join("done").display()));
        let files: Vec<_> = runs::files(&runs, None, "done").unwrap().into_iter().map(|file| file.name).collect();
        assert_eq!(files, ["manifest.json", "report.html", "report.json", "run.mcap"]);
        for run in ["other", "../runs/done", ""] {
            assert_eq!(make_by(&nims, &runs, None, run, RunFiles::Csv).unwrap_err().code(), 461, "{run}");
        }
        assert_eq!(make_by(&nims, &runs, Some(&runs.join("done")), "done", RunFiles::Csv).unwrap_err().code(), 461);
    }

    #[test]
    fn a_failure_is_the_sentence_of_the_command() {
        let (folder, nims) = place("echo reading >&2; echo 'nims: the run has no sensor' >&2; exit 1");
        let runs = folder.path().join("runs");
        for what in [RunFiles::Report, RunFiles::Maps] {
            let reason = make_by(&nims, &runs, None, "done", what).unwrap_err();
            assert!(format!("{reason:?}").contains("the run has no sensor"), "{reason:?}");
        }
        assert_eq!(runs::files(&runs, None, "done").unwrap().len(), 2);
    }

    #[test]
    fn a_run_is_deleted_whole_and_the_present_one_never() {
        let (folder, _) = place("");
        let runs = folder.path().join("runs");
        std::os::unix::fs::symlink(folder.path().join("nims"), runs.join("done/link")).unwrap();
        assert_eq!(remove(&runs, Some(&runs.join("done")), "done").unwrap_err().code(), 461);
        remove(&runs, None, "done").unwrap();
        assert_eq!(std::fs::read_dir(&runs).unwrap().count(), 0);
        assert!(folder.path().join("nims").is_file());
        assert_eq!(remove(&runs, None, "done").unwrap_err().code(), 461);
    }
}
