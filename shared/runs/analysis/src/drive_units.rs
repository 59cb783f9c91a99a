//! The drive units in the system file of a run.

use runlog::{Attachment, system_file_text};
use serde::Deserialize;
use std::path::Path;

/// A drive unit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DriveUnit {
    /// Number of its port, from 1.
    pub port: usize,
    /// Address on the port.
    pub address: u8,
    /// Numbers of its cables, from 1.
    pub cables: Vec<usize>,
}

/// What is read of a system file. Not the types of `config`: a run of another version may have keys that this one does
/// not know.
#[derive(Default, Deserialize)]
struct System {
    #[serde(default)]
    motor_io: MotorIo,
}

#[derive(Default, Deserialize)]
struct MotorIo {
    #[serde(default)]
    ports: Vec<Port>,
}

#[derive(Deserialize)]
struct Port {
    #[serde(default)]
    units: Vec<Unit>,
}

#[derive(Deserialize)]
struct Unit {
    address: u8,
    #[serde(default)]
    cables: Vec<usize>,
}

/// Returns the drive units of a run in the order of its system file, in which motor-io numbers them; none without one.
pub fn drive_units(run: &Path, inside: &[Attachment]) -> Vec<DriveUnit> {
    let text = system_file_text(run, inside).unwrap_or_default();
    let system: System = toml::from_str(&text).unwrap_or_default();
    let of_port = |(port, on_it): (usize, Port)| {
        on_it.units.into_iter().map(move |unit| DriveUnit { port, address: unit.address, cables: unit.cables })
    };
    (1..).zip(system.motor_io.ports).flat_map(of_port).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn units_count_through_the_ports_of_the_system_file() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(drive_units(folder.path(), &[]), []);
        let text = "[[motor_io.ports]]\nunits = [{ address = 0x80, cables = [1] }, { address = 0x81, cables = [3, 2] }]\n\
                    [[motor_io.ports]]\nof_another_version = 1\nunits = [{ address = 0x80, also = 2 }]\n";
        std::fs::write(folder.path().join(runlog::SYSTEM_FILE), text).unwrap();
        let unit = |port, address, cables: &[usize]| DriveUnit { port, address, cables: cables.to_vec() };
        let units = [unit(1, 0x80, &[1]), unit(1, 0x81, &[3, 2]), unit(2, 0x80, &[])];
        assert_eq!(drive_units(folder.path(), &[]), units);
    }
}
