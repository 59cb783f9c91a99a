//! A file of `nims identify`, which a robot file names.

use std::path::Path;

use crate::section::{above, between};
use crate::{ConfigError, Problem, toml_file};

crate::section! {
    /// A file of `nims identify --out`.
    pub struct IdentifiedFile {
        /// Delay of the drives, s; the mean of all cables.
        pub delay_s: Option<f64> = None => between(0.0, 0.5, "s"),
        /// Lag of the drives, s; the mean of all cables.
        pub lag_s: Option<f64> = None => between(0.0, 0.5, "s"),
        /// Mass of the node with its sensors, kg.
        pub node_mass_kg: Option<f64> = None => above(0.0, 1000.0, "kg"),
        /// Stiffness EA of the cables, N.
        pub stiffness_n: Option<f64> = None => between(100.0, 1e7, "N"),
        /// The motors.
        pub motor: IdentifiedMotor = IdentifiedMotor::default(),
        /// Each cable, for the reader.
        pub cable: Vec<IdentifiedCable> = Vec::new(),
    }
}

crate::section! {
    /// `[motor]` of a file of `nims identify`: the mean of all cables.
    pub struct IdentifiedMotor {
        /// Cable tension per ampere, N/A.
        pub force_constant_n_a: Option<f64> = None => between(1e-3, 1e5, "N/A"),
        /// Armature resistance, ohm.
        pub resistance_ohm: Option<f64> = None => between(0.0, 1e4, "ohm"),
        /// Friction in proportion to the tension.
        pub gear_friction: Option<f64> = None => between(0.0, 100.0, ""),
        /// Friction that does not depend on tension, N.
        pub coulomb_n: Option<f64> = None => between(0.0, 1e5, "N"),
        /// Friction that grows with speed, N s/m.
        pub viscous_n_s_m: Option<f64> = None => between(0.0, 1e6, "N s/m"),
    }
}

crate::section! {
    /// `[[cable]]` of a file of `nims identify`.
    pub struct IdentifiedCable {
        /// Delay of its drive, s.
        pub delay_s: Option<f64> = None => between(0.0, 0.5, "s"),
        /// Lag of its drive, s.
        pub lag_s: Option<f64> = None => between(0.0, 0.5, "s"),
        /// Both together, s.
        pub delay_and_lag_s: Option<f64> = None => between(0.0, 1.0, "s"),
        /// Its stiffness EA, N.
        pub stiffness_n: Option<f64> = None => between(100.0, 1e7, "N"),
    }
}

/// A value that an identified file replaced, or that it gives where none was.
#[derive(Debug, Clone, PartialEq)]
pub struct Replaced {
    /// The dotted key of the robot file, or of the system file.
    pub key: &'static str,
    /// The value in use.
    pub value: f64,
    /// Unit; empty: none.
    pub unit: &'static str,
    /// The value that it replaced; `None`: there was none.
    pub before: Option<f64>,
    /// Whether the robot file states that value; otherwise it is the default.
    pub is_stated: bool,
}

impl std::fmt::Display for Replaced {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        write!(f, "{} = {}{unit}", self.key, self.value)?;
        match self.before {
            Some(stated) if self.is_stated => write!(f, " (in the robot file: {stated})"),
            Some(default) => write!(f, " (default: {default})"),
            None => f.write_str(" (in the robot file: none)"),
        }
    }
}

impl IdentifiedFile {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// The file cannot be read, or a value is not accepted: one sentence that names the file.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        toml_file::load_checked(path, Self::check)
    }

    fn check(&self) -> Result<(), Problem> {
        self.check_ranges("")?;
        self.motor.check_ranges("motor")?;
        for (index, cable) in self.cable.iter().enumerate() {
            cable.check_ranges(&format!("cable.{index}"))?;
        }
        if self.delay_s.is_some() != self.lag_s.is_some() {
            let (given, missing) = if self.delay_s.is_some() { ("delay_s", "lag_s") } else { ("lag_s", "delay_s") };
            return Err(Problem::with_clause(given, format!("is given without `{missing}`; give both, or none")));
        }
        Ok(())
    }

    /// Delay and lag of the drives, s.
    #[must_use]
    pub fn drive_lag_s(&self) -> Option<[f64; 2]> {
        Some([self.delay_s?, self.lag_s?])
    }
}
