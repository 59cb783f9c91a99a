//! Kinds of configuration files, recognised by the keys that only one of them has.

use crate::toml_file::{ConfigError, Source};
use std::path::Path;

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
    /// A file of measurements of the anchors: `pulley`, `[[side]]`, `[[range]]` or `[[tape]]`.
    Measurements,
    /// A file of measurements with known weights: `added_kg`, `[[sinking]]` or `[[weighing]]`.
    Loads,
}

impl FileKind {
    /// Returns the kind of a file with these keys, if any kind has them.
    #[must_use]
    pub fn from_table(table: &toml::Table) -> Option<Self> {
        let robot = table.get("robot");
        let has = |keys: &[&str]| keys.iter().any(|key| table.contains_key(*key));
        // It names a robot file, as a system file does.
        if has(&["added_kg", "sinking", "weighing"]) {
            Some(Self::Loads)
        } else if table.contains_key("leg") {
            Some(Self::Mission)
        } else if table.contains_key("motor_io") || robot.is_some_and(toml::Value::is_str) {
            Some(Self::System)
        } else if robot.is_some_and(toml::Value::is_table) {
            Some(Self::Robot)
        } else if table.contains_key("port") {
            Some(Self::Sensor)
        } else if has(&["ground_m", "cylinder", "prism"]) {
            Some(Self::Ground)
        } else if has(&["pulley", "side", "range", "tape", "sigma_length_m"]) {
            Some(Self::Measurements)
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
            Self::Measurements => "file of measurements of the anchors",
            Self::Loads => "file of measurements with known weights",
        }
    }

    /// What to give instead of a file of another kind.
    fn cure(self) -> &'static str {
        match self {
            Self::Robot => "give the robot file that a system file names as `robot`, like those in configs/robots",
            Self::System => "give a system file, which names its robot file as `robot`, like those in configs/systems",
            Self::Mission => "give a mission file, which has legs, like those in configs/missions",
            Self::Sensor => "give a sensor file, which names its port, like those in configs/sensors",
            Self::Ground => "give a ground file, like that in configs/ground",
            Self::Measurements => "give a file of measurements like configs/measurements/lab3.toml",
            Self::Loads => "give a file of measurements like configs/measurements/loads3.toml",
        }
    }

    /// Rejects a file of another kind. Without this its first foreign key would be reported as unknown.
    ///
    /// # Errors
    /// [`ConfigError::OfAnotherKind`].
    pub fn expect(self, source: &Source) -> Result<(), ConfigError> {
        self.expect_text(source.path(), source.text())
    }

    /// As [`FileKind::expect`], of the text of a file.
    ///
    /// # Errors
    /// [`ConfigError::OfAnotherKind`].
    pub fn expect_text(self, path: &Path, text: &str) -> Result<(), ConfigError> {
        // A text that is no TOML is reported with its line where it is parsed.
        let found = text.parse::<toml::Table>().ok().and_then(|table| Self::from_table(&table));
        match found.filter(|found| *found != self) {
            None => Ok(()),
            Some(found) => {
                let path = path.to_owned();
                Err(ConfigError::OfAnotherKind { path, found: found.name(), wanted: self.name(), cure: self.cure() })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every kind of file in place of every other kind is named, with what to give instead.
    #[test]
    fn a_file_of_another_kind_is_named_in_one_sentence() {
        let example = |kind: FileKind| match kind {
            FileKind::Robot => "[robot]\nname = \"r\"\n",
            FileKind::System => "name = \"s\"\nrobot = \"r.toml\"\n",
            FileKind::Mission => "[[leg]]\nhold_s = 1.0\n",
            FileKind::Sensor => "port = \"/dev/ttyUSB0\"\n",
            FileKind::Ground => "ground_m = 0.0\n",
            FileKind::Measurements => "pulley = \"eye\"\n",
            FileKind::Loads => "robot = \"r.toml\"\nadded_kg = 2.0\n",
        };
        let kinds = [
            FileKind::Robot,
            FileKind::System,
            FileKind::Mission,
            FileKind::Sensor,
            FileKind::Ground,
            FileKind::Measurements,
            FileKind::Loads,
        ];
        for (wanted, found) in kinds.iter().flat_map(|wanted| kinds.map(|found| (*wanted, found))) {
            let judged = wanted.expect_text(Path::new("x.toml"), example(found));
            assert_eq!(FileKind::from_table(&example(found).parse().unwrap()), Some(found));
            match judged {
                Ok(()) => assert_eq!(wanted, found),
                Err(error) => {
                    let sentence = error.to_string();
                    assert!(wanted != found && sentence.lines().count() == 1, "{sentence}");
                    assert!(sentence.contains(found.name()) && sentence.contains(wanted.name()), "{sentence}");
                }
            }
        }
        // A text that is no file of a kind, or no TOML, is judged where it is parsed.
        for text in ["", "speed = 1", "[[", "name = \"x\""] {
            assert!(FileKind::Mission.expect_text(Path::new("x.toml"), text).is_ok());
        }
    }
}
