//! Maps the name of a law or method to a process: the standard program, or a `[[process]]` of the system file.

use crate::{ProcessSection, Role, SystemFile};

/// Neither the standard program nor the system file has a law or method of this name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum UnknownAlgorithm {
    /// The entry of the system file has another role.
    #[error("the process \"{name}\" of the system file has the role {is}, not {wanted}")]
    OtherRole {
        /// The name.
        name: String,
        /// Role of the entry.
        is: Role,
        /// Requested role.
        wanted: Role,
    },
    /// Nothing has this name.
    #[error(
        "nothing was started: the {role} has no \"{name}\"; accepted: {}, or {}",
        quoted(role.algorithms()), from_file(others)
    )]
    Unknown {
        /// The name.
        name: String,
        /// Requested role.
        role: Role,
        /// Processes of that role in the system file.
        others: Vec<String>,
    },
}

fn quoted(names: &[&str]) -> String {
    names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
}

fn from_file(others: &[String]) -> String {
    if others.is_empty() {
        "the name of a [[process]] of that role (the system file has no such process)".to_owned()
    } else {
        format!("from the system file {}", others.join(", "))
    }
}

impl SystemFile {
    /// Returns the `[[process]]` with this name of a law or method; `None` if the standard program implements it.
    ///
    /// # Errors
    /// Neither exists, or the entry has another role.
    pub fn process_for(&self, role: Role, law: &str) -> Result<Option<&ProcessSection>, UnknownAlgorithm> {
        if let Some(section) = self.process.iter().find(|section| section.name == law) {
            if section.role == role {
                return Ok(Some(section));
            }
            return Err(UnknownAlgorithm::OtherRole { name: law.to_owned(), is: section.role, wanted: role });
        }
        let known = role.algorithms();
        if known.is_empty() || known.contains(&law) {
            return Ok(None);
        }
        let others = self.process.iter().filter(|other| other.role == role).map(|other| other.name.clone()).collect();
        Err(UnknownAlgorithm::Unknown { name: law.to_owned(), role, others })
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
