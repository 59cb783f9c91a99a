//! What was identified takes the place of what was assumed.
//!
//! Precedence: a value of the identified file replaces that of the robot file; a key that the identified file lacks
//! leaves the robot file's. `drive_lag_s` of a system file that states it stays, and is taken from the identified file
//! otherwise.

use std::fmt::Write as _;

use serde::Deserialize;

use super::{IdentifiedFile, Replaced, RobotFile, SystemFile};
use crate::Problem;
use crate::toml_file::{ConfigError, Source};

/// Largest ratio of a value to that of the robot file: beyond it, the file is that of another robot.
const MOST_APART: f64 = 3.0;

impl IdentifiedFile {
    /// Puts its values in the places of those of a robot file; `stated`: the keys that the robot file states.
    ///
    /// # Errors
    /// It was identified on a robot with another number of cables, or a value is far from that of the robot file.
    pub(super) fn apply(&self, file: &mut RobotFile, stated: &toml::Table) -> Result<Vec<Replaced>, Problem> {
        let cables = file.robot.anchors_m.len();
        if !self.cable.is_empty() && self.cable.len() != cables {
            let clause = format!(
                "has {} cables, and this robot has {cables}: it is that of another robot; run nims identify on a run of \
                 this one",
                self.cable.len()
            );
            return Err(Problem::with_clause("cable", clause));
        }
        let is_stated = |dotted: &str| {
            let (section, key) = dotted.split_once('.').unwrap_or(("", dotted));
            stated.get(section).and_then(|section| section.get(key)).is_some()
        };
        let motor = &mut file.motor;
        let mut all = Vec::new();
        let mut put = |key: &'static str, unit, value: Option<f64>, into: &mut f64| {
            if let Some(value) = value {
                all.push(Replaced { key, value, unit, before: Some(*into), is_stated: is_stated(key) });
                *into = value;
            }
        };
        put("robot.node_mass_kg", "kg", self.node_mass_kg, &mut file.robot.node_mass_kg);
        let found = &self.motor;
        put("motor.force_constant_n_a", "N/A", found.force_constant_n_a, &mut motor.force_constant_n_a);
        put("motor.resistance_ohm", "ohm", found.resistance_ohm, &mut motor.resistance_ohm);
        put("motor.gear_friction", "", found.gear_friction, &mut motor.gear_friction);
        put("motor.coulomb_n", "N", found.coulomb_n, &mut motor.coulomb_n);
        put("motor.viscous_n_s_m", "N s/m", found.viscous_n_s_m, &mut motor.viscous_n_s_m);
        if let Some(value) = self.stiffness_n {
            let before = file.lines.stiffness_n;
            all.push(Replaced { key: "lines.stiffness_n", value, unit: "N", before, is_stated: before.is_some() });
            file.lines.stiffness_n = Some(value);
        }
        // Friction is often assumed, mass and stiffness are measured or from a data sheet.
        let told = ["robot.node_mass_kg", "lines.stiffness_n"];
        let apart = |one: &&Replaced| {
            let ratio = one.value / one.before.unwrap_or(one.value);
            told.contains(&one.key) && !(MOST_APART.recip()..=MOST_APART).contains(&ratio)
        };
        match all.iter().find(apart) {
            Some(one) => {
                let key = one.key.rsplit('.').next().unwrap_or(one.key);
                let clause = format!(
                    "is {}, and the robot file has {}: this is another robot, or a wrong robot file; identify again, or \
                     correct the robot file",
                    one.value,
                    one.before.unwrap_or_default()
                );
                Err(Problem::with_clause(key, clause))
            }
            None => Ok(all),
        }
    }
}

/// Keys that a system file states itself.
#[derive(Default, Deserialize)]
struct Stated {
    #[serde(default)]
    controller: toml::Table,
    #[serde(default)]
    estimator: toml::Table,
}

impl SystemFile {
    /// Takes delay and lag of the drives from the identified file of the robot, where the system file states none.
    pub(super) fn identified(&mut self, source: &Source, robot: &RobotFile) -> Result<(), ConfigError> {
        const KEY: &str = "drive_lag_s";
        let Some([delay_s, lag_s]) = robot.identified.as_ref().and_then(IdentifiedFile::drive_lag_s) else {
            return Ok(());
        };
        let stated: Stated = source.parse()?;
        if !stated.controller.contains_key(KEY) {
            self.controller.drive_lag_s = Some([delay_s, lag_s]);
        }
        // A filter without any lag has no model of the drives.
        if !stated.estimator.contains_key(KEY) && delay_s + lag_s >= 0.001 {
            self.estimator.drive_lag_s = delay_s + lag_s;
        }
        Ok(())
    }
}

impl RobotFile {
    /// States in one sentence which values are those of the identified file, and what the robot file states instead;
    /// `None` without such a file.
    #[must_use]
    pub fn identified_in_words(&self) -> Option<String> {
        let (file, path) = (self.identified.as_ref()?, self.robot.identified.as_ref()?);
        let mut text = format!("from {}: ", path.display());
        for (number, one) in self.replaced.iter().enumerate() {
            let _ = write!(text, "{}{one}", if number > 0 { ", " } else { "" });
        }
        if let Some([delay_s, lag_s]) = file.drive_lag_s() {
            let comma = if self.replaced.is_empty() { "" } else { ", " };
            let _ = write!(text, "{comma}drives with a delay of {delay_s} s and a lag of {lag_s} s");
        }
        Some(text)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::path::{Path, PathBuf};

    fn configs() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs")
    }

    /// The demonstration with an identified file, and a line more in its system file.
    fn load(folder: &Path, identified: &str, more: &str) -> Result<SystemFile, ConfigError> {
        let robot = std::fs::read_to_string(configs().join("robots/lab3.toml")).unwrap();
        let system = std::fs::read_to_string(configs().join("systems/demo3.toml")).unwrap();
        std::fs::write(folder.join("found.toml"), identified).unwrap();
        std::fs::write(folder.join("robot.toml"), robot.replace("[robot]", "[robot]\nidentified = \"found.toml\""))
            .unwrap();
        let line = system.lines().find(|line| line.starts_with("robot = ")).unwrap();
        let system = system.replace(line, "robot = \"robot.toml\"");
        std::fs::write(folder.join("system.toml"), format!("{system}\n{more}")).unwrap();
        SystemFile::load(&folder.join("system.toml"))
    }

    const FOUND: &str = "delay_s = 0.05\nlag_s = 0.02\nnode_mass_kg = 1.25\nstiffness_n = 5500.0\n[motor]\n\
        force_constant_n_a = 41.0\ncoulomb_n = 2.5\n[[cable]]\ndelay_s = 0.05\n[[cable]]\n[[cable]]\n";

    #[test]
    fn identified_values_take_the_place_of_those_of_the_robot_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = load(folder.path(), FOUND, "").unwrap();
        let robot = file.robot_file().unwrap();
        let model = robot.robot().unwrap();
        assert_eq!((model.node_mass_kg(), model.stiffness_n()), (1.25, Some(5500.0)));
        let motor = robot.motor.motor();
        assert_eq!((motor.force_constant_n_a, motor.coulomb_n, motor.resistance_ohm), (41.0, 2.5, 1.2));
        assert_eq!(file.controller.drive_lag_s, Some([0.05, 0.02]));
        assert!((file.estimator.drive_lag_s - 0.07).abs() < 1e-12);
        let words = robot.identified_in_words().unwrap();
        for part in ["found.toml", "node_mass_kg = 1.25 kg", "1.2)", "stiffness_n = 5500", "6000)", "0.05 s", "0.02 s"]
        {
            assert!(words.contains(part), "{part}: {words}");
        }
        assert!(!words.contains("resistance_ohm"), "{words}");
        assert!(words.contains("coulomb_n = 2.5 N (in the robot file: 3)"), "{words}");
        // A run keeps the file, and reads the same values again.
        assert_eq!(robot.named_files(folder.path()), [folder.path().join("found.toml")]);
        std::fs::write(folder.path().join("again.toml"), file.resolved("robot.toml").unwrap()).unwrap();
        let again = SystemFile::load(&folder.path().join("again.toml")).unwrap();
        assert_eq!(again.controller.drive_lag_s, Some([0.05, 0.02]));
    }

    #[test]
    fn a_default_is_not_stated_as_a_value_of_the_robot_file() {
        let folder = tempfile::tempdir().unwrap();
        load(folder.path(), FOUND, "").unwrap();
        let path = folder.path().join("robot.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let short: String =
            text.lines().filter(|line| !line.starts_with("coulomb_n")).map(|l| format!("{l}\n")).collect();
        assert_ne!(short.lines().count(), text.lines().count());
        std::fs::write(&path, short).unwrap();
        let words = RobotFile::load(&path).unwrap().identified_in_words().unwrap();
        let default = crate::MotorSection::default().coulomb_n;
        assert!(words.contains(&format!("coulomb_n = 2.5 N (default: {default})")), "{words}");
        assert!(words.contains("force_constant_n_a = 41 N/A (in the robot file: "), "{words}");
    }

    #[test]
    fn what_the_system_file_states_stays() {
        let folder = tempfile::tempdir().unwrap();
        let more = "[controller]\ndrive_lag_s = [0.03, 0.04]\n[estimator]\ndrive_lag_s = 0.09\n";
        let file = load(folder.path(), FOUND, more).unwrap();
        assert_eq!(file.controller.drive_lag_s, Some([0.03, 0.04]));
        assert_eq!(file.estimator.drive_lag_s, 0.09);
    }

    #[test]
    fn a_file_that_does_not_fit_is_refused_in_one_sentence() {
        let folder = tempfile::tempdir().unwrap();
        for (identified, key, says) in [
            ("delay_s = 0.05\n", "delay_s", &["lag_s"][..]),
            ("delay_s = 0.7\nlag_s = 0.1\n", "delay_s", &["0.7", "0 to 0.5 s"]),
            ("node_mass_kg = 4.0\n", "node_mass_kg", &["4", "1.2"]),
            ("stiffness_n = 100.0\n", "stiffness_n", &["100", "6000"]),
            ("[[cable]]\n[[cable]]\n", "cable", &["2 cables", "3"]),
            ("[motor]\nresistance_ohm = -1.0\n", "motor.resistance_ohm", &["-1"]),
        ] {
            let error = load(folder.path(), identified, "").unwrap_err();
            let sentence = error.to_string();
            assert_eq!(error.key(), Some(key), "{sentence}");
            assert_eq!(error.path().file_name(), Some("found.toml".as_ref()), "{sentence}");
            assert!(says.iter().all(|part| sentence.contains(part)) && !sentence.contains('\n'), "{sentence}");
        }
        std::fs::remove_file(folder.path().join("found.toml")).unwrap();
        let error = RobotFile::load(&folder.path().join("robot.toml")).unwrap_err();
        assert!(error.to_string().contains("found.toml"), "{error}");
    }
}
