//! The run's copy of the configuration: every process of the run reads it, no matter when it is started.
//!
//! An edit of the originals takes effect in the next run. The supervisor holds the content and restores edited copies.

use command::{Answer, Failure};
use config::file::replace;
use config::{MOTOR_BOX, RESOLVED};
use runlog::SYSTEM_FILE;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::{fs, io};

/// Names that the run folder uses for its own files.
const RESERVED: [&str; 6] = [SYSTEM_FILE, "mission.toml", MANIFEST, "set.toml", RESOLVED, MOTOR_BOX];
/// The manifest of a run; its presence marks a complete folder.
pub const MANIFEST: &str = "manifest.json";
/// Largest configuration file, bytes; a motor table has a few thousand.
const LARGEST: u64 = 16 << 20;

/// Contents of the copied files, by file name.
#[derive(Debug, Clone, Default)]
pub struct Copies(BTreeMap<PathBuf, Vec<u8>>);

impl Copies {
    /// Adds a file under the name that it gets in the run folder.
    ///
    /// # Errors
    /// It cannot be read, or the name is taken.
    pub fn read(&mut self, original: &Path, name: &Path) -> Answer {
        let unreadable =
            |why: String| Failure::BadInput(format!("the file {} cannot be read: {why}", original.display()));
        let size = fs::metadata(original).map_err(|error| unreadable(error.to_string()))?.len();
        if size > LARGEST {
            return Err(unreadable(format!("it has {size} bytes, and a configuration has at most {LARGEST}")));
        }
        let bytes = fs::read(original).map_err(|error| unreadable(error.to_string()))?;
        let own = RESERVED.iter().any(|taken| name == Path::new(taken));
        if own || self.0.get(name).is_some_and(|other| *other != bytes) {
            return Err(Failure::BadInput(format!(
                "{} cannot be copied to the run folder, where another file has the name {}: rename it",
                original.display(),
                name.display()
            )));
        }
        self.0.insert(name.to_owned(), bytes);
        Ok(())
    }

    /// The text of a copy.
    #[must_use]
    pub fn text(&self, name: &str) -> Option<String> {
        self.0.get(Path::new(name)).map(|bytes| String::from_utf8_lossy(bytes).into_owned())
    }

    /// Adds a text.
    pub fn add(&mut self, name: &str, text: String) {
        self.insert(name, text.into_bytes());
    }

    /// Adds the content of one of the run folder's own files.
    pub fn insert(&mut self, name: &str, bytes: Vec<u8>) {
        self.0.insert(name.into(), bytes);
    }

    /// Writes all files.
    ///
    /// # Errors
    /// The path that cannot be written, and why.
    pub fn write(&self, folder: &Path) -> Result<(), (PathBuf, io::Error)> {
        for (name, bytes) in &self.0 {
            let path = folder.join(name);
            fs::write(&path, bytes).map_err(|error| (path, error))?;
        }
        Ok(())
    }
}

/// Copies of a run that threads restore: a disk can block one of them while the supervisor changes the content.
#[derive(Debug, Clone, Default)]
pub struct SharedCopies(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    /// Never locked during file work.
    copies: Mutex<Copies>,
    /// Held by the thread that restores or changes files: two would replace each other's temporary files, and one could
    /// restore the text from before a change.
    writing: Mutex<()>,
}

impl SharedCopies {
    /// Shares the copies of a run.
    #[must_use]
    pub fn new(copies: Copies) -> Self {
        Self(Arc::new(Shared { copies: Mutex::new(copies), writing: Mutex::default() }))
    }

    /// Reads or changes the content.
    pub fn with<T>(&self, act: impl FnOnce(&mut Copies) -> T) -> T {
        act(&mut self.0.copies.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// As long as the result lives, no other thread restores or changes these files.
    pub fn alone(&self) -> MutexGuard<'_, ()> {
        self.0.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Restores files in the run folder that were changed or removed.
    #[must_use]
    pub fn restore(&self, run: &Path) -> Restored {
        let _alone = self.alone();
        let gone = !run.join(MANIFEST).exists();
        let names: Vec<PathBuf> = self.with(|copies| copies.0.keys().cloned().collect());
        let mut restored = Vec::new();
        for name in names {
            let path = run.join(&name);
            // Its present content, for a thread that was blocked on the file before.
            let Some(bytes) = self.with(|copies| copies.0.get(&name).cloned()) else { continue };
            if fs::read(&path).is_ok_and(|present| present == bytes) {
                continue;
            }
            match fs::create_dir_all(run).and_then(|()| replace(&path, &bytes)) {
                Ok(()) => restored.push(name.display().to_string()),
                Err(error) => return Restored { gone, back: Err((path, error)) },
            }
        }
        Restored { gone, back: Ok(restored) }
    }
}

/// What was restored in a run folder.
#[derive(Debug)]
pub struct Restored {
    /// The folder was removed or moved: nims never removes its manifest.
    pub gone: bool,
    /// Names of the restored files, or the path that cannot be written, and why.
    pub back: Result<Vec<String>, (PathBuf, io::Error)>,
}

impl Restored {
    /// The warning; `None` if the folder was as it should be.
    #[must_use]
    pub fn sentence(&self, run: &Path) -> Option<String> {
        match &self.back {
            Ok(back) if back.is_empty() => None,
            Ok(back) if self.gone => Some(format!(
                "the run folder {} was removed or moved while the robot runs and is made again, with {}",
                run.display(),
                back.join(", ")
            )),
            Ok(back) => Some(format!(
                "{} in the run folder was changed while the robot runs and has been restored; edit the original for the next run",
                back.join(", ")
            )),
            Err((path, error)) => Some(format!("{} cannot be written: {error}", path.display())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edited_or_deleted_copy_is_restored() {
        let folder = tempfile::tempdir().unwrap();
        let mut copies = Copies::default();
        copies.add("resolved.toml", "a = 1\n".to_owned());
        copies.add("robot.toml", "b = 1\n".to_owned());
        copies.write(folder.path()).unwrap();
        fs::write(folder.path().join(MANIFEST), "{}").unwrap();
        let copies = SharedCopies::new(copies);
        let restored = copies.restore(folder.path());
        assert!(restored.sentence(folder.path()).is_none() && !restored.gone, "{restored:?}");
        fs::write(folder.path().join("robot.toml"), "b = 2\n").unwrap();
        fs::remove_file(folder.path().join("resolved.toml")).unwrap();
        let restored = copies.restore(folder.path());
        assert_eq!(restored.back.as_deref().unwrap(), ["resolved.toml", "robot.toml"]);
        let said = restored.sentence(folder.path()).unwrap();
        assert!(said.contains("resolved.toml, robot.toml") && !said.contains("removed"), "{said}");
        assert_eq!(fs::read_to_string(folder.path().join("robot.toml")).unwrap(), "b = 1\n");
        let gone = folder.path().join("gone");
        assert!(copies.restore(&gone).gone && gone.join("robot.toml").is_file());
    }

    #[test]
    fn a_disk_that_blocks_the_repair_does_not_block_a_change() {
        let folder = tempfile::tempdir().unwrap();
        let copies = SharedCopies::default();
        copies.with(|copies| copies.add("set.toml", "a = 1\n".to_owned()));
        // Nothing writes to the pipe, so the thread waits for its content.
        let pipe = folder.path().join("set.toml");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let (of_thread, run) = (copies.clone(), folder.path().to_path_buf());
        let repair = std::thread::spawn(move || of_thread.restore(&run));
        copies.with(|copies| copies.add("set.toml", "a = 2\n".to_owned()));
        drop(fs::OpenOptions::new().write(true).open(&pipe).unwrap());
        assert!(repair.join().unwrap().back.is_ok());
        assert!(copies.restore(folder.path()).back.is_ok());
        assert_eq!(fs::read_to_string(&pipe).unwrap(), "a = 2\n");
    }

    #[test]
    fn two_files_cannot_have_one_name() {
        let folder = tempfile::tempdir().unwrap();
        let (one, other) = (folder.path().join("one"), folder.path().join("other"));
        fs::write(&one, "1").unwrap();
        fs::write(&other, "2").unwrap();
        let mut copies = Copies::default();
        copies.read(&one, Path::new("robot.toml")).unwrap();
        copies.read(&one, Path::new("robot.toml")).unwrap();
        for name in ["robot.toml", "system.toml"] {
            assert_eq!(copies.read(&other, Path::new(name)).unwrap_err().exit_code(), 2);
        }
    }
}
