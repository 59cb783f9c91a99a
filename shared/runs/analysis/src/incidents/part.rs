//! Which process, cable or drive units a fault on request names, and whether faults of the robot name these cables and
//! units.

use crate::drive_units::DriveUnit;
use messages::MotorAuthority;
use messages::faults::{Faults, OF_CABLES, OF_UNITS};
use messages::{OperatorRequest, text_of};
use runtime::OUTPUT_FAULTS;

/// Kinds of faults that end or suspend a process.
const OF_A_PROCESS: [&str; 2] = ["kill", "stop"];
/// Kinds of faults with a cable as their first argument. This crate cannot see those of the motor box, which a test in
/// `tests/` compares with these.
const OF_ONE_CABLE: [&str; 5] = ["stall", "slip", "dead", "jump", "break"];
/// Those with a port.
const OF_ONE_PORT: [&str; 5] = ["noise", "silence", "late", "unplug", "plug"];
/// Those with a port and the address of a unit on it.
const OF_ONE_UNIT: [&str; 3] = ["mute", "reboot", "estop"];
/// Those of all units.
const OF_ALL_UNITS: [&str; 1] = ["supply"];

/// What a fault of the virtual motor box names. Cables and ports count from 1, as in the request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Cable(usize),
    Port(usize),
    Unit { port: usize, address: u8 },
    AllUnits,
}

/// What a request lets fail.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Target {
    /// A process, which is ended or suspended.
    Process(String),
    /// The output of a process; `None`: in a run of before, of a controller or of an estimator.
    Output(Option<String>),
    /// A part of the virtual motor box.
    Part(Part),
    /// The robot, by an emergency stop, or what this version does not know.
    Other,
}

impl Target {
    /// Reads the text of a fault.
    pub(super) fn of_fault(text: &str) -> Self {
        let words: Vec<&str> = text.split_whitespace().collect();
        let named = words.get(1).map(|word| (*word).to_owned());
        match (words.first(), named) {
            (Some(kind), Some(process)) if OF_A_PROCESS.contains(kind) => Self::Process(process),
            (Some(kind), named) if OUTPUT_FAULTS.iter().any(|(word, ..)| word == kind) => {
                // In a run of before, the duration or the number of cycles follows.
                Self::Output(named.filter(|word| word != "for" && word.parse::<u32>().is_err()))
            }
            _ => Part::of_request(text).map_or(Self::Other, Self::Part),
        }
    }
}

/// Returns the fault that a request is for. The answer also names the process whose output fails.
pub(crate) fn fault_of(request: &OperatorRequest) -> String {
    let answered = text_of(&request.detail);
    let is_done = request.answered == 1 && request.accepted == OperatorRequest::ACCEPTED && !answered.is_empty();
    if is_done { answered } else { text_of(&request.text) }
}

/// What the faults of an incident name.
#[derive(Debug, Default)]
pub(super) struct Failed {
    pub(super) bits: u32,
    /// Numbers of cables and of drive units, from 0.
    cables: Vec<usize>,
    units: Vec<usize>,
}

impl Failed {
    /// Reads the new faults of some cycles.
    pub(super) fn of<'a>(group: impl Iterator<Item = &'a MotorAuthority>) -> Self {
        let mut failed = Self::default();
        for authority in group {
            let faults = Faults::from_authority(authority);
            let marked = |bits: u32, marks: &[bool]| -> Vec<usize> {
                let marks = marks.iter().enumerate().filter(|(_, mark)| **mark && faults.bits & bits != 0);
                marks.map(|(at, _)| at).collect()
            };
            failed.bits |= faults.bits;
            failed.cables.extend(marked(OF_CABLES, &faults.cables));
            failed.units.extend(marked(OF_UNITS, &faults.units));
        }
        failed
    }
}

impl Part {
    /// Reads the text of a request; `None` if it is no fault of the virtual motor box.
    pub(super) fn of_request(text: &str) -> Option<Self> {
        let mut words = text.split_whitespace();
        let kind = words.next()?;
        if OF_ALL_UNITS.contains(&kind) {
            return Some(Self::AllUnits);
        }
        let number = words.next()?.parse().ok();
        if OF_ONE_CABLE.contains(&kind) {
            return Some(Self::Cable(number?));
        }
        if OF_ONE_PORT.contains(&kind) {
            return Some(Self::Port(number?));
        }
        let address = words.next().filter(|_| OF_ONE_UNIT.contains(&kind))?;
        let address = match address.strip_prefix("0x") {
            Some(digits) => u8::from_str_radix(digits, 16).ok()?,
            None => address.parse().ok()?,
        };
        Some(Self::Unit { port: number?, address })
    }

    /// Returns whether faults name it. Without `units`, those of the system file in its order, it is unknown which unit
    /// a fault names, so it may be any.
    pub(super) fn is_in(self, failed: &Failed, units: &[DriveUnit]) -> bool {
        match self {
            Self::Cable(number) => failed.cables.contains(&number.wrapping_sub(1)),
            Self::Port(_) | Self::Unit { .. } => {
                failed.units.iter().any(|unit| units.get(*unit).is_none_or(|unit| self.has(unit)))
            }
            Self::AllUnits => !failed.units.is_empty(),
        }
    }

    /// Returns whether it is this unit, or its port.
    fn has(self, unit: &DriveUnit) -> bool {
        self == Self::Port(unit.port) || self == Self::Unit { port: unit.port, address: unit.address }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_part_of_a_request_is_its_cable_port_or_unit() {
        assert_eq!(Part::of_request("slip 2 0.5 drum for 3"), Some(Part::Cable(2)));
        assert_eq!(Part::of_request("noise 1 0.0005 for 1"), Some(Part::Port(1)));
        for text in ["mute 2 0x81 for 1", "mute 2 129"] {
            assert_eq!(Part::of_request(text), Some(Part::Unit { port: 2, address: 129 }), "{text}");
        }
        assert_eq!(Part::of_request("unplug 2 off"), Some(Part::Port(2)));
        assert_eq!(Part::of_request("plug 2"), Some(Part::Port(2)));
        assert_eq!(Part::of_request("supply 9"), Some(Part::AllUnits));
        for text in ["kill controller", "slow controller 10", "stall", "stall x", "mute 1", ""] {
            assert_eq!(Part::of_request(text), None, "{text}");
        }
    }

    #[test]
    fn the_target_of_a_fault_is_its_process_or_part() {
        assert_eq!(Target::of_fault("kill my-law"), Target::Process("my-law".to_owned()));
        for text in ["slow controller 10", "nan controller", "frozen controller for 0.5"] {
            assert_eq!(Target::of_fault(text), Target::Output(Some("controller".to_owned())), "{text}");
        }
        for text in ["slow 10", "slow 10 for 0.5", "nan", "frozen for 3"] {
            assert_eq!(Target::of_fault(text), Target::Output(None), "{text}");
        }
        assert_eq!(Target::of_fault("stall 2 for 1"), Target::Part(Part::Cable(2)));
        for text in ["kill", "explode 2", ""] {
            assert_eq!(Target::of_fault(text), Target::Other, "{text}");
        }
    }

    #[test]
    fn the_answer_to_a_fault_names_its_process() {
        let mut request = OperatorRequest::default();
        messages::put_text(&mut request.text, "nan");
        messages::put_text(&mut request.detail, "nan estimator");
        assert_eq!(fault_of(&request), "nan", "not answered");
        (request.answered, request.accepted) = (1, OperatorRequest::ACCEPTED);
        assert_eq!(fault_of(&request), "nan estimator");
        request.detail = [0; messages::DETAIL_BYTES];
        assert_eq!(fault_of(&request), "nan");
    }

    #[test]
    fn a_unit_is_found_by_its_port_and_address() {
        let units = [(1, 0x80), (1, 0x81), (2, 0x80)];
        let units = units.map(|(port, address)| DriveUnit { port, address, cables: Vec::new() });
        let mut authority = MotorAuthority { faults: MotorAuthority::FAULT_LOST_UNIT, ..Default::default() };
        authority.fault_unit[2] = 1;
        let parts = ["mute 1 128", "mute 2 128", "silence 1", "silence 2"].map(|text| Part::of_request(text).unwrap());
        let failed = Failed::of([authority].iter());
        assert_eq!(parts.map(|part| part.is_in(&failed, &units)), [false, true, false, true]);
        assert_eq!(parts.map(|part| part.is_in(&failed, &[])), [true; 4], "which unit it is, is unknown");
    }
}
