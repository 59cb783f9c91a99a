//! The run's copy of the configuration: every process of the run reads it, no matter when it is started.
//!
//! An edit of the originals takes effect in the next run. The supervisor holds the content and restores edited copies.

use command::{Answer, Failure};
use config::{MOTOR_BOX, RESOLVED};
use runlog::SYSTEM_FILE;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Names that the run folder uses for its own files.
const RESERVED: [&str; 6] = [SYSTEM_FILE, "mission.toml", "manifest.json", "set.toml", RESOLVED, MOTOR_BOX];
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

    /// Restores files that were changed or removed, and returns their names.
    ///
    /// # Errors
    /// The path that cannot be written, and why.
    pub fn restore(&self, folder: &Path) -> Result<Vec<String>, (PathBuf, io::Error)> {
        let mut restored = Vec::new();
        for (name, bytes) in &self.0 {
            let path = folder.join(name);
            if fs::read(&path).is_ok_and(|present| present == *bytes) {
                continue;
            }
            let made = fs::create_dir_all(folder).and_then(|()| super::archive::replace(&path, bytes));
            made.map_err(|error| (path, error))?;
            restored.push(name.display().to_string());
        }
        Ok(restored)
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
        assert!(copies.restore(folder.path()).unwrap().is_empty());
        fs::write(folder.path().join("robot.toml"), "b = 2\n").unwrap();
        fs::remove_file(folder.path().join("resolved.toml")).unwrap();
        assert_eq!(copies.restore(folder.path()).unwrap(), ["resolved.toml", "robot.toml"]);
        assert_eq!(fs::read_to_string(folder.path().join("robot.toml")).unwrap(), "b = 1\n");
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
