//! Reason for which motor-io ended a motion, or did not take it up.

use messages::MotorAuthority;
use messages::faults::Faults;
use robot_state::Reason;

/// Returns why motor-io ended a motion that was planned for its life `life`.
pub(crate) fn stopped_by(authority: &MotorAuthority, life: u64) -> Reason {
    let faults = Faults::from_authority(authority);
    match authority.mode {
        MotorAuthority::MODE_EMERGENCY_STOP => Reason::EndedByEmergencyStop { faults },
        MotorAuthority::MODE_FAULTED => Reason::EndedByFault { faults },
        _ if authority.header.life != life => Reason::EndedByRestart,
        MotorAuthority::MODE_DISARMED => Reason::EndedByDisarm,
        // An earlier latched fault need not be the cause of this stop.
        _ if !faults.is_empty() => Reason::EndedAfterFault { faults },
        _ => Reason::EndedByStop,
    }
}

/// Returns why motor-io did not take up a motion within that time, s.
pub(crate) fn not_taken_up(authority: &MotorAuthority, within_s: f64) -> Reason {
    match is_refused(authority) {
        true => Reason::EndedCommandsRefused { within_s },
        false => Reason::EndedNotTakenUp { within_s },
    }
}

/// Returns whether motor-io rejects the commands of the controller in charge.
fn is_refused(authority: &MotorAuthority) -> bool {
    let [slot, _] = authority.in_charge;
    let verdict = authority.verdict.get(usize::from(slot));
    verdict.is_some_and(|verdict| {
        [MotorAuthority::VERDICT_NOT_FINITE, MotorAuthority::VERDICT_OUT_OF_LIMITS].contains(verdict)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stop_has_its_own_reason() {
        let mut authority = MotorAuthority { mode: MotorAuthority::MODE_FAULTED, ..MotorAuthority::default() };
        (authority.header.life, authority.faults) = (7, MotorAuthority::FAULT_SLACK);
        authority.fault_cable[1] = 1;
        let mut faults = Faults::default();
        faults.cable(MotorAuthority::FAULT_SLACK, 1);
        let mut stopped = |mode, life| {
            authority.mode = mode;
            stopped_by(&authority, life)
        };
        assert_eq!(stopped(MotorAuthority::MODE_FAULTED, 7), Reason::EndedByFault { faults });
        assert_eq!(stopped(MotorAuthority::MODE_EMERGENCY_STOP, 7), Reason::EndedByEmergencyStop { faults });
        assert_eq!(stopped(MotorAuthority::MODE_HOLDING, 7), Reason::EndedAfterFault { faults });
        assert_eq!(stopped(MotorAuthority::MODE_DISARMED, 7), Reason::EndedByDisarm);
        assert_eq!(stopped(MotorAuthority::MODE_DISARMED, 6), Reason::EndedByRestart);
        authority.faults = 0;
        assert_eq!(
            stopped_by(&MotorAuthority { mode: MotorAuthority::MODE_HOLDING, ..authority }, 7),
            Reason::EndedByStop
        );
    }
}
