//! Sentences with which a mission ends because motor-io stopped the robot. They name the faults themselves, because a
//! recorded run has no `nims status`.

use messages::faults::{Faults, OF_CABLES, OF_UNITS};
use messages::{MotorAuthority, PlanStatus};
use std::fmt;

use crate::sentences::named;

/// Fault bits of motor-io and their descriptions; motor-io itself publishes the cures.
const FAULTS: [(u32, &str); 22] = [
    (
        MotorAuthority::FAULT_EMERGENCY_INPUT,
        "the emergency stop button of a drive unit is pressed, or its wire is broken",
    ),
    (MotorAuthority::FAULT_LOST_UNIT, "a drive unit does not answer"),
    (MotorAuthority::FAULT_UNIT_REBOOT, "a drive unit was restarted"),
    (MotorAuthority::FAULT_SUPPLY, "the supply voltage is low"),
    (MotorAuthority::FAULT_DRIVE_ERROR, "a drive unit reports an error"),
    (MotorAuthority::FAULT_STALL, "a motor pushes hard and its cable does not move"),
    (MotorAuthority::FAULT_SLACK, "a cable is slack or broken"),
    (MotorAuthority::FAULT_OVER_TENSION, "a cable is too tight"),
    (MotorAuthority::FAULT_OVER_CURRENT, "a motor draws too much current"),
    (MotorAuthority::FAULT_RUNAWAY, "an encoder counts against the command"),
    (MotorAuthority::FAULT_ENCODER_JUMP, "an encoder has jumped"),
    (MotorAuthority::FAULT_LENGTH_LIMIT, "a cable has reached its length limit"),
    (MotorAuthority::FAULT_DIVERGING, "the commands moved the node away from its setpoint"),
    (MotorAuthority::FAULT_COMMAND_LOST, "the controller stopped answering"),
    (MotorAuthority::FAULT_ESTIMATE_LOST, "there was no valid estimate of the position"),
    (MotorAuthority::FAULT_COMMAND_REFUSED, "the controller sent NaN or commands far beyond the limits"),
    (MotorAuthority::FAULT_SUPERVISOR_LOST, "the supervisor was gone"),
    (MotorAuthority::FAULT_PLANNER_LOST, "the planner was gone"),
    (MotorAuthority::FAULT_LONG_GAP, "the computer had no time for the drives"),
    (MotorAuthority::FAULT_COMPUTER, "the computer was busy with other things"),
    (MotorAuthority::FAULT_OFF_START, "the motion does not begin where the node is"),
    (MotorAuthority::FAULT_BORDER, "a jog ended at the border of an obstacle or a keep-out box"),
];

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
        for (bit, name) in FAULTS.iter().filter(|(bit, _)| faults.bits & which & bit != 0) {
            let place = match *bit {
                bit if bit & OF_UNITS != 0 => named(&faults.units.map(u8::from), "unit"),
                bit if bit & OF_CABLES != 0 => named(&faults.cables.map(u8::from), "cable"),
                _ => String::new(),
            };
            let more = separator.len() + name.len() + place.len();
            if length + more > room {
                left_out += 1;
                continue;
            }
            write!(f, "{separator}{name}{place}")?;
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
    use messages::{MORE, text_of};

    #[test]
    fn every_fault_has_its_own_name() {
        let all = FAULTS.iter().fold(0, |all, (bit, _)| all | bit);
        // The bits are given without a gap.
        assert_eq!((all.count_ones() as usize, all.trailing_ones() as usize), (FAULTS.len(), FAULTS.len()));
        let names: std::collections::BTreeSet<&str> = FAULTS.iter().map(|(_, name)| *name).collect();
        assert_eq!(names.len(), FAULTS.len());
        assert!(names.iter().all(|name| !name.contains(';')));
    }

    #[test]
    fn the_faults_themselves_are_the_reason() {
        let mut faults = Faults::default();
        faults.unit(MotorAuthority::FAULT_LOST_UNIT, 0);
        faults.cable(MotorAuthority::FAULT_SLACK, 1);
        faults.cable(MotorAuthority::FAULT_SLACK, 2);
        assert_eq!(
            Reason::EndedByFault { faults }.to_string(),
            "a fault stopped the robot: a drive unit does not answer (unit 1), and a cable is slack or broken (cables 2, 3)"
        );
        assert_eq!(Reason::EndedByEmergencyStop { faults }.to_string(), "emergency stop", "it was asked for");
        faults.robot(MotorAuthority::FAULT_EMERGENCY_INPUT);
        let said = Reason::EndedByEmergencyStop { faults }.to_string();
        assert!(said.starts_with("emergency stop: the emergency stop button"), "{said}");
        let faults = Faults { bits: MotorAuthority::FAULT_COMMAND_LOST, ..Faults::default() };
        assert_eq!(
            Reason::EndedAfterFault { faults }.to_string(),
            "the robot was stopped after this: the controller stopped answering"
        );
    }

    #[test]
    fn a_reason_is_never_cut() {
        let mut faults = Faults { cables: [true; 8], units: [true; 8], ..Faults::default() };
        for bits in [u32::MAX, 1, 0x1fff, 0x1f_e000].into_iter().chain(FAULTS.iter().map(|(bit, _)| *bit)) {
            faults.bits = bits;
            for reason in [Reason::EndedByFault { faults }, Reason::EndedAfterFault { faults }] {
                let (said, mut status) = (reason.to_string(), PlanStatus::default());
                status.put_reason(&reason.answer());
                assert_eq!(text_of(&status.reason), said);
                assert_eq!(Reason::of_plan(&status), Some(reason));
                assert!(!said.contains(MORE) && !said.contains("nims status"), "{said}");
            }
        }
        faults.bits = u32::MAX;
        let said = Reason::EndedByFault { faults }.to_string();
        assert!(said.ends_with(" more"), "{said}");
    }
}
