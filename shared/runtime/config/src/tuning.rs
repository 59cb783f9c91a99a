//! Parameters that can be set while the robot runs, and configurations with set values.

use crate::check;
use crate::controller::ControllerSection;
use crate::estimator::EstimatorSection;
use crate::robot_file::RobotFile;
use crate::section::Accepted;
use crate::system_file::SystemFile;
use std::collections::BTreeMap;
use std::fmt::Display;
use toml::{Table, Value};

/// A parameter that `nims set` can change.
#[derive(Debug, Clone, PartialEq)]
pub struct Tunable {
    /// Key in the system file.
    pub key: String,
    /// Accepted values, the same as in a system file.
    pub accepted: Accepted,
    /// Default as TOML; empty if the key has none.
    pub default: String,
    /// Description.
    pub what: &'static str,
}

/// Returns every parameter that can be set while the robot runs, from the sections of the processes that apply them.
///
/// Other keys are excluded on purpose: a law or method is changed by `nims swap`, and the tension distribution,
/// stretch, drives and limits define the robot.
pub fn tunable() -> impl Iterator<Item = Tunable> {
    let controller = ("controller", ControllerSection::KEYS, Table::try_from(ControllerSection::default()));
    let estimator = ("estimator", EstimatorSection::KEYS, Table::try_from(EstimatorSection::default()));
    [controller, estimator].into_iter().flat_map(|(section, keys, defaults)| {
        let defaults = defaults.unwrap_or_default();
        keys.iter().filter_map(move |key| {
            let accepted = key.accepted.copied().filter(Accepted::is_live)?;
            let default = defaults.get(key.name).map(Value::to_string).unwrap_or_default();
            Some(Tunable { key: format!("{section}.{}", key.name), accepted, default, what: key.summary() })
        })
    })
}

fn tunable_key(key: &str) -> Option<Tunable> {
    tunable().find(|tunable| tunable.key == key)
}

/// Values that were set while the robot runs, by their keys in [`tunable`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Tuned(BTreeMap<String, String>);

impl Tuned {
    /// Parses the output of [`Tuned::text`].
    ///
    /// # Errors
    /// A text line is not a key with a value.
    pub fn parse(text: &str) -> Result<Self, String> {
        let pair = |line: &str| {
            let (key, value) = line.split_once(" = ").ok_or_else(|| format!("`{line}` is not a key with a value"))?;
            Ok((key.to_owned(), value.to_owned()))
        };
        text.lines().map(pair).collect::<Result<_, String>>().map(Self)
    }

    /// Returns the values as TOML, one text line for each key.
    #[must_use]
    pub fn text(&self) -> String {
        self.0.iter().map(|(key, value)| format!("{key} = {value}\n")).collect()
    }

    /// Returns whether no value was set.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns these values with `key` set to `value`. [`SystemFile::tuned`] checks the value.
    ///
    /// # Errors
    /// The key cannot be set while the robot runs: one sentence.
    pub fn with(&self, key: &str, value: &str) -> Result<Self, String> {
        let Some(tunable) = tunable_key(key) else {
            return Err(format!(
                "`{key}` cannot be set while the robot runs; `nims set` lists the parameters that can; use `nims swap` for another law or method, and the system file and the next `nims up` for other keys"
            ));
        };
        // The stored value must be a single text line of TOML.
        let read = format!("value = {value}").parse::<Table>().ok().and_then(|mut table| table.remove("value"));
        let read = read.filter(|_| !value.contains(['\n', '\r', '\0', '#']));
        let read = read.ok_or_else(|| refusal(&tunable, &value))?;
        let mut more = self.clone();
        more.0.insert(key.to_owned(), read.to_string());
        Ok(more)
    }
}

fn refusal(tunable: &Tunable, value: &dyn Display) -> String {
    format!("`{}` is {value}; accepted: {}", tunable.key, tunable.accepted)
}

impl SystemFile {
    /// Returns this configuration with the set values, checked like a file.
    ///
    /// # Errors
    /// A value is not accepted: one sentence with the key, the value and what is accepted.
    pub fn tuned(&self, robot: &RobotFile, tuned: &Tuned) -> Result<Self, String> {
        if tuned.is_empty() {
            return Ok(self.clone());
        }
        let mut file = self.clone();
        for (key, value) in &tuned.0 {
            file = file.with_value(key, value)?;
        }
        check::system_file(&file, robot)?;
        file.motor_box.clone_from(&self.motor_box);
        Ok(file)
    }

    fn with_value(&self, key: &str, value: &str) -> Result<Self, String> {
        let tunable = tunable_key(key).ok_or_else(|| format!("`{key}` cannot be set while the robot runs"))?;
        let (section, name) = key.split_once('.').unwrap_or((key, ""));
        let mut read: Table = format!("value = {value}").parse().map_err(|_| refusal(&tunable, &value))?;
        let mut table = Table::try_from(self).map_err(|error| error.to_string())?;
        if let (Some(Value::Table(section)), Some(value)) = (table.get_mut(section), read.remove("value")) {
            section.insert(name.to_owned(), value);
        }
        // The rest of the table is valid, so an error is about this value.
        table.try_into().map_err(|_| refusal(&tunable, &value))
    }

    /// Returns the value of a parameter as TOML; empty if it is not set.
    #[must_use]
    pub fn value_of(&self, key: &str) -> String {
        let Some((section, name)) = key.split_once('.') else { return String::new() };
        let table = Table::try_from(self).unwrap_or_default();
        table.get(section).and_then(|section| section.get(name)).map(Value::to_string).unwrap_or_default()
    }

    /// Returns the named sections as TOML, with every key that has a value.
    #[must_use]
    pub fn sections(&self, names: &[&str]) -> String {
        let mut table = Table::try_from(self).unwrap_or_default();
        table.retain(|name, _| names.iter().any(|wanted| *name == **wanted));
        toml::to_string(&table).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn demo() -> (SystemFile, RobotFile) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems/demo4.toml");
        let file = SystemFile::load(&path).unwrap();
        let robot = file.robot_file().unwrap();
        (file, robot)
    }

    /// The accepted values in the table are those of the check, for every key.
    #[test]
    fn a_value_out_of_range_is_rejected_with_the_range_of_the_table() {
        let (file, robot) = demo();
        for tunable in tunable() {
            for wrong in ["-3.0", "nan", "1e9", "\"x\"", "[9.0, 9.0]", "[0.1]", "7 # x"] {
                let result = Tuned::default().with(&tunable.key, wrong).and_then(|tuned| file.tuned(&robot, &tuned));
                // 1e9 is the accepted maximum of the weights.
                if wrong == "1e9" && tunable.accepted.to_string().ends_with(" to 1e9") {
                    result.unwrap();
                    continue;
                }
                let sentence = result.unwrap_err();
                assert!(sentence.starts_with(&format!("`{}` ", tunable.key)), "{sentence}");
                assert!(sentence.ends_with(&format!(": {}", tunable.accepted)), "{}: {sentence}", tunable.key);
            }
        }
    }

    #[test]
    fn set_values_replace_those_of_the_file_and_nothing_else_changes() {
        let (file, robot) = demo();
        let tuned = Tuned::default().with("controller.length_gain_per_s", "6").unwrap();
        let tuned = tuned.with("controller.drive_lag_s", "[0.03, 0.05]").unwrap();
        let tuned = tuned.with("controller.length_gain_per_s", "6.5").unwrap();
        assert_eq!(Tuned::parse(&tuned.text()), Ok(tuned.clone()));
        let after = file.tuned(&robot, &tuned).unwrap();
        assert_eq!(after.controller.length_gain_per_s, 6.5);
        assert_eq!(after.controller.drive_lag_s, Some([0.03, 0.05]));
        assert_eq!(after.value_of("controller.length_gain_per_s"), "6.5");
        assert_eq!(file.value_of("controller.drive_lag_s"), "");
        let mut back = after;
        back.controller = file.controller.clone();
        assert_eq!(format!("{back:?}"), format!("{file:?}"));
    }

    #[test]
    fn other_keys_cannot_be_set() {
        for key in ["controller.law", "motor_io.ttl_cycles", "controller", "x", ""] {
            let sentence = Tuned::default().with(key, "1").unwrap_err();
            let parts = [&format!("`{key}`"), "`nims set`", "`nims swap`", "`nims up`"];
            assert!(parts.iter().all(|part| sentence.contains(part)), "{sentence}");
        }
        let mut forged = Tuned::default();
        forged.0.insert("motor_io.ramp_s".to_owned(), "0.1".to_owned());
        let (file, robot) = demo();
        assert!(file.tuned(&robot, &forged).is_err());
    }

    #[test]
    fn a_section_is_written_with_every_key() {
        let text = demo().0.sections(&["controller"]);
        assert!(text.starts_with("[controller]\n") && text.contains("length_gain_per_s = 3.0\n"), "{text}");
        assert!(text.len() < 1024, "{}", text.len());
    }
}
