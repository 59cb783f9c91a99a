//! A file of measurements on the disk: the whole state of a dialogue.

use command::{Answer, Failure};
use config::{FileKind, file};
use serde::de::DeserializeOwned;
use std::path::Path;

/// File of measurements on the disk.
pub struct Stored<'a> {
    path: &'a Path,
    /// Text as last read or written; `None` if the file does not exist.
    pub text: Option<String>,
}

impl<'a> Stored<'a> {
    /// Reads the file if it exists.
    pub fn open(path: &'a Path) -> Answer<Self> {
        let there = |why: String| Failure::bad(format!("{}: {why}", path.display()));
        let text = file::read_text_if_there(path).map_err(|why| there(format!("it cannot be read: {why}")))?;
        if path.file_name().is_none() || !file::folder_of(path).is_dir() {
            return Err(there("its folder does not exist; create it first".to_owned()));
        }
        Ok(Self { path, text })
    }

    /// The measurements of this kind; None if the file does not exist.
    ///
    /// # Errors
    /// The file cannot be parsed, or is of another kind.
    pub fn file<T: DeserializeOwned>(&self, kind: FileKind) -> Answer<Option<T>> {
        let parsed = self.text.as_ref().map(|text| {
            kind.expect_text(self.path, text)?;
            config::toml_file::parse(text, self.path)
        });
        parsed.transpose().map_err(Failure::bad)
    }

    /// Writes the text of the measurements atomically and syncs it to the disk.
    pub fn save(&mut self, text: String) -> Answer {
        let cannot = |why: String| {
            Failure::NotNow(format!(
                "{} cannot be written ({why}); it contains the answers before this one",
                self.path.display()
            ))
        };
        let there = file::read_text_if_there(self.path).map_err(|why| cannot(why.to_string()))?;
        if there != self.text {
            return Err(cannot(
                "another program changed it; run the command again to continue with that version".to_owned(),
            ));
        }
        file::replace(self.path, &text).map_err(|error| cannot(error.to_string()))?;
        self.text = Some(text);
        Ok(())
    }
}
