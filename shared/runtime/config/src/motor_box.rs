//! `[motor_box]`: the table of the virtual motor box, which this crate keeps and does not interpret.
//!
//! The table describes what is true and not what the control software assumes. Its types are in `motor-box`, which the
//! processes of the control chain do not link, and their copies of the configuration have an empty table.

use crate::file::join_normalized;
use crate::toml_file::{ConfigError, Source};
use crate::{Problem, SystemFile};
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
            Source::of("the system file".into(), toml::to_string(&file).unwrap_or_default())
        };
        self.source.as_ref().map_or_else(of_table, |source| (**source).clone())
    }
}

impl SystemFile {
    /// Returns this configuration without the content of `[motor_box]`, for every process except the virtual motor
    /// box. The empty table still states that the drives are virtual.
    #[must_use]
    pub fn without_truth(&self) -> Self {
        Self { motor_box: self.motor_box.as_ref().map(|_| MotorBoxTable::default()), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Example {
        supply_v: f64,
    }

    fn loaded(table: &str) -> SystemFile {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs");
        let text = std::fs::read_to_string(configs.join("systems/demo3.toml")).unwrap();
        let (before, _) = text.split_once("[motor_box]").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let robot = configs.join("robots/lab3.toml").canonicalize().unwrap();
        let before = before.replace("../robots/lab3.toml", &robot.to_string_lossy());
        let path = folder.path().join("system.toml");
        std::fs::write(&path, format!("{before}[motor_box]\n{table}")).unwrap();
        SystemFile::load(&path).unwrap()
    }

    #[test]
    fn any_content_is_kept_and_read_with_the_type_of_another_crate() {
        let file = loaded("supply_v = 24.0\n");
        let table = file.motor_box.clone().unwrap();
        assert_eq!(table.section::<Example>().unwrap().supply_v, 24.0);
        let kept = file.resolved("robot.toml").unwrap();
        assert!(kept.contains("[motor_box]\nsupply_v = 24.0"), "{kept}");
        let folder = table.path(Path::new("x")).parent().unwrap().to_owned();
        let ground = loaded("ground = \"../g.toml\"\n").motor_box.unwrap().ground().unwrap();
        assert_eq!((ground.file_name(), folder.is_absolute()), (Some("g.toml".as_ref()), true));
    }

    #[test]
    fn an_error_in_the_table_names_file_and_line() {
        let file = loaded("# a comment\nsuply_v = 24.0\n");
        let error = file.motor_box.clone().unwrap().section::<Example>().unwrap_err();
        let ConfigError::Text { path, line, problem, .. } = &error else { panic!("{error}") };
        let expected = file.motor_box.as_ref().unwrap().source.as_ref().unwrap().text().lines().count();
        assert!(path.ends_with("system.toml") && *line == expected, "{error}");
        assert!(problem.contains("`suply_v`") && problem.contains("`supply_v`"), "{problem}");
        let named = loaded("supply_v = 99.0\n").motor_box.unwrap().error(&Problem::of("motor_box.supply_v", "is 99"));
        assert!(named.to_string().ends_with("`motor_box.supply_v` is 99") && named.to_string().contains(", line "));
    }

    #[test]
    fn a_copy_without_the_truth_says_only_that_the_drives_are_virtual() {
        let file = loaded("supply_v = 24.0\n[motor_box.truth]\nnode_mass_kg = 1.3\n").without_truth();
        let text = file.resolved("robot.toml").unwrap();
        assert!(text.contains("[motor_box]") && !text.contains("supply_v = 24") && !text.contains("truth"), "{text}");
        let read: SystemFile = toml::from_str(&text).unwrap();
        assert!(read.motor_box.is_some());
    }
}
