//! Finished runs: their list, and descriptors of their files that can only be read.
//!
//! No name of a client is opened as it was given: a run and a file must be in the list that was just read, and the file
//! is opened below the folder of the runs without following links.

use gateway_protocol::{DiskFigures, FileRow, RunRow};
use rustix::fs::{CWD, Mode, OFlags, openat};
use std::fs;
use std::os::fd::OwnedFd;
use std::path::{Component, Path};

/// Deepest folder below a run, and largest number of files of a run: more than any run has.
const DEPTH: usize = 4;
const FILES: usize = 4096;
/// Largest number of runs in a list.
const RUNS: usize = 8192;
/// The quota of an installation, and the folder that it is for (`configs/host/nims-runs.service`).
const QUOTA: &str = "/etc/nims/quota";
const QUOTA_RUNS: &str = "/var/lib/nims/runs";
/// File that every run has.
const MANIFEST: &str = "manifest.json";

/// Returns the finished runs by name; `present`: the run folder of the robot that runs.
#[must_use]
pub fn list(runs: &Path, present: Option<&Path>) -> Vec<RunRow> {
    let mut names: Vec<String> = fs::read_dir(runs)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort();
    let row = |name: String| {
        let files = files(runs, present, &name)?;
        Some(RunRow { files: files.len(), bytes: files.iter().map(|file| file.bytes).sum(), name })
    };
    // The newest ones, because a name begins with its time.
    let mut rows: Vec<RunRow> = names.into_iter().rev().filter_map(row).take(RUNS).collect();
    rows.reverse();
    rows
}

/// Returns the files of a finished run; `None` if there is no such run, or if it is being recorded.
#[must_use]
pub fn files(runs: &Path, present: Option<&Path>, run: &str) -> Option<Vec<FileRow>> {
    if run.is_empty() || run.starts_with('.') || run.contains('/') {
        return None;
    }
    let folder = runs.join(run);
    let is_present = || {
        let same = |present: &Path| present.canonicalize().ok() == folder.canonicalize().ok();
        present.is_some_and(same)
    };
    let is_folder = fs::symlink_metadata(&folder).is_ok_and(|found| found.is_dir());
    if !is_folder || is_present() {
        return None;
    }
    let mut files = Vec::new();
    collect(&folder, "", DEPTH, &mut files);
    let has = |name: &str| files.iter().any(|file| file.name == name);
    let ends = |ending: &str| files.iter().any(|file| file.name.ends_with(ending));
    if !has(MANIFEST) || !ends(runlog::FILE_ENDING) || ends(runlog::PART_ENDING) {
        return None;
    }
    files.sort_by(|a, b| a.name.cmp(&b.name));
    Some(files)
}

fn collect(folder: &Path, before: &str, depth: usize, files: &mut Vec<FileRow>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let (Ok(name), Ok(found)) = (entry.file_name().into_string(), entry.metadata()) else { continue };
        if name.starts_with('.') || files.len() >= FILES {
            continue;
        }
        let name = format!("{before}{name}");
        if found.is_dir() && depth > 0 {
            collect(&entry.path(), &format!("{name}/"), depth - 1, files);
        } else if found.is_file() {
            files.push(FileRow { name, bytes: found.len() });
        }
    }
}

/// Returns the disk on which the runs are.
#[must_use]
pub fn disk(runs: &Path) -> Option<DiskFigures> {
    let found = rustix::fs::statvfs(runs).ok()?;
    let quota = (runs == Path::new(QUOTA_RUNS)).then(|| quota(&fs::read_to_string(QUOTA).ok()?)).flatten();
    Some(DiskFigures { total: found.f_blocks * found.f_frsize, free: found.f_bavail * found.f_frsize, quota })
}

/// The quota in a text like `RUNS_MAX_GB=20`, bytes; none for 0.
fn quota(text: &str) -> Option<u64> {
    let mut lines = text.lines().filter_map(|line| line.trim().strip_prefix("RUNS_MAX_GB="));
    let gb: u64 = lines.next_back()?.trim().parse().ok()?;
    gb.checked_mul(1_000_000_000).filter(|bytes| *bytes > 0)
}

/// Opens a file of a finished run for reading; returns its size too.
///
/// # Errors
/// The file cannot be opened.
pub fn open(runs: &Path, run: &str, file: &FileRow) -> std::io::Result<(OwnedFd, u64)> {
    // Part by part: `openat2` could resolve it below the folder at once, but a service with RestrictSUIDSGID= has none.
    let folder = OFlags::DIRECTORY | OFlags::RDONLY | OFlags::CLOEXEC;
    let mut within = openat(CWD, runs, folder, Mode::empty())?;
    let mut parts = Path::new(run).join(&file.name);
    let name = parts.file_name().map(ToOwned::to_owned).unwrap_or_default();
    parts.pop();
    for part in parts.components() {
        let Component::Normal(part) = part else { return Err(std::io::Error::other("it is outside of the run")) };
        within = openat(&within, part, folder | OFlags::NOFOLLOW, Mode::empty())?;
    }
    let flags = OFlags::RDONLY | OFlags::CLOEXEC | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::NOFOLLOW;
    let opened = openat(&within, &name, flags, Mode::empty())?;
    let found = rustix::fs::fstat(&opened)?;
    if !rustix::fs::FileType::from_raw_mode(found.st_mode).is_file() {
        return Err(std::io::Error::other("it is no regular file"));
    }
    Ok((opened, found.st_size.cast_unsigned()))
}

/// Reads the files of the configuration of a run: its TOML files, at most `most` bytes in all.
///
/// # Errors
/// One sentence: what cannot be read.
pub fn configuration(run: &Path, most: u64) -> Result<(Vec<FileRow>, Vec<u8>), String> {
    let unreadable = |why: String| format!("the configuration of the run {} cannot be read: {why}", run.display());
    let entries = fs::read_dir(run).map_err(|error| unreadable(error.to_string()))?;
    let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| name.ends_with(".toml")).collect();
    // The system file first, so that it is there even if the rest is too long.
    names.sort_by_key(|name| (name != config::RESOLVED, name.clone()));
    let (mut files, mut body) = (Vec::new(), Vec::new());
    for name in names {
        let bytes = config::file::read(&run.join(&name)).map_err(|error| unreadable(format!("{name}: {error}")))?;
        if (body.len() + bytes.len()) as u64 > most {
            return Err(unreadable(format!("it has more than {} MB", most >> 20)));
        }
        files.push(FileRow { name, bytes: bytes.len() as u64 });
        body.extend(bytes);
    }
    Ok((files, body))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::os::unix::fs::symlink;

    fn run(runs: &Path, name: &str, files: &[&str]) {
        for file in files {
            let path = runs.join(name).join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, *file).unwrap();
        }
    }

    #[test]
    fn the_quota_is_that_of_the_installation() {
        let file = include_str!("../../../configs/host/quota");
        assert_eq!(quota(file), None);
        assert_eq!(quota(&file.replace("GB=0", "GB=20")), Some(20_000_000_000));
        assert_eq!([quota(""), quota("RUNS_MAX_GB=much"), quota("# RUNS_MAX_GB=20")], [None; 3]);
        assert!(include_str!("../../../configs/host/nims-runs.service").contains(&format!(" {QUOTA_RUNS} ")));
    }

    #[test]
    fn only_finished_runs_are_listed_and_only_their_files_opened() {
        let folder = tempfile::tempdir().unwrap();
        let runs = folder.path().join("runs");
        run(&runs, "done", &["manifest.json", "run.mcap", "log/motor-io.txt"]);
        run(&runs, "recorded", &["manifest.json", "run.mcap", "run-0002.mcap.part"]);
        run(&runs, "present", &["manifest.json", "run.mcap"]);
        run(&runs, "other", &["notes.txt"]);
        fs::write(folder.path().join("secret"), "secret").unwrap();
        symlink(folder.path().join("secret"), runs.join("done/link.mcap")).unwrap();
        symlink(runs.join("done"), runs.join("linked")).unwrap();
        let present = runs.join("present");
        let listed = list(&runs, Some(&present));
        assert_eq!(listed.iter().map(|run| run.name.as_str()).collect::<Vec<_>>(), ["done"]);
        let found = files(&runs, None, "done").unwrap();
        let names: Vec<&str> = found.iter().map(|file| file.name.as_str()).collect();
        assert_eq!(names, ["log/motor-io.txt", "manifest.json", "run.mcap"]);
        for name in ["", ".", "..", "../runs/done", "done/", "/etc", "linked", "present", "recorded", "other"] {
            assert!(files(&runs, Some(&present), name).is_none(), "{name}");
        }
        for file in &found {
            let (opened, bytes) = open(&runs, "done", file).unwrap();
            let mut text = String::new();
            fs::File::from(opened).read_to_string(&mut text).unwrap();
            assert_eq!((text.as_str(), text.len() as u64), (file.name.as_str(), bytes));
        }
        symlink(runs.join("done/log"), runs.join("done/way")).unwrap();
        // Even a name that is not from the list leads nowhere else.
        for name in ["", "..", "log/..", "way/motor-io.txt", "link.mcap", "../other/notes.txt", "/etc/passwd", "log"] {
            let file = FileRow { name: name.to_owned(), bytes: 0 };
            let opened = open(&runs, "done", &file);
            assert!(opened.is_err(), "{name}");
        }
        let outside = FileRow { name: "../../secret".to_owned(), bytes: 0 };
        assert!(open(&runs, "done", &outside).is_err());
    }

    #[test]
    fn a_descriptor_cannot_be_written() {
        use std::io::Write;
        let folder = tempfile::tempdir().unwrap();
        run(folder.path(), "done", &["manifest.json", "run.mcap"]);
        let file = FileRow { name: "run.mcap".to_owned(), bytes: 0 };
        let (opened, _) = open(folder.path(), "done", &file).unwrap();
        assert!(fs::File::from(opened).write_all(b"x").is_err());
    }

    #[test]
    fn a_configuration_is_bounded() {
        let folder = tempfile::tempdir().unwrap();
        run(folder.path(), "run", &["resolved.toml", "robot.toml", "run.mcap"]);
        let (files, body) = configuration(&folder.path().join("run"), 100).unwrap();
        assert_eq!(files.iter().map(|file| file.name.as_str()).collect::<Vec<_>>(), ["resolved.toml", "robot.toml"]);
        assert_eq!(body, b"resolved.tomlrobot.toml");
        assert!(configuration(&folder.path().join("run"), 15).is_err());
    }
}
