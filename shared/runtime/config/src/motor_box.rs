//! `[motor_box]`: the table of the virtual motor box, which this crate keeps and does not interpret.
//!
//! The table describes what is true and not what the control software assumes. Its types are in `motor-box`, which the
//! processes of the control chain do not link, and their copies of the configuration have an empty table.

use crate::Problem;
use crate::file::join_normalized;
use crate::toml_file::{ConfigError, Source};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::{Table, Value};

/// Name of the table in a system file.
const NAME: &str = "motor_box";
/// Key of the ground file, which a run folder copies.
const GROUND: &str = "ground";

/// The table `[motor_box]` as written. Only its presence has a meaning here: the drives are virtual.
#[derive(Clone, Default, Deserialize, Serialize)]
#[serde(transparent)]
pub struct MotorBoxTable {
    table: Table,
    /// The text of its file, so that errors name the line.
    #[serde(skip)]
    source: Option<Arc<Source>>,
}

impl fmt::Debug for MotorBoxTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.table.fmt(f)
    }
}

/// A system file of which only one table is of interest.
#[derive(Deserialize)]
struct Only<T> {
    motor_box: T,
}

impl MotorBoxTable {
    pub(crate) fn set_source(&mut self, source: &Source) {
        self.source = Some(Arc::new(source.clone()));
    }

    /// Reads the table as `T`. For the virtual motor box, and for tools that prepare or judge its world.
    ///
    /// # Errors
    /// [`ConfigError::Text`], with file and line.
    pub fn section<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        self.source().parse::<Only<T>>().map(|file| file.motor_box)
    }

    /// Returns whether the table states a key itself.
    #[must_use]
    pub fn states(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// Adds file and line to a problem with a key `motor_box.KEY`.
    #[must_use]
    pub fn error(&self, problem: &Problem) -> ConfigError {
        self.source().error(problem)
    }

    /// Returns a path of this table, independent of the folder of the system file.
    #[must_use]
    pub fn path(&self, path: &Path) -> PathBuf {
        let file = self.source.as_ref().map_or(Path::new(""), |source| source.path());
        join_normalized(file.parent().unwrap_or(Path::new("")), path)
    }

    /// Returns the path of the ground file, if the table names one.
    #[must_use]
    pub fn ground(&self) -> Option<PathBuf> {
        self.table.get(GROUND).and_then(Value::as_str).map(|path| self.path(Path::new(path)))
    }

    /// Returns the table with another path of the ground file, if it names one.
    pub(crate) fn with_ground(mut self, path: &str) -> Self {
        if let Some(ground) = self.table.get_mut(GROUND) {
            *ground = Value::String(path.to_owned());
            self.source = None;
        }
        self
    }

    fn source(&self) -> Source {
        let of_table = || {
            let file = Table::from_iter([(NAME.to_owned(), Value::Table(self.table.clone()))]);
            Source::from_text("the system file".into(), toml::to_string(&file).unwrap_or_default())
        };
        self.source.as_ref().map_or_else(of_table, |source| (**source).clone())
    }
}
