//! Sentences with which a mission ends because motor-io stopped the robot. They name the faults themselves, because a
//! recorded run has no `nims status`.

use messages::PlanStatus;
use messages::faults::{Faults, OF_CABLES, OF_UNITS};
use std::fmt;

use crate::sentences::{FAULTS, FaultText, named};

/// Longest note behind a shortened list.
const AND_MORE: &str = ", and 20 more";

/// What happened and the selected faults, as many as fit whole into the reason of `plan/status`. The text has no `; `,
/// which would mark a cure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stop<'a> {
    /// What happened, as a clause.
    pub(crate) what: &'static str,
    /// The faults of motor-io.
    pub(crate) faults: &'a Faults,
    /// Bits of the faults that are named.
    pub(crate) which: u32,
}

impl fmt::Display for Stop<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, faults, which } = self;
        let room = PlanStatus::default().reason.len() - AND_MORE.len();
        f.write_str(what)?;
        let (mut length, mut separator, mut left_out) = (what.len(), ": ", 0);
        for FaultText { bit, clause, .. } in FAULTS.iter().filter(|fault| faults.bits & which & fault.bit != 0) {
            let place = match *bit {
                bit if bit & OF_UNITS != 0 => named(&faults.units.map(u8::from), "unit"),
                bit if bit & OF_CABLES != 0 => named(&faults.cables.map(u8::from), "cable"),
                _ => String::new(),
            };
            let more = separator.len() + clause.len() + place.len();
            if length + more > room {
                left_out += 1;
                continue;
            }
            write!(f, "{separator}{clause}{place}")?;
            length += more;
            separator = ", and ";
        }
        if left_out > 0 {
            write!(f, ", and {left_out} more")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Reason;
    use messages::{MORE, MotorAuthority, text_of};

    #[test]
    fn every_fault_has_its_own_name() {
        let all = FAULTS.iter().fold(0, |all, fault| all | fault.bit);
        // The bits are given without a gap.
        assert_eq!((all.count_ones() as usize, all.trailing_ones() as usize), (FAULTS.len(), FAULTS.len()));
        let names: std::collections::BTreeSet<&str> = FAULTS.iter().map(|fault| fault.clause).collect();
        assert_eq!(names.len(), FAULTS.len());
        assert!(names.iter().all(|name| !name.contains(';')));
    }

    fn clause(bit: u32) -> String {
        FAULTS.iter().find(|fault| fault.bit == bit).map(|fault| fault.clause.to_owned()).unwrap()
    }

    #[test]
    fn the_faults_themselves_are_the_reason() {
        let mut faults = Faults::default();
        faults.unit(MotorAuthority::FAULT_LOST_UNIT, 0);
        faults.cable(MotorAuthority::FAULT_SLACK, 1);
        faults.cable(MotorAuthority::FAULT_SLACK, 2);
        let said = Reason::EndedByFault { faults }.to_string();
        let named = [
            clause(MotorAuthority::FAULT_LOST_UNIT) + " (unit 1)",
            clause(MotorAuthority::FAULT_SLACK) + " (cables 2, 3)",
        ];
        let places: Vec<usize> = named.iter().filter_map(|part| said.find(part)).collect();
        assert!(places.len() == 2 && places.is_sorted() && said.ends_with(&named[1]), "{said}");
        // An emergency stop names the input that caused it, and no other fault.
        let said = Reason::EndedByEmergencyStop { faults }.to_string();
        assert!(FAULTS.iter().all(|fault| !said.contains(fault.clause)), "{said}");
        faults.robot(MotorAuthority::FAULT_EMERGENCY_INPUT);
        let by_input = Reason::EndedByEmergencyStop { faults }.to_string();
        let named = format!("{said}: {}", clause(MotorAuthority::FAULT_EMERGENCY_INPUT));
        assert!(by_input.starts_with(&named), "{by_input}");
        let faults = Faults { bits: MotorAuthority::FAULT_COMMAND_LOST, ..Faults::default() };
        let said = Reason::EndedAfterFault { faults }.to_string();
        assert!(said.ends_with(&clause(MotorAuthority::FAULT_COMMAND_LOST)), "{said}");
    }

    #[test]
    fn a_reason_is_never_cut() {
        let mut faults = Faults { cables: [true; 8], units: [true; 8], ..Faults::default() };
        for bits in [u32::MAX, 1, 0x1fff, 0x1f_e000].into_iter().chain(FAULTS.iter().map(|fault| fault.bit)) {
            faults.bits = bits;
            for reason in [Reason::EndedByFault { faults }, Reason::EndedAfterFault { faults }] {
                let (said, mut status) = (reason.to_string(), PlanStatus::default());
                status.put_reason(&reason.answer());
                assert_eq!(text_of(&status.reason), said);
                assert_eq!(Reason::from_status(&status), Some(reason));
                assert!(!said.contains(MORE) && !said.contains("nims status"), "{said}");
            }
        }
        faults.bits = u32::MAX;
        let said = Reason::EndedByFault { faults }.to_string();
        assert!(said.ends_with(" more"), "{said}");
    }
}
