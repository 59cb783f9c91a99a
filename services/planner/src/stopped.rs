//! Reason for which motor-io ended a motion. It names the faults themselves, because a recorded run has no `nims
//! status`.

use messages::faults::{OF_CABLES, OF_UNITS};
use messages::{MotorAuthority, PlanStatus};
use robot_state::sentences::named;

/// Fault bits of motor-io and their descriptions; motor-io itself publishes the cures.
const FAULTS: [(u32, &str); 21] = [
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
];

/// Longest note behind a shortened list.
const AND_MORE: &str = ", and 20 more";

/// Returns why motor-io ended the motion. The text has no `; `, which would mark a cure.
pub(crate) fn stopped_by(authority: &MotorAuthority) -> String {
    match authority.mode {
        MotorAuthority::MODE_EMERGENCY_STOP => {
            with_faults("emergency stop", authority, MotorAuthority::FAULT_EMERGENCY_INPUT)
        }
        MotorAuthority::MODE_FAULTED => with_faults("a fault stopped the robot", authority, u32::MAX),
        MotorAuthority::MODE_DISARMED => "the robot was disarmed or motor-io restarted".to_owned(),
        // An earlier latched fault need not be the cause of this stop.
        _ if authority.faults != 0 => with_faults("the robot was stopped after this", authority, u32::MAX),
        _ => "the robot was stopped".to_owned(),
    }
}

/// Returns what happened with the selected faults, as many as fit whole into the reason of `plan/status`.
fn with_faults(what: &str, authority: &MotorAuthority, which: u32) -> String {
    let room = PlanStatus::default().reason.len() - AND_MORE.len();
    let mut sentence = what.to_owned();
    let (mut separator, mut left_out) = (": ", 0);
    for (bit, name) in FAULTS.iter().filter(|(bit, _)| authority.faults & which & bit != 0) {
        let place = match *bit {
            bit if bit & OF_UNITS != 0 => named(&authority.fault_unit, "unit"),
            bit if bit & OF_CABLES != 0 => named(&authority.fault_cable, "cable"),
            _ => String::new(),
        };
        if sentence.len() + separator.len() + name.len() + place.len() > room {
            left_out += 1;
            continue;
        }
        sentence += &format!("{separator}{name}{place}");
        separator = ", and ";
    }
    if left_out > 0 {
        sentence += &format!(", and {left_out} more");
    }
    sentence
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{MORE, put_sentence, text_of};

    fn faulted(faults: u32) -> MotorAuthority {
        MotorAuthority { mode: MotorAuthority::MODE_FAULTED, faults, ..MotorAuthority::default() }
    }

    #[test]
    fn every_fault_has_a_name_of_its_own() {
        let all = FAULTS.iter().fold(0, |all, (bit, _)| all | bit);
        // The bits are given without a gap.
        assert_eq!((all.count_ones() as usize, all.trailing_ones() as usize), (FAULTS.len(), FAULTS.len()));
        let names: std::collections::BTreeSet<&str> = FAULTS.iter().map(|(_, name)| *name).collect();
        assert_eq!(names.len(), FAULTS.len());
        assert!(names.iter().all(|name| !name.contains(';')));
    }

    #[test]
    fn the_faults_themselves_are_the_reason() {
        let mut authority = faulted(MotorAuthority::FAULT_LOST_UNIT | MotorAuthority::FAULT_SLACK);
        authority.fault_unit[0] = 1;
        (authority.fault_cable[1], authority.fault_cable[2]) = (1, 1);
        let said = stopped_by(&authority);
        assert_eq!(
            said,
            "a fault stopped the robot: a drive unit does not answer (unit 1), and a cable is slack or broken (cables 2, 3)"
        );
        authority.mode = MotorAuthority::MODE_EMERGENCY_STOP;
        assert_eq!(stopped_by(&authority), "emergency stop", "it was asked for");
        authority.faults |= MotorAuthority::FAULT_EMERGENCY_INPUT;
        assert!(stopped_by(&authority).starts_with("emergency stop: the emergency stop button"));
        authority.mode = MotorAuthority::MODE_HOLDING;
        authority.faults = MotorAuthority::FAULT_COMMAND_LOST;
        assert_eq!(stopped_by(&authority), "the robot was stopped after this: the controller stopped answering");
        authority.faults = 0;
        assert_eq!(stopped_by(&authority), "the robot was stopped");
    }

    #[test]
    fn a_reason_is_never_cut() {
        let mut authority = faulted(u32::MAX);
        (authority.fault_cable, authority.fault_unit) = ([1; 8], [1; 8]);
        for faults in [u32::MAX, 1, 0x1fff, 0x1f_e000].into_iter().chain(FAULTS.iter().map(|(bit, _)| *bit)) {
            authority.faults = faults;
            let (said, mut status) = (stopped_by(&authority), PlanStatus::default());
            put_sentence(&mut status.reason, &said);
            assert_eq!(text_of(&status.reason), said);
            assert!(!said.contains(MORE) && !said.contains("nims status"), "{said}");
        }
        authority.faults = u32::MAX;
        assert!(stopped_by(&authority).ends_with(" more"), "{}", stopped_by(&authority));
    }
}
