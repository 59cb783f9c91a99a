//! Maps the name of a law or method to a process: the standard program, or a `[[process]]` of the system file.

use crate::{ProcessSection, Role, SystemFile};

impl SystemFile {
    /// Returns the `[[process]]` with this name of a law or method; `None` if the standard program implements it.
    ///
    /// # Errors
    /// Neither exists, or the entry has another role.
    pub fn process_for(&self, role: Role, law: &str) -> Result<Option<&ProcessSection>, String> {
        if let Some(section) = self.process.iter().find(|section| section.name == law) {
            if section.role == role {
                return Ok(Some(section));
            }
            let (is, wanted) = (section.role.name(), role.name());
            return Err(format!("the process \"{law}\" of the system file has the role {is}, not {wanted}"));
        }
        let known = role.algorithms();
        if known.is_empty() || known.contains(&law) {
            return Ok(None);
        }
        let quoted: Vec<String> = known.iter().map(|name| format!("\"{name}\"")).collect();
        let others: Vec<&str> =
            self.process.iter().filter(|other| other.role == role).map(|other| other.name.as_str()).collect();
        let or = if others.is_empty() {
            ", or the name of a [[process]] of that role (the system file has no such process)".to_owned()
        } else {
            format!(", or from the system file {}", others.join(", "))
        };
        let (role, accepted) = (role.name(), quoted.join(", "));
        Err(format!("nothing was started: the {role} has no \"{law}\"; accepted: {accepted}{or}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ControlLaw, EstimatorMethod};
    use std::path::Path;

    #[test]
    fn a_law_is_one_of_the_standard_program_or_an_entry_of_the_system_file() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems/demo3.toml");
        let mut file = SystemFile::load(&path).unwrap();
        let own = "name = \"mine\"\nrole = \"controller\"\ncommand = [\"mine\"]\n";
        file.process = vec![toml::from_str(own).unwrap()];
        for law in ControlLaw::NAMES {
            assert!(file.process_for(Role::Controller, law).unwrap().is_none(), "{law}");
        }
        for method in EstimatorMethod::NAMES {
            assert!(file.process_for(Role::Estimator, method).unwrap().is_none(), "{method}");
        }
        let mine = file.process_for(Role::Controller, "mine").unwrap();
        assert_eq!(mine.map(|found| found.name.as_str()), Some("mine"));
        for (role, law) in [
            (Role::Controller, "pid"),
            (Role::Controller, "kalman"),
            (Role::Estimator, "ukf"),
            (Role::Estimator, "mine"),
        ] {
            assert!(file.process_for(role, law).is_err(), "{law}");
        }
    }
}
