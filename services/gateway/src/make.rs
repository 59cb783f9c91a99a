//! What the `nims` beside this program does for clients: files of a finished run, findings about the machine; and the
//! removal of runs.
//!
//! Which program runs, and with which arguments, is written here; of a client comes the name of a run in the list.

use crate::runs;
use gateway_protocol::{FindingRow, RunFiles};
use robot_state::Reason;
use robot_state::answers::detail;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Longest time for the files of a run: those of a day at 100 Hz take some minutes.
const LONGEST: Duration = Duration::from_secs(15 * 60);
/// Longest time for findings about the machine: shorter than the minute for which a page waits.
const LONGEST_FINDINGS: Duration = Duration::from_secs(50);
/// Time between two looks at whether they are made.
const LOOK: Duration = Duration::from_millis(50);
/// Largest part of what a program prints about its failure that is read: its end, bytes.
const SENTENCE: u64 = 4096;
/// Beginning of the name of a run that is being deleted.
const DELETED: &str = ".deleted-";
/// Largest size of what a program prints as findings, bytes.
const FINDINGS: u64 = 1 << 20;
/// How a program begins that must not disturb the robot or the gateway, whose cgroup it shares: the kernel ends it
/// first where memory is short, its memory is bounded below `MemoryMax` of the unit (kB, for a sentence in place of a
/// kill), and it gets only the processors and the disk that are idle.
const ASIDE: &str = "echo 1000 > /proc/self/oom_score_adj; ulimit -d 393216; exec nice -n 19 ionice -c 3 \"$@\"";

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
    let mut command = aside(nims);
    // The report writes its figures beside its page; what else is printed is for terminals.
    match what {
        RunFiles::Report => command.arg("report").arg(&folder),
        RunFiles::Maps => command.arg("map").arg(&folder),
        RunFiles::Csv => command.arg("export").arg(&folder).args(["--format", "csv"]),
        RunFiles::Parquet => command.arg("export").arg(&folder).args(["--format", "parquet"]),
    };
    let otherwise = format!("the files of the run {run} could not be made");
    match ended(command.stdout(Stdio::null()), LONGEST)? {
        Some((status, _)) if status.success() => Ok(()),
        Some((_, sentence)) => Err(refused(&last_line(&sentence, &otherwise))),
        None => {
            let minutes = LONGEST.as_secs() / 60;
            Err(refused(&format!(
                "the files of the run {run} take more than {minutes} minutes; copy it with nims fetch"
            )))
        }
    }
}

/// Finds what is wrong with this machine for the robot of a system file. `supervisor`: its process, if it runs, whose
/// limits count, because the service of the gateway has no real-time priority and no devices.
///
/// # Errors
/// Why that cannot be found out.
pub(crate) fn doctor(system: &Path, supervisor: Option<u32>) -> Result<Vec<FindingRow>, Box<Reason>> {
    let nims = std::env::current_exe().map_err(|error| refused(&error))?.with_file_name("nims");
    doctor_by(&nims, system, supervisor, LONGEST_FINDINGS)
}

fn doctor_by(
    nims: &Path,
    system: &Path,
    supervisor: Option<u32>,
    longest: Duration,
) -> Result<Vec<FindingRow>, Box<Reason>> {
    let mut found = command::temporary_file().map_err(|error| refused(&error))?;
    let mut command = aside(nims);
    command.arg("doctor").arg(system).arg("--limits-of").arg(supervisor.unwrap_or(0).to_string());
    command.stdout(found.try_clone().map_err(|error| refused(&error))?);
    let Some((_, sentence)) = ended(&mut command, longest)? else {
        let why = format!("nims doctor takes more than {} s; start it on the robot's machine", longest.as_secs());
        return Err(refused(&why));
    };
    // With an error among the findings it ends with 1, and prints them too.
    match serde_json::from_slice::<Doctor>(&printed(&mut found, FINDINGS)) {
        Ok(found) => Ok(found.findings),
        Err(_) => Err(refused(&last_line(&sentence, "nims doctor prints no findings"))),
    }
}

/// What `nims doctor` prints.
#[derive(serde::Deserialize)]
struct Doctor {
    findings: Vec<FindingRow>,
}

pub(crate) fn last_line(text: &str, otherwise: &str) -> String {
    text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or(otherwise).to_owned()
}

/// Deletes a finished run.
///
/// # Errors
/// There is no such run, or why it cannot be deleted.
pub(crate) fn remove(runs: &Path, present: Option<&Path>, run: &str) -> Result<(), Box<Reason>> {
    let folder = finished(runs, present, run)?;
    // A list never has a part of a run.
    let hidden = runs.join(format!("{DELETED}{run}"));
    std::fs::rename(&folder, &hidden).map_err(|error| refused(&error))?;
    removed(&hidden).map_err(|error| refused(&error))
}

/// Removes what is left of runs whose deletion was interrupted.
pub(crate) fn sweep(runs: &Path) {
    for entry in std::fs::read_dir(runs).into_iter().flatten().flatten() {
        let left = entry.file_name().to_str().is_some_and(|name| name.starts_with(DELETED));
        if left && let Err(error) = removed(&entry.path()) {
            let path = entry.path();
            eprintln!("gateway: the rest of a deleted run cannot be removed: {}: {error}", path.display());
        }
    }
}

/// Removes a folder; the gateway of another robot with the same runs may do the same.
fn removed(folder: &Path) -> std::io::Result<()> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

fn finished(runs: &Path, present: Option<&Path>, run: &str) -> Result<PathBuf, Box<Reason>> {
    match runs::files(runs, present, run) {
        Some(_) => Ok(runs.join(run)),
        None => Err(Box::new(Reason::NoFinishedRun { run: detail(run) })),
    }
}

/// The program `nims`, with the rest of the line to be added.
pub(crate) fn aside(nims: &Path) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", ASIDE, "sh"]).arg(nims).arg("--json").stdin(Stdio::null());
    command
}

/// Waits for the end of a program, and returns how it ended with the last that it printed about it; none if it takes
/// longer. What it prints goes to a file: a pipe that is read only after the end stops a program that fills it.
pub(crate) fn ended(command: &mut Command, longest: Duration) -> Result<Option<(ExitStatus, String)>, Box<Reason>> {
    let mut sentence = command::temporary_file().map_err(|error| refused(&error))?;
    let writes = sentence.try_clone().map_err(|error| refused(&error))?;
    let mut child = command.stderr(writes).spawn().map_err(|error| refused(&error))?;
    let begun = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) => {
                return Ok(Some((status, String::from_utf8_lossy(&printed(&mut sentence, SENTENCE)).into_owned())));
            }
            Ok(None) if begun.elapsed() < longest => std::thread::sleep(LOOK),
            Ok(None) | Err(_) => {
                let _ = child.kill();
                let _ = child.wait();
                return Ok(None);
            }
        }
    }
}

/// The end of a file, at most this many bytes; nothing if it cannot be read.
pub(crate) fn printed(file: &mut File, most: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    let length = file.metadata().map_or(0, |metadata| metadata.len());
    if file.seek(SeekFrom::Start(length.saturating_sub(most))).is_ok() {
        // Without it the sentence is that of the caller.
        let _ = file.take(most).read_to_end(&mut bytes);
    }
    bytes
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
        let (folder, nims) = place("echo printed; echo made > \"$3/report.html\"; echo \"$@\" > \"$3/report.json\"");
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
    fn what_makes_files_gives_way_to_the_robot_and_the_gateway() {
        let (folder, nims) = place("{ cat /proc/self/oom_score_adj; ulimit -d; nice; ionice; } > \"$3/own.txt\"");
        let runs = folder.path().join("runs");
        make_by(&nims, &runs, None, "done", RunFiles::Csv).unwrap();
        let own = std::fs::read_to_string(runs.join("done/own.txt")).unwrap();
        assert_eq!(own.lines().collect::<Vec<_>>(), ["1000", "393216", "19", "idle"]);
        let unit = include_str!("../../../configs/host/nims-gateway@.service");
        let keys: Vec<_> = unit.lines().filter_map(|line| line.split_once('=')).collect();
        assert!(keys.contains(&("MemoryMax", "512M")) && keys.contains(&("OOMPolicy", "continue")), "{keys:?}");
    }

    #[test]
    fn a_program_that_prints_much_or_does_not_end_blocks_nothing() {
        let warnings = "head -c 300000 /dev/zero | tr '\\0' 'w' >&2; echo >&2; echo 'nims: it is full' >&2; exit 1";
        let (folder, nims) = place(warnings);
        let runs = folder.path().join("runs");
        let reason = make_by(&nims, &runs, None, "done", RunFiles::Csv).unwrap_err();
        assert!(format!("{reason:?}").contains("it is full"), "{reason:?}");
        let finding = r#"{"findings":[{"level":"error","finding":"no disk","cure":"add one"}]}"#;
        let (_folder, nims) = place(&format!("{}; echo '{finding}'; exit 1", &warnings[..warnings.len() - 8]));
        assert_eq!(doctor_by(&nims, Path::new("system.toml"), None, LONGEST).unwrap().len(), 1);
        let (_folder, nims) = place("exec sleep 1000000");
        let reason = doctor_by(&nims, Path::new("system.toml"), None, Duration::from_secs(1)).unwrap_err();
        assert!(format!("{reason:?}").contains("more than 1 s"), "{reason:?}");
    }

    #[test]
    fn the_machine_is_judged_by_the_limits_of_the_robot() {
        let (_folder, nims) = place(r#"printf '{"findings":[{"level":"note","finding":"%s","cure":""}]}' "$*""#);
        for (supervisor, pid) in [(Some(77), "77"), (None, "0")] {
            let rows = doctor_by(&nims, Path::new("system.toml"), supervisor, LONGEST).unwrap();
            assert_eq!(rows[0].finding, format!("--json doctor system.toml --limits-of {pid}"));
        }
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

    #[test]
    fn what_an_interrupted_deletion_leaves_is_removed_and_no_run() {
        let (folder, _) = place("");
        let runs = folder.path().join("runs");
        std::fs::rename(runs.join("done"), runs.join(".deleted-done")).unwrap();
        for other in ["deleted-x", ".other", "2026-01-01T10-00-00"] {
            std::fs::create_dir(runs.join(other)).unwrap();
        }
        sweep(&runs);
        let mut left: Vec<_> = std::fs::read_dir(&runs).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, [".other", "2026-01-01T10-00-00", "deleted-x"]);
        sweep(&folder.path().join("absent"));
    }
}
