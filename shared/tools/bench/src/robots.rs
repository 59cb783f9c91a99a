//! Detects a robot of any user on this machine.

use bus::Domain;
use config::Role;
use std::fs;

/// Returns a description of the running robot, if any.
///
/// Domains of other users are not accessible, so any process with the name of motor-io counts as a robot.
pub fn running() -> Option<String> {
    let named: Vec<String> = Domain::all()
        .into_iter()
        .filter(|domain| !domain.alive().is_empty())
        .map(|domain| format!("`{}`", domain.name()))
        .collect();
    if !named.is_empty() {
        return Some(format!("in the domain {}", named.join(", ")));
    }
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let mut numbers = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    numbers.find(|pid| drives_motors(*pid)).map(|pid| format!("process {pid} is {}", Role::MotorIo.name()))
}

fn drives_motors(pid: u32) -> bool {
    fs::read_to_string(format!("/proc/{pid}/comm")).is_ok_and(|name| name.trim_end() == Role::MotorIo.name())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_in_a_domain_is_found() {
        let domain = Domain::for_test();
        let bus = bus::Bus::join(&domain, "process").unwrap();
        // The robot of another test may run at the same time.
        assert!(running().unwrap().contains(domain.name()));
        drop(bus);
    }

    #[test]
    fn only_motor_io_drives_motors() {
        assert!(!drives_motors(std::process::id()));
        assert!(!drives_motors(u32::MAX / 2));
    }
}
