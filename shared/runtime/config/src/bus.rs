//! `[bus]`: places in shared memory.

use crate::section::between;
use crate::system_file::SystemFile;

crate::section! {
    /// `[bus]`.
    pub struct BusSection {
        /// Largest number of processes at once, with sensors and commands. Memory is reserved for each, running or not:
        /// `nims check` states how much. A process in excess runs, but announces no channel; a gateway counts twice.
        pub processes: usize = messages::PROCESSES => between(64.0, 4096.0, "processes"),
    }
}

/// More processes than the robot has places for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Excess {
    /// Processes that the supervisor starts, with itself.
    pub started: usize,
    /// Places of the robot.
    pub places: usize,
}

impl Excess {
    /// Returns what to do.
    #[must_use]
    pub fn cure(&self) -> String {
        format!(
            "set `processes` of [bus] to at least {}, and more for sensors that are plugged in and commands that look on",
            self.started
        )
    }
}

impl std::fmt::Display for Excess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the system has {} processes, and places for {}: those in excess run, but their channels are found up to a second later",
            self.started, self.places
        )
    }
}

impl SystemFile {
    /// Returns the processes that the supervisor starts, if there are more than places for them.
    #[must_use]
    pub fn excess(&self) -> Option<Excess> {
        let started = 1 + self.started().len();
        let places = self.bus.processes;
        (started > places).then_some(Excess { started, places })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::ProcessSection;
    use std::path::Path;

    #[test]
    fn the_processes_of_a_system_are_compared_with_its_places() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems/demo3.toml");
        let mut file = SystemFile::load(&path).unwrap();
        file.bus.processes = 64;
        assert_eq!(file.excess(), None);
        let section = |text: &str| toml::from_str::<ProcessSection>(text).unwrap();
        // Supervisor, recorder, motor-box, estimator, controller, planner, motor-io.
        for at in 0..64 - 7 {
            file.process.push(section(&format!("name = \"s{at}\"\nrole = \"other\"\ncommand = [\"sensor\"]")));
        }
        file.process.push(section("name = \"late\"\nrole = \"other\"\ncommand = [\"sensor\"]\nstart = false"));
        assert_eq!(file.excess(), None);
        file.process.push(section("name = \"mine\"\nrole = \"controller\"\nslot = \"b\"\ncommand = [\"mine\"]"));
        assert_eq!(file.excess(), Some(Excess { started: 65, places: 64 }));
    }
}
