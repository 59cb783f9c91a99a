//! Which processes the supervisor starts with a robot.

use crate::process::{ProcessSection, Role};
use crate::system_file::SystemFile;
use messages::Slot;

/// A process that the supervisor starts with the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartedProcess<'a> {
    /// Its role.
    pub role: Role,
    /// Its slot, if the role has slots.
    pub slot: Option<Slot>,
    /// Its `[[process]]`; `None`: the standard process, with its defaults.
    pub section: Option<&'a ProcessSection>,
}

/// Returns the place of a role in the order of the start: upstream before downstream, sensors and others last.
const fn place(role: Role) -> u8 {
    match role {
        Role::Recorder => 0,
        Role::MotorBox => 1,
        Role::Estimator => 2,
        Role::Controller => 3,
        Role::Planner => 4,
        Role::MotorIo => 5,
        Role::Other => 6,
    }
}

impl SystemFile {
    /// Returns the processes that the supervisor starts, without itself, in the order of their start: one of each role
    /// with a standard process, a second one in slot b where an entry names it, and the entries of role `other`. The
    /// virtual motor box runs only in a system that has one.
    #[must_use]
    pub fn started(&self) -> Vec<StartedProcess<'_>> {
        let mut roles = Role::ALL.to_vec();
        roles.sort_by_key(|role| place(*role));
        roles.into_iter().flat_map(|role| self.started_as(role)).collect()
    }

    fn started_as(&self, role: Role) -> Vec<StartedProcess<'_>> {
        let sections = || self.process.iter().filter(move |process| process.start && process.role == role);
        let one = |slot, section| StartedProcess { role, slot, section };
        match role {
            Role::Other => sections().map(|section| one(None, Some(section))).collect(),
            Role::MotorBox if self.motor_box.is_none() => Vec::new(),
            _ if role.has_slots() => {
                let of = |slot| sections().find(|process| process.slot() == slot);
                let second = of(Slot::B).map(|section| one(Some(Slot::B), Some(section)));
                [one(Some(Slot::A), of(Slot::A))].into_iter().chain(second).collect()
            }
            _ => vec![one(None, sections().next())],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_robot_has_its_standard_processes_a_second_slot_where_it_is_named_and_its_sensors() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/systems/demo3.toml");
        let mut file = SystemFile::load(&path).unwrap();
        let started = |file: &SystemFile| -> Vec<(Role, Option<Slot>, Option<String>)> {
            let named = |one: StartedProcess<'_>| one.section.map(|section| section.name.clone());
            file.started().into_iter().map(|one| (one.role, one.slot, named(one))).collect()
        };
        let standard = vec![
            (Role::Recorder, None, None),
            (Role::MotorBox, None, None),
            (Role::Estimator, Some(Slot::A), None),
            (Role::Controller, Some(Slot::A), None),
            (Role::Planner, None, None),
            (Role::MotorIo, None, None),
        ];
        assert_eq!(started(&file), standard);
        for section in [
            "name = \"wind\"\nrole = \"other\"\ncommand = [\"sensor\"]",
            "name = \"late\"\nrole = \"other\"\ncommand = [\"sensor\"]\nstart = false",
            "name = \"second\"\nrole = \"estimator\"\nstandby = true",
            "name = \"mine\"\nrole = \"controller\"\ncommand = [\"mine\"]",
            "name = \"spare\"\nrole = \"controller\"\nslot = \"b\"\nstart = false",
            "name = \"tape\"\nrole = \"recorder\"\ncommand = [\"tape\"]",
        ] {
            file.process.push(toml::from_str(section).unwrap());
        }
        file.motor_box = None;
        let named = |name: &str| Some(name.to_owned());
        assert_eq!(
            started(&file),
            [
                (Role::Recorder, None, named("tape")),
                (Role::Estimator, Some(Slot::A), None),
                (Role::Estimator, Some(Slot::B), named("second")),
                (Role::Controller, Some(Slot::A), named("mine")),
                (Role::Planner, None, None),
                (Role::MotorIo, None, None),
                (Role::Other, None, named("wind")),
            ]
        );
    }
}
