//! Files of a run folder, and the free space of its disk.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rustix::fs::{FlockOperation, Mode, OFlags, flock};

use crate::{NotARunReason, RunError};

/// Ending of a finished file's name.
pub const FILE_ENDING: &str = ".mcap";
/// Ending of the name of a file that is being written, or whose writer ended without finishing it.
pub const PART_ENDING: &str = ".mcap.part";
/// Ending of the name, before `.mcap`, of a file recovered from a damaged one.
pub(crate) const RECOVERED_ENDING: &str = "-recovered";

/// True if a recorder or a recovery has locked the file.
pub(crate) fn is_held(path: &Path) -> bool {
    let Ok(file) = fs::File::open(path) else { return false };
    matches!(flock(&file, FlockOperation::NonBlockingLockShared), Err(rustix::io::Errno::WOULDBLOCK))
}

/// A recorder writes twice a second. Without a write for this long it does not record, even if it holds the lock, s.
const SILENT_S: u64 = 3;

/// Time since the last write, whole seconds; 0 below [`SILENT_S`].
pub(crate) fn silent_s(path: &Path) -> u64 {
    let written = fs::metadata(path).and_then(|file| file.modified()).ok();
    let since = written.and_then(|written| SystemTime::now().duration_since(written).ok());
    since.map(|since| since.as_secs()).filter(|seconds| *seconds >= SILENT_S).unwrap_or(0)
}

/// Bytes that an unprivileged process can still write at `path`. Where the folder does not exist, its nearest existing
/// ancestor counts.
///
/// # Errors
/// The file system returned an error.
pub fn free_bytes(path: &Path) -> Result<u64, RunError> {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let there = whole.ancestors().find(|folder| folder.exists()).unwrap_or(path);
    let state = rustix::fs::statvfs(there).map_err(|error| RunError::io(path, "query the free space")(error.into()))?;
    Ok(state.f_bavail.saturating_mul(state.f_frsize))
}

/// The run files of a folder in the order of writing: `run`, `run-0002`, ... A recovered file takes the place of the
/// damaged one. Other MCAP files beside them, such as a drawing of the run, are no part of it; a folder that has only
/// other names is read whole.
///
/// # Errors
/// The folder cannot be read, or contains no run file.
pub fn segments(folder: &Path) -> Result<Vec<PathBuf>, RunError> {
    let mut found: Vec<(String, PathBuf)> = fs::read_dir(folder)
        .map_err(RunError::io(folder, "read the folder"))?
        .filter_map(Result::ok)
        .filter_map(|entry| Some((stem(&entry.file_name())?, entry.path())))
        .collect();
    if found.is_empty() {
        return Err(RunError::not_a_run(folder, NotARunReason::NoFiles));
    }
    if found.iter().any(|(stem, _)| is_of_a_run(stem)) {
        found.retain(|(stem, _)| is_of_a_run(stem));
    }
    let of = |stem: &str| stem.strip_suffix(RECOVERED_ENDING).unwrap_or(stem).to_owned();
    let recovered: Vec<String> =
        found.iter().filter(|(stem, _)| stem.ends_with(RECOVERED_ENDING)).map(|(stem, _)| of(stem)).collect();
    found.retain(|(stem, _)| !recovered.contains(stem));
    found.sort_by_key(|(stem, path)| (of(stem), path.clone()));
    Ok(found.into_iter().map(|(_, path)| path).collect())
}

/// Whether a recorder or a recovery gives a file this name without its ending.
fn is_of_a_run(stem: &str) -> bool {
    let stem = stem.strip_suffix(RECOVERED_ENDING).unwrap_or(stem);
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|digit| digit.is_ascii_digit());
    stem == "run" || stem.strip_prefix("run-").is_some_and(is_number)
}

/// The final name of the next file of a run: `run.mcap`, then `run-0002.mcap`, ... Existing names, finished or not, are
/// skipped.
#[must_use]
pub fn next_file(folder: &Path) -> PathBuf {
    // The unfinished name is tested first: a file that another thread finishes in between then appears under its final
    // name. In the other order it is missed under both, and the new file would replace it.
    let free = |stem: &str| {
        !folder.join(format!("{stem}{PART_ENDING}")).exists() && !folder.join(format!("{stem}{FILE_ENDING}")).exists()
    };
    let stem = std::iter::once("run".to_owned())
        .chain((2..10_000).map(|number| format!("run-{number:04}")))
        .find(|stem| free(stem))
        .unwrap_or_else(|| format!("run-{}", std::process::id()));
    folder.join(format!("{stem}{FILE_ENDING}"))
}

/// Opens a run file for reading. Pipes and devices are rejected without blocking.
pub(crate) fn open_file(path: &Path) -> Result<fs::File, RunError> {
    let opened =
        rustix::fs::open(path, OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty());
    let file = fs::File::from(opened.map_err(|error| RunError::io(path, "open the run file")(error.into()))?);
    let kind = file.metadata().map_err(RunError::io(path, "read the run file"))?.file_type();
    if kind.is_file() { Ok(file) } else { Err(RunError::not_a_run(path, NotARunReason::NotRegular)) }
}

/// `NAME` of `NAME.mcap` or `NAME.mcap.part`.
pub(crate) fn stem(name: &OsStr) -> Option<String> {
    let name = name.to_str()?;
    let stem = name.strip_suffix(PART_ENDING).or_else(|| name.strip_suffix(FILE_ENDING))?;
    Some(stem.to_owned())
}

/// `NAME.mcap.part` for `NAME.mcap`.
pub(crate) fn part_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    PathBuf::from(name)
}

/// Makes a rename in this folder durable across a power cut.
pub(crate) fn sync_folder(file: &Path) -> Result<(), RunError> {
    let folder = file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::File::open(folder).and_then(|folder| folder.sync_all()).map_err(RunError::io(folder, "synchronise the folder"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::FileType;

    #[test]
    fn a_file_that_is_not_written_is_silent_after_some_seconds() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap.part");
        assert_eq!(silent_s(&path), 0, "no such file");
        fs::write(&path, "").unwrap();
        let file = fs::File::open(&path).unwrap();
        let now = SystemTime::now();
        file.set_modified(now - std::time::Duration::from_secs(30)).unwrap();
        assert!(silent_s(&path) >= 30);
        file.set_modified(now + std::time::Duration::from_secs(30)).unwrap();
        assert_eq!(silent_s(&path), 0, "the wall clock was set back");
    }

    #[test]
    fn a_file_that_is_being_finished_keeps_its_name() {
        const FILES: usize = 300;
        let folder = tempfile::tempdir().unwrap();
        let finals: Vec<PathBuf> = (0..FILES)
            .map(|_| {
                let path = next_file(folder.path());
                fs::write(part_of(&path), "").unwrap();
                path
            })
            .collect();
        let next = next_file(folder.path());
        std::thread::scope(|scope| {
            let finishing = scope.spawn(|| {
                for path in &finals {
                    fs::rename(part_of(path), path).unwrap();
                    std::thread::sleep(std::time::Duration::from_micros(50));
                }
            });
            while !finishing.is_finished() {
                assert_eq!(next_file(folder.path()), next);
            }
        });
    }

    #[test]
    fn files_come_in_the_order_of_writing_and_names_are_not_used_twice() {
        let folder = tempfile::tempdir().unwrap();
        let error = segments(folder.path()).unwrap_err();
        assert!(
            matches!(&error, RunError::NotARun { path, what: NotARunReason::NoFiles } if path == folder.path()),
            "{error}"
        );
        for expected in ["run", "run-0002", "run-0003"] {
            let path = next_file(folder.path());
            assert_eq!(path, folder.path().join(format!("{expected}.mcap")));
            fs::write(if expected == "run" { path } else { part_of(&path) }, "").unwrap();
        }
        fs::write(folder.path().join("system.toml"), "").unwrap();
        let names: Vec<_> =
            segments(folder.path()).unwrap().iter().map(|path| path.file_name().unwrap().to_owned()).collect();
        assert_eq!(names, ["run.mcap", "run-0002.mcap.part", "run-0003.mcap.part"]);
        for name in ["run-recovered.mcap", "run-0003-recovered.mcap"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let names: Vec<_> =
            segments(folder.path()).unwrap().iter().map(|path| path.file_name().unwrap().to_owned()).collect();
        assert_eq!(names, ["run-recovered.mcap", "run-0002.mcap.part", "run-0003-recovered.mcap"]);
        // What lies beside the run is no part of it.
        for name in ["visualization.mcap", "bag_0.mcap", "run-old.mcap", "other-recovered.mcap"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(segments(folder.path()).unwrap().len(), 3);
        let bags = tempfile::tempdir().unwrap();
        fs::write(bags.path().join("bag_0.mcap"), "").unwrap();
        assert_eq!(segments(bags.path()).unwrap(), [bags.path().join("bag_0.mcap")]);
        rustix::fs::mknodat(rustix::fs::CWD, folder.path().join("pipe.mcap"), FileType::Fifo, Mode::RWXU, 0).unwrap();
        for path in [folder.path().join("pipe.mcap"), folder.path().to_path_buf(), "/dev/zero".into()] {
            let opened = open_file(&path);
            assert!(
                matches!(opened, Err(RunError::NotARun { what: NotARunReason::NotRegular, .. })),
                "{}",
                path.display()
            );
        }
        assert!(free_bytes(folder.path()).unwrap() > 0);
        let removed = folder.path().join("removed/by/hand");
        assert!(free_bytes(&removed).unwrap() > 0, "a removed folder does not count as a full disk");
    }
}
