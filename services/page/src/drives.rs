//! The drives of a robot: what is to be set in their makers' programs, and what they answer.

use config::{PortSection, SystemFile};
use messages::{MotorState, UNITS};
use serde_json::{Value, json};

/// The ports of a system file with their units, and what to set. `speed_m_s`: of the fastest cable.
pub(crate) fn declared(system: &SystemFile, speed_m_s: f64) -> Value {
    let port = |(index, port): (usize, &PortSection)| {
        let family = port.protocol.family();
        let cables = port.units.iter().flat_map(|unit| &unit.cables);
        let counts_per_m = cables.filter_map(|cable| system.motor_io.counts_per_m.get(cable.checked_sub(1)?));
        let fastest = counts_per_m.fold(0.0, |most: f64, counts| most.max(counts.abs() * speed_m_s));
        let units: Vec<Value> =
            port.units.iter().map(|unit| json!({ "address": unit.address, "cables": unit.cables })).collect();
        json!({ "number": index + 1, "family": port.protocol.name(), "virtual": port.path.contains("{domain}"),
            "path": port.path, "units": units, "set": family.set, "silent": family.remedies.silent,
            "fastest_counts_s": fastest.round() })
    };
    system.motor_io.ports.iter().enumerate().map(port).collect()
}

/// When each unit answered last.
#[derive(Debug, Default)]
pub(crate) struct Units {
    answered_ns: [Option<u64>; UNITS],
}

impl Units {
    pub(crate) fn take(&mut self, state: &MotorState) {
        for (unit, answered_ns) in self.answered_ns.iter_mut().enumerate() {
            if state.unit_ok[unit] == 1 {
                *answered_ns = Some(state.header.stamp_ns);
            }
        }
    }

    /// What each unit answers, in the order of the system file. A cycle without an answer is not silence.
    pub(crate) fn told(&self, state: &MotorState) -> Value {
        let unit = |unit: usize| {
            let silent_ns = self.answered_ns[unit].map(|at_ns| state.header.stamp_ns.saturating_sub(at_ns));
            json!({ "answers": silent_ns.is_some_and(|ns| ns < SILENT_NS), "supply_v": state.supply_v[unit] })
        };
        (0..usize::from(state.unit_count).min(UNITS)).map(unit).collect()
    }
}

/// Time without an answer after which a unit is silent, ns: a hundred cycles.
const SILENT_NS: u64 = 1_000_000_000;

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Header;
    use std::path::Path;

    #[test]
    fn each_port_of_an_example_has_what_to_set() {
        let systems = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/systems");
        for entry in std::fs::read_dir(systems).unwrap() {
            let path = entry.unwrap().path();
            let name = path.display();
            let system = SystemFile::load(&path).unwrap();
            let told = declared(&system, 0.5);
            assert_eq!(told.as_array().unwrap().len(), system.motor_io.ports.len(), "{name}");
            for (port, section) in told.as_array().unwrap().iter().zip(&system.motor_io.ports) {
                assert_eq!(port["set"], section.protocol.family().set, "{name}");
                assert!(port["virtual"] == true && port["fastest_counts_s"].as_f64().unwrap() > 1000.0, "{port}");
            }
        }
    }

    #[test]
    fn a_unit_is_silent_after_a_second_and_not_after_a_cycle() {
        let mut units = Units::default();
        let mut state = MotorState { unit_count: 2, ..MotorState::default() };
        let mut at = |stamp_ns: u64, ok: [u8; 2]| {
            state.header = Header { stamp_ns, ..Header::default() };
            state.unit_ok[..2].copy_from_slice(&ok);
            units.take(&state);
            units.told(&state)
        };
        let told = at(1_000_000_000, [1, 0]);
        assert_eq!((&told[0]["answers"], &told[1]["answers"]), (&json!(true), &json!(false)));
        assert_eq!(at(1_500_000_000, [0, 1])[0]["answers"], true);
        assert_eq!(at(2_000_000_000, [0, 1])[0]["answers"], false);
    }
}
