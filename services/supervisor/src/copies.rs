//! The run's own copy of the configuration: every process of the run reads it, whenever it is started.
//!
//! An edit of the originals is for the next run. The supervisor holds the bytes too, so an edit of the copy changes nothing either.

use command::{Answer, Failure};
use config::RESOLVED;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Names that a run folder has for files of its own.
const RESERVED: [&str; 5] = ["box.toml", "mission.toml", "manifest.json", "set.toml", RESOLVED];
/// A larger file is no configuration, bytes; a motor table has some thousand.
const LARGEST: u64 = 16 << 20;

/// Files of a run folder, by their names.
#[derive(Debug, Clone, Default)]
pub struct Copies(BTreeMap<PathBuf, Vec<u8>>);

impl Copies {
    /// Takes a file in under the name that it will have in the run folder.
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
                "{} cannot be kept in the run folder, where another file is called {}: give it another name",
                original.display(),
                name.display()
            )));
        }
        self.0.insert(name.to_owned(), bytes);
        Ok(())
    }

    /// Takes a text in.
    pub fn add(&mut self, name: &str, text: String) {
        self.keep(name, text.into_bytes());
    }

    /// Takes the bytes of a file of the run folder's own in.
    pub fn keep(&mut self, name: &str, bytes: Vec<u8>) {
        self.0.insert(name.into(), bytes);
    }

    /// Writes all of them; what cannot be written, and why.
    pub fn write(&self, folder: &Path) -> Result<(), (PathBuf, io::Error)> {
        for (name, bytes) in &self.0 {
            let path = folder.join(name);
            fs::write(&path, bytes).map_err(|error| (path, error))?;
        }
        Ok(())
    }

    /// Writes those that are not as they were; which these are.
    pub fn put_back(&self, folder: &Path) -> Result<Vec<String>, (PathBuf, io::Error)> {
        let mut back = Vec::new();
        for (name, bytes) in &self.0 {
            let path = folder.join(name);
            if fs::read(&path).is_ok_and(|present| present == *bytes) {
                continue;
            }
            let made = fs::create_dir_all(folder).and_then(|()| super::archive::replace(&path, bytes));
            made.map_err(|error| (path, error))?;
            back.push(name.display().to_string());
        }
        Ok(back)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edited_or_deleted_copy_is_put_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut copies = Copies::default();
        copies.add("resolved.toml", "a = 1\n".to_owned());
        copies.add("robot.toml", "b = 1\n".to_owned());
        copies.write(folder.path()).unwrap();
        assert!(copies.put_back(folder.path()).unwrap().is_empty());
        fs::write(folder.path().join("robot.toml"), "b = 2\n").unwrap();
        fs::remove_file(folder.path().join("resolved.toml")).unwrap();
        assert_eq!(copies.put_back(folder.path()).unwrap(), ["resolved.toml", "robot.toml"]);
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
        for name in ["robot.toml", "box.toml"] {
            assert_eq!(copies.read(&other, Path::new(name)).unwrap_err().exit_code(), 2);
        }
    }
}
