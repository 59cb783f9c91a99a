//! Kinds of configuration files, recognised by the keys that only one of them has.

use crate::toml_file::{ConfigError, Source};

/// Kind of a configuration file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// A robot file: `[robot]`.
    Robot,
    /// A system file: `[motor_io]`, or the path of a robot file as `robot`.
    System,
    /// A mission file: `[[leg]]`.
    Mission,
    /// A sensor file: `port`.
    Sensor,
    /// A ground file: `ground_m`, `[[cylinder]]` or `[[prism]]`.
    Ground,
}

impl FileKind {
    /// Returns the kind of a file with these keys, if any kind has them.
    #[must_use]
    pub fn from_table(table: &toml::Table) -> Option<Self> {
        let robot = table.get("robot");
        if table.contains_key("leg") {
            Some(Self::Mission)
        } else if table.contains_key("motor_io") || robot.is_some_and(toml::Value::is_str) {
            Some(Self::System)
        } else if robot.is_some_and(toml::Value::is_table) {
            Some(Self::Robot)
        } else if table.contains_key("port") {
            Some(Self::Sensor)
        } else if ["ground_m", "cylinder", "prism"].iter().any(|key| table.contains_key(*key)) {
            Some(Self::Ground)
        } else {
            None
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Robot => "robot file",
            Self::System => "system file",
            Self::Mission => "mission file",
            Self::Sensor => "sensor file",
            Self::Ground => "ground file",
        }
    }

    /// What to give instead of a file of another kind.
    fn cure(self) -> &'static str {
        match self {
            Self::Robot => "give the robot file that a system file names as `robot`, like those in configs/robots",
            Self::System => "give a system file, which names its robot file as `robot`, like those in configs/systems",
            Self::Mission | Self::Sensor | Self::Ground => "give another file",
        }
    }

    /// Rejects a file of another kind. Without this its first foreign key would be reported as unknown.
    ///
    /// # Errors
    /// [`ConfigError::OfAnotherKind`].
    pub(crate) fn expect(self, source: &Source) -> Result<(), ConfigError> {
        // A text that is no TOML is reported with its line where it is parsed.
        let found = source.parse().ok().and_then(|table| Self::from_table(&table));
        match found.filter(|found| *found != self) {
            None => Ok(()),
            Some(found) => {
                let path = source.path().to_owned();
                Err(ConfigError::OfAnotherKind { path, found: found.name(), wanted: self.name(), cure: self.cure() })
            }
        }
    }
}
