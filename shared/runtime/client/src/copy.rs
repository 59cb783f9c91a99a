//! Copies of finished runs, whose folder is closed to this user.

use crate::link::Gateway;
use command::{Answer, Failure};
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// Bytes that are copied at once.
const PIECE: usize = 1 << 20;

/// Copies a finished run to a new folder through its gateway; returns the number of files and their bytes.
/// `progress` receives the bytes that are copied and those of all files.
///
/// # Errors
/// There is no such run, or a file cannot be copied whole.
pub fn copy_run(gateway: &Gateway, run: &str, dest: &Path, mut progress: impl FnMut(u64, u64)) -> Answer<(usize, u64)> {
    let files = gateway.files(run)?;
    let all: u64 = files.iter().map(|file| file.bytes).sum();
    // Under another name until it is whole.
    let part = with_ending(dest, ".part");
    let failed = |what: &Path, error: io::Error| Failure::NotNow(format!("{}: {error}", what.display()));
    begin(&part).map_err(|error| failed(&part, error))?;
    let mut done = 0;
    for file in &files {
        let to = part.join(safe(&file.name)?);
        let from = gateway.open(run, &file.name)?;
        if let Some(folder) = to.parent() {
            fs::create_dir_all(folder).map_err(|error| failed(folder, error))?;
        }
        let copied = copy(from, &to, |bytes| {
            done += bytes;
            progress(done, all);
        })
        .map_err(|error| failed(&to, error))?;
        if copied != file.bytes {
            return Err(Failure::NotNow(format!(
                "{} has {copied} bytes instead of {}; fetch the run again",
                to.display(),
                file.bytes
            )));
        }
    }
    fs::rename(&part, dest).map_err(|error| failed(dest, error))?;
    Ok((files.len(), all))
}

/// Creates the folder of a copy, without what an earlier attempt has left there.
fn begin(part: &Path) -> io::Result<()> {
    match fs::remove_dir_all(part) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    fs::create_dir_all(part)
}

/// Returns the path of a file below the destination.
fn safe(name: &str) -> Answer<&Path> {
    let path = Path::new(name);
    let plain = path.components().all(|part| matches!(part, std::path::Component::Normal(_)));
    if plain && !name.is_empty() {
        Ok(path)
    } else {
        Err(Failure::NotNow(format!("the gateway names a file {name:?}, which lies outside of the run")))
    }
}

fn copy(mut from: File, to: &Path, mut copied_piece: impl FnMut(u64)) -> io::Result<u64> {
    let mut into = File::create_new(to)?;
    let (mut piece, mut copied) = (vec![0; PIECE], 0);
    loop {
        let length = from.read(&mut piece)?;
        if length == 0 {
            into.sync_all()?;
            return Ok(copied);
        }
        into.write_all(&piece[..length])?;
        copied += length as u64;
        copied_piece(length as u64);
    }
}

fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_lands_in_the_folder_of_the_run_only() {
        assert_eq!(safe("log/motor-io.txt"), Ok(Path::new("log/motor-io.txt")));
        for name in ["", "/etc/passwd", "../x", "log/../../x"] {
            assert!(safe(name).is_err(), "{name}");
        }
    }

    #[test]
    fn a_copy_begins_without_the_remains_of_an_earlier_attempt() {
        let folder = tempfile::tempdir().unwrap();
        let part = folder.path().join("run.part");
        for _ in 0..2 {
            begin(&part).unwrap();
            assert_eq!(fs::read_dir(&part).unwrap().count(), 0);
            fs::create_dir(part.join("log")).unwrap();
            fs::write(part.join("log/motor-io.txt"), "half").unwrap();
        }
    }

    #[test]
    fn a_copy_is_the_same_and_never_replaces_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let (from, to) = (folder.path().join("from"), folder.path().join("to"));
        let bytes: Vec<u8> = (0..3_000_000_u32).map(|i| (i % 251) as u8).collect();
        fs::write(&from, &bytes).unwrap();
        let mut reported = 0;
        let copied = copy(File::open(&from).unwrap(), &to, |piece| reported += piece).unwrap();
        assert_eq!((copied, reported), (bytes.len() as u64, bytes.len() as u64));
        assert_eq!(fs::read(&to).unwrap(), bytes);
        assert!(copy(File::open(&from).unwrap(), &to, |_| {}).is_err());
    }
}
