//! `[[plugin]]`: sensors that run as another user and publish through the gateway.

use std::path::Path;

use crate::SystemFile;
use crate::problem::Problem;
use crate::process::{Role, process_name};
use messages::Slot;

/// Most values of a reading.
const VALUES: usize = 8;
/// Sizes of the fields for the quantities and the units of a reading, bytes.
const QUANTITY_BYTES: usize = 64;
const UNIT_BYTES: usize = 32;

crate::section! {
    /// `[[plugin]]`: a sensor that runs as another user (on a control box one of its own), cannot access the robot's
    /// shared memory, and publishes readings through the gateway, see `docs/access.md`.
    pub struct PluginSection {
        /// Unique name; its channel is `sensor/NAME`.
        pub name: String = String::new(),
        /// Program and arguments; the program with its absolute path. It gets the gateway's socket and its own name in
        /// `NIMS_GATEWAY` and `NIMS_NAME`. Empty: started by hand.
        pub command: Vec<String> = Vec::new(),
        /// Name of each value of its readings, e.g. `["moisture"]`; as many as there are values, at most 8. Without
        /// names and units the sensor declares its own message when it connects.
        pub quantity: Vec<String> = Vec::new(),
        /// Unit of each value.
        pub unit: Vec<String> = Vec::new(),
        /// Largest number of readings or samples per second; the gateway refuses more.
        pub rate_hz: f64 = 10.0 => crate::section::between(0.01, 100.0, "readings per second"),
        /// Position of the sensor relative to the node, in the axes of the site, m; only for readings.
        pub lever_m: [f64; 3] = [0.0; 3] => crate::section::between(-10.0, 10.0, "m").each("three times"),
        /// False: started only by `nims start`.
        pub start: bool = true,
        /// True: its program may use the network. Otherwise it reaches nothing but the gateway.
        pub network: bool = false,
    }
}

/// Checks the plug-ins of a system file.
///
/// # Errors
/// A name that is taken, a program without its path, values without names.
pub(crate) fn check(file: &SystemFile) -> Result<(), Problem> {
    for (index, plugin) in file.plugin.iter().enumerate() {
        let here =
            |problem: Problem| problem.within(&format!("plugin.{index}"), &format!("plug-in \"{}\"", plugin.name));
        plugin.check().map_err(here)?;
        let taken =
            file.plugin[..index].iter().map(|other| &other.name).chain(file.process.iter().map(|one| &one.name));
        if taken.into_iter().any(|name| *name == plugin.name) {
            let sentence = format!("two processes are called \"{}\"; accepted: each name once", plugin.name);
            return Err(here(Problem::with_sentence("name", sentence)));
        }
    }
    Ok(())
}

/// Largest rate of a sensor that the system file does not declare.
const UNDECLARED_RATE_HZ: f64 = 100.0;

impl PluginSection {
    /// A sensor of the robot's user that the system file does not declare; it declares its own message.
    ///
    /// # Errors
    /// The name cannot be that of a sensor: one sentence.
    pub fn undeclared(name: &str) -> Result<Self, String> {
        let section = Self { name: name.to_owned(), rate_hz: UNDECLARED_RATE_HZ, ..Self::default() };
        section.check().map_err(|problem| problem.to_string())?;
        Ok(section)
    }

    /// Whether the sensor declares its own message, and the system file no quantities.
    #[must_use]
    pub fn declares_a_message(&self) -> bool {
        self.quantity.is_empty() && self.unit.is_empty()
    }

    fn check(&self) -> Result<(), Problem> {
        process_name(&self.name, Role::Other, Slot::A)?;
        self.check_ranges("")?;
        if self.command.first().is_some_and(|program| !Path::new(program).is_absolute()) {
            let clause = "begins with a relative path; accepted: the absolute path of a program, then its arguments";
            return Err(Problem::with_clause("command", clause));
        }
        if self.declares_a_message() {
            if self.lever_m != [0.0; 3] {
                let clause = "belongs to readings; accepted: with quantity and unit, or in the message of the sensor";
                return Err(Problem::with_clause("lever_m", clause));
            }
            return Ok(());
        }
        let values = self.quantity.len();
        if !(1..=VALUES).contains(&values) || self.unit.len() != values {
            let units = self.unit.len();
            let clause =
                format!("has {values} names for {units} units; accepted: at most {VALUES} of both, as many of each");
            return Err(Problem::with_clause("quantity", clause));
        }
        for (key, words, room) in [("quantity", &self.quantity, QUANTITY_BYTES), ("unit", &self.unit, UNIT_BYTES)] {
            let plain = |word: &String| !word.is_empty() && !word.contains(',') && !word.chars().any(char::is_control);
            if !words.iter().all(plain) || words.join(",").len() > room {
                let clause = format!("is {words:?}; accepted: words without commas, at most {room} bytes in all");
                return Err(Problem::with_clause(key, clause));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "name = \"soil\"\ncommand = [\"/opt/soil.py\"]\nquantity = [\"moisture\"]\nunit = [\"%\"]\n";

    #[test]
    fn a_plug_in_names_its_values_and_its_program() {
        let problem = |from: &str, to: &str| {
            assert!(GOOD.contains(from));
            let plugin: PluginSection = toml::from_str(&GOOD.replace(from, to)).unwrap();
            plugin.check().unwrap_err().to_string()
        };
        assert!(toml::from_str::<PluginSection>(GOOD).unwrap().check().is_ok());
        let own: PluginSection = toml::from_str("name = \"soil\"\n").unwrap();
        assert!(own.check().is_ok() && own.declares_a_message());
        assert!(PluginSection { lever_m: [0.0, 0.0, 1.0], ..own }.check().is_err());
        assert!(PluginSection::undeclared("soil-2").is_ok());
        for name in ["", "So il", "../x", "planner", "nims"] {
            assert!(PluginSection::undeclared(name).is_err(), "{name}");
        }
        for (from, to, key) in [
            ("soil\"", "So il\"", "name"),
            ("/opt/soil.py", "soil.py", "command"),
            ("[\"moisture\"]", "[]", "quantity"),
            ("[\"moisture\"]", "[\"a\", \"b\"]", "quantity"),
            ("\"moisture\"", "\"a,b\"", "quantity"),
            ("\"%\"", "\"a unit that is longer than its field\"", "unit"),
            ("unit =", "rate_hz = 1000.0\nunit =", "rate_hz"),
            ("unit =", "lever_m = [0.0, 0.0, 99.0]\nunit =", "lever_m"),
        ] {
            let sentence = problem(from, to);
            assert!(sentence.contains(key) && sentence.contains("accepted"), "{sentence}");
        }
    }
}
