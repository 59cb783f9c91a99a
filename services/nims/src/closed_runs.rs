//! `nims report` and `nims info` of finished runs whose folder is closed to this user: read through the descriptors
//! that the gateway hands out, into a folder that exists as long as the command.

use crate::fetch::show_progress;
use analysis::{Command, report};
use client::{Gateway, Place};
use command::{Answer, Output};
use rustix::fs::{Access, access};
use rustix::io::Errno;
use std::path::{Path, PathBuf};

/// Runs a command for recorded runs.
///
/// # Errors
/// Those of the command; of a run that is not here and not at the gateway, those of its path.
pub fn run(place: Place<'_>, command: &Command) -> Answer<Output> {
    match command {
        Command::Report(args) => {
            let Some(copies) = Copies::of(place, &args.runs)? else { return command.run() };
            // The folder of the run is closed to the page too.
            let name = match &args.runs[..] {
                [one] => format!("{}.html", name_of(one)),
                _ => "comparison.html".to_owned(),
            };
            let out = args.out.clone().or_else(|| Some(PathBuf::from(name)));
            Command::Report(report::Args { runs: copies.paths, out, ..args.clone() }).run()
        }
        Command::Info { run } => {
            let Some(mut copies) = Copies::of(place, std::slice::from_ref(run))? else { return command.run() };
            Command::Info { run: copies.paths.remove(0) }.run()
        }
        other => other.run(),
    }
}

/// Runs as they can be read here.
struct Copies {
    paths: Vec<PathBuf>,
    /// Removed at the end.
    _folder: tempfile::TempDir,
}

impl Copies {
    /// Copies the runs that cannot be read here; `None` if there are none, or no gateway has them.
    fn of(place: Place<'_>, runs: &[PathBuf]) -> Answer<Option<Self>> {
        let closed: Vec<&PathBuf> = runs.iter().filter(|run| is_closed(run)).collect();
        if closed.is_empty() {
            return Ok(None);
        }
        // Without a gateway the command names the path that it cannot read.
        let Ok(gateway) = client::gateway(place) else { return Ok(None) };
        let known = known(&gateway)?;
        if !closed.iter().all(|run| known.iter().any(|name| *name == name_of(run))) {
            return Ok(None);
        }
        let folder = command::large_temporary_folder()?;
        let mut paths = Vec::new();
        for run in runs {
            if is_closed(run) {
                let copy = folder.path().join(name_of(run));
                client::copy_run(&gateway, &name_of(run), &copy, show_progress())?;
                paths.push(copy);
            } else {
                paths.push(run.clone());
            }
        }
        Ok(Some(Self { paths, _folder: folder }))
    }
}

fn known(gateway: &Gateway) -> Answer<Vec<String>> {
    Ok(gateway.runs()?.into_iter().map(|run| run.name).collect())
}

/// The last part of a path, which is the name of a run at its gateway.
fn name_of(run: &Path) -> String {
    run.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns whether a path leads nowhere for this user: there is nothing, or its folder is closed. Nothing is opened: it
/// may be a pipe.
fn is_closed(run: &Path) -> bool {
    let mode = if run.is_dir() { Access::READ_OK | Access::EXEC_OK } else { Access::READ_OK };
    matches!(access(run, mode), Err(Errno::NOENT | Errno::ACCESS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_this_user_cannot_read_is_asked_of_a_gateway() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.mcap");
        assert!(is_closed(&file));
        std::fs::write(&file, "x").unwrap();
        assert!(!is_closed(&file) && !is_closed(folder.path()));
        assert_eq!(name_of(Path::new("runs/2026-01-01")), "2026-01-01");
    }
}
