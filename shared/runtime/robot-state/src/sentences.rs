//! Sentences of modes, faults, verdicts, phases and causes: what happened and what to do.

use messages::faults::{Faults, OF_CABLES, OF_UNITS};
use messages::{CONTROLLERS, MotorAuthority, MotorSlots, MotorState, PlanStatus, ROLES};
use std::fmt;

/// The text of a fault.
#[derive(Debug, Clone, Copy)]
pub struct FaultText {
    /// Its bit.
    pub bit: u32,
    /// What happened, as a clause without `; `, which would mark a cure.
    pub clause: &'static str,
    /// What followed, as the rest of the clause; a mission that ended states the clause alone.
    pub effect: &'static str,
    /// What to do.
    pub cure: &'static str,
}

/// Every fault, in the order in which several are named.
pub const FAULTS: [FaultText; 24] = [
    FaultText {
        bit: MotorAuthority::FAULT_LOST_UNIT,
        clause: "a drive unit does not answer",
        effect: "",
        cure: "check its power and its cable, then reset",
    },
    FaultText {
        bit: MotorAuthority::FAULT_UNIT_REBOOT,
        clause: "a drive unit was restarted",
        effect: " and has lost its count",
        cure: "check the supply, reset, then look where the node is and confirm the position or zero",
    },
    FaultText {
        bit: MotorAuthority::FAULT_STALL,
        clause: "a motor pushes hard and its cable does not move",
        effect: ", so this cable was released",
        cure: "free the cable, check the encoder, reset, then look where the node is and confirm the position or zero",
    },
    FaultText {
        bit: MotorAuthority::FAULT_SLACK,
        clause: "a cable is slack or broken",
        effect: "",
        cure: "make sure the node is supported, jog the cable taut or repair it, then reset",
    },
    FaultText {
        bit: MotorAuthority::FAULT_OVER_TENSION,
        clause: "a cable is too tight",
        effect: "",
        cure: "jog it out, check the calibration, then reset",
    },
    FaultText {
        bit: MotorAuthority::FAULT_OVER_CURRENT,
        clause: "a motor draws too much current",
        effect: "",
        cure: "look for what blocks the cable, then reset",
    },
    FaultText {
        bit: MotorAuthority::FAULT_RUNAWAY,
        clause: "an encoder counts against the command",
        effect: ", so this cable was released",
        cure: "check the encoder's plug and the sign of counts_per_m, reset, then look where the node is and confirm the position or zero",
    },
    FaultText {
        bit: MotorAuthority::FAULT_ENCODER_JUMP,
        clause: "an encoder has jumped",
        effect: "",
        cure: "check its plug, reset, then look where the node is and confirm the position or zero",
    },
    FaultText {
        bit: MotorAuthority::FAULT_SLIP,
        clause: "the two encoders of a cable disagree, or the second one is not read any more",
        effect: "",
        cure: "look for a cable that slips on its drum or its idler, a broken cable, a loose coupling or a failed encoder, reset, then look where the node is and confirm the position or zero",
    },
    FaultText {
        bit: MotorAuthority::FAULT_DRIVE_ERROR,
        clause: "a drive unit reports an error",
        effect: "",
        cure: "see its status bits, then reset",
    },
    FaultText {
        bit: MotorAuthority::FAULT_COMMAND_LOST,
        clause: "the controller stopped answering",
        effect: ", so the robot stopped and holds",
        cure: "when nims status shows it again, resume; if it does not come back, end nims up and start it again",
    },
    FaultText {
        bit: MotorAuthority::FAULT_LENGTH_LIMIT,
        clause: "a cable has reached its length limit",
        effect: "",
        cure: "reset, then move back inside",
    },
    FaultText {
        bit: MotorAuthority::FAULT_ESTIMATE_LOST,
        clause: "there is no valid estimate of the position",
        effect: ", so the robot stopped and holds",
        cure: "when nims status shows the estimator again, resume; if it does not come back, end nims up and start it again",
    },
    FaultText {
        bit: MotorAuthority::FAULT_SUPPLY,
        clause: "the supply voltage is low",
        effect: "",
        cure: "charge or change the battery, then reset",
    },
    FaultText {
        bit: MotorAuthority::FAULT_LONG_GAP,
        clause: "the computer had no time for the drives",
        effect: ", so the robot stopped where it was",
        cure: "look for what else runs on it; after up to a second the robot continues by itself, after more it holds, and resume continues",
    },
    FaultText {
        bit: MotorAuthority::FAULT_EMERGENCY_INPUT,
        clause: "the emergency stop button of a drive unit is pressed, or its wire is broken",
        effect: "",
        cure: "make sure that no one is in danger, release it, then reset",
    },
    FaultText {
        bit: MotorAuthority::FAULT_SUPERVISOR_LOST,
        clause: "the supervisor is gone",
        effect: ", so the robot stopped and holds",
        cure: "start nims up again, confirm the position, arm, and run the mission with --continue",
    },
    FaultText {
        bit: MotorAuthority::FAULT_PLANNER_LOST,
        clause: "the planner is gone",
        effect: ", so the robot holds after what was planned",
        cure: "when nims status shows it again, start a new motion; if it does not come back, end nims up and start it again",
    },
    FaultText {
        bit: MotorAuthority::FAULT_COMMAND_REFUSED,
        clause: "the controller sent NaN or commands far beyond the limits",
        effect: ", so the robot stopped and holds",
        cure: "look at the controller's log, swap to another controller, then resume",
    },
    FaultText {
        bit: MotorAuthority::FAULT_DIVERGING,
        clause: "the commands moved the node away from its setpoint",
        effect: "",
        cure: "reset, check that the node is where nims status says and zero it otherwise, then swap to another controller or estimator",
    },
    FaultText {
        bit: MotorAuthority::FAULT_OFF_START,
        clause: "the planned motion does not begin at the position of the node by its cables",
        effect: ", so it is not started",
        cure: "compare the estimators in nims status, restart the wrong one, then try again",
    },
    FaultText {
        bit: MotorAuthority::FAULT_BORDER,
        clause: "the node or a cable reached the border of an obstacle, of a keep-out box or of its range",
        effect: ", so the jog or soft mode ended there",
        cure: "jog the other way or another cable, move the node away, or zero it if it is elsewhere",
    },
    FaultText {
        bit: MotorAuthority::FAULT_SOFT_SPEED,
        clause: "a cable ran faster than it may in soft mode",
        effect: ", so the drives hold",
        cure: "look whether a cable is broken or slack; otherwise lead the node more slowly",
    },
    FaultText {
        bit: MotorAuthority::FAULT_COMPUTER,
        clause: "the computer was busy with other things",
        effect: " and did not give the robot's programs the processor in time",
        cure: "end what else runs on it, or permit real-time priority (`nims doctor` says how); the robot waits for up to a second, after more it \
         holds, and resume continues",
    },
];

/// Returns one sentence per fault in `bits`, with its cure.
pub fn fault_sentences(bits: u32) -> impl Iterator<Item = String> {
    each_fault(bits).map(|(_, sentence)| sentence)
}

fn each_fault(bits: u32) -> impl Iterator<Item = (u32, String)> {
    FAULTS.iter().filter(move |fault| bits & fault.bit != 0).map(|FaultText { bit, clause, effect, cure }| {
        let mut chars = clause.chars();
        let first = chars.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
        (*bit, format!("{first}{}{effect}: {cure}.", chars.as_str()))
    })
}

/// Returns the sentences of the faults of a sample; those of cables or units end with the named ones.
#[must_use]
pub fn faults_of(authority: &MotorAuthority) -> Vec<String> {
    let text_of = |(bit, text): (u32, String)| format!("{}{}.", text.trim_end_matches('.'), place(authority, bit));
    each_fault(authority.faults).map(text_of).collect()
}

/// Returns the faults of a sample: the bit of each, and its clause without its cure, with the named cables or units.
#[must_use]
pub fn fault_clauses(authority: &MotorAuthority) -> Vec<(u32, String)> {
    let present = FAULTS.iter().filter(|fault| authority.faults & fault.bit != 0);
    present
        .map(|FaultText { bit, clause, effect, .. }| (*bit, format!("{clause}{effect}{}", place(authority, *bit))))
        .collect()
}

fn place(authority: &MotorAuthority, bit: u32) -> String {
    match bit {
        bit if bit & OF_CABLES != 0 => named(&authority.fault_cable, "cable"),
        bit if bit & OF_UNITS != 0 => named(&authority.fault_unit, "unit"),
        _ => String::new(),
    }
}

/// Returns the numbers of the marked ones in parentheses: ` (units 1, 2)`; empty without any.
#[must_use]
pub fn named(marks: &[u8; 8], what: &str) -> String {
    let numbers: Vec<String> =
        marks.iter().enumerate().filter(|(_, mark)| **mark == 1).map(|(i, _)| (i + 1).to_string()).collect();
    match numbers.as_slice() {
        [] => String::new(),
        [one] => format!(" ({what} {one})"),
        several => format!(" ({what}s {})", several.join(", ")),
    }
}

/// Most bytes of faults in one answer; `nims status` shows the others.
const LISTED: usize = 360;

/// Faults with their cures, as part of a sentence; formatted without allocation.
#[derive(Debug, Clone, Copy)]
pub struct FaultList<'a>(pub &'a Faults);

impl fmt::Display for FaultList<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (mut written, mut left_out) = (0, 0);
        for FaultText { bit, clause, effect, cure } in FAULTS.iter().filter(|fault| self.0.bits & fault.bit != 0) {
            let length = clause.len() + effect.len() + cure.len();
            if written > 0 && written + length > LISTED {
                left_out += 1;
                continue;
            }
            let separator = if written > 0 { ", and " } else { "" };
            write!(f, "{separator}{clause}{effect}")?;
            if bit & OF_UNITS != 0 {
                named_in(f, "unit", &self.0.units)?;
            } else if bit & OF_CABLES != 0 {
                named_in(f, "cable", &self.0.cables)?;
            }
            write!(f, " ({cure})")?;
            written += separator.len() + length;
        }
        if left_out > 0 {
            write!(f, "; and {left_out} more, which nims status names with their cures")?;
        }
        Ok(())
    }
}

/// Writes ` on unit 1`, ` on units 1, 2`, or nothing.
fn named_in(f: &mut fmt::Formatter<'_>, what: &str, named: &[bool]) -> fmt::Result {
    let plural = if named.iter().filter(|named| **named).count() > 1 { "s" } else { "" };
    let mut separator = "";
    for (i, _) in named.iter().enumerate().filter(|(_, named)| **named) {
        match separator {
            "" => write!(f, " on {what}{plural} {}", i + 1)?,
            separator => write!(f, "{separator}{}", i + 1)?,
        }
        separator = ", ";
    }
    Ok(())
}

/// Returns the name of a mode, as commands print it.
#[must_use]
pub fn mode_name(mode: u8) -> &'static str {
    match mode {
        MotorAuthority::MODE_DISARMED => "disarmed",
        MotorAuthority::MODE_HOLDING => "holding",
        MotorAuthority::MODE_JOGGING => "jogging",
        MotorAuthority::MODE_SOFT => "soft",
        MotorAuthority::MODE_FOLLOWING => "following",
        MotorAuthority::MODE_STOPPING => "stopping",
        MotorAuthority::MODE_FAULTED => "faulted",
        MotorAuthority::MODE_EMERGENCY_STOP => "emergency stop",
        _ => "unknown",
    }
}

/// Returns the meaning of a mode for a person beside the robot.
#[must_use]
pub fn mode_sentence(mode: u8) -> &'static str {
    match mode {
        MotorAuthority::MODE_DISARMED => "The drives are off; arm to hold the cables.",
        MotorAuthority::MODE_HOLDING => "The drives hold the cables, and nothing moves.",
        MotorAuthority::MODE_JOGGING => "One cable moves slowly.",
        MotorAuthority::MODE_SOFT => "The cables carry the node and yield to a hand; hold to end it.",
        MotorAuthority::MODE_FOLLOWING => "The robot follows its motion.",
        MotorAuthority::MODE_STOPPING => "The robot is coming to rest.",
        MotorAuthority::MODE_FAULTED => "The robot is stopped by a fault and holds; remove the cause, then reset.",
        MotorAuthority::MODE_EMERGENCY_STOP => "Emergency stop: nothing moves until reset.",
        _ => "This mode is unknown to this program; it is of another version than motor-io.",
    }
}

/// Returns the state of a mission (`state` of `plan/status`), as commands print it.
#[must_use]
pub fn mission_state(state: u8) -> &'static str {
    match state {
        PlanStatus::STATE_IDLE => "idle",
        PlanStatus::STATE_READY => "ready",
        PlanStatus::STATE_RUNNING => "running",
        PlanStatus::STATE_PAUSED => "paused",
        PlanStatus::STATE_DONE => "done",
        PlanStatus::STATE_ABORTED => "aborted",
        _ => "refused",
    }
}

/// Returns the meaning of a verdict on a command.
#[must_use]
pub fn verdict_sentence(verdict: u8) -> &'static str {
    match verdict {
        MotorAuthority::VERDICT_NONE => "No command has ever arrived in this slot.",
        MotorAuthority::VERDICT_ACCEPTED => "The command is accepted.",
        MotorAuthority::VERDICT_STALE => "The command answers an earlier cycle.",
        MotorAuthority::VERDICT_EPOCH => "The command was computed before the last arm, stop, fault, reset or zero.",
        MotorAuthority::VERDICT_INCARNATION => "The controller was restarted while the robot moved.",
        MotorAuthority::VERDICT_NOT_FINITE => "The command contains NaN or infinity.",
        MotorAuthority::VERDICT_OUT_OF_LIMITS => "The command is far beyond the cable speed limit.",
        MotorAuthority::VERDICT_NO_ESTIMATE => "The controller has no valid estimate to answer for.",
        MotorAuthority::VERDICT_ABSENT => "No command has arrived for this cycle.",
        MotorAuthority::VERDICT_SEGMENT => "The command follows another motion than the robot.",
        MotorAuthority::VERDICT_LIFE => "The command was computed for a motor-io that has ended.",
        _ => "This verdict is unknown to this program; it is of another version than motor-io.",
    }
}

/// Names of the roles with slots, by index.
pub const ROLE_NAMES: [&str; ROLES] = ["controller", "estimator"];

/// Returns the name of a phase, as commands print it.
#[must_use]
pub fn phase_name(phase: u8) -> &'static str {
    match phase {
        MotorSlots::PHASE_EMPTY => "empty",
        MotorSlots::PHASE_ATTACHED => "attached",
        MotorSlots::PHASE_SHADOW => "shadow",
        MotorSlots::PHASE_QUALIFIED => "qualified",
        MotorSlots::PHASE_SWITCHING => "switching",
        MotorSlots::PHASE_ACTIVE => "active",
        MotorSlots::PHASE_PROBATION => "probation",
        MotorSlots::PHASE_QUARANTINED => "quarantined",
        _ => "unknown",
    }
}

/// Returns the cause of the last loss of trust as the predicate of a sentence; empty for none.
#[must_use]
pub fn cause_phrase(role: usize, cause: u8) -> &'static str {
    match cause {
        MotorSlots::CAUSE_NONE => "",
        MotorSlots::CAUSE_ABSENT => "stopped answering",
        MotorSlots::CAUSE_RESTARTED => "was started again",
        MotorSlots::CAUSE_NOT_FINITE => "gave NaN or infinity",
        MotorSlots::CAUSE_OUT_OF_LIMITS => "commanded velocities far beyond the limit",
        MotorSlots::CAUSE_DEVIATION if role == CONTROLLERS => "commanded other velocities than the one in charge",
        MotorSlots::CAUSE_DEVIATION => "computed another position than the one in charge",
        MotorSlots::CAUSE_NOT_VALID => "answered without a valid result",
        MotorSlots::CAUSE_PROBATION => "missed a cycle just after it had taken over",
        _ => "failed in a way unknown to this program",
    }
}

/// Why a slot is not a standby, and what to do; formatted as the predicate of a sentence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandbyRefusal {
    /// Index of the role.
    pub role: usize,
    /// Phase of the slot.
    pub phase: u8,
    /// Cause of its last loss of trust.
    pub cause: u8,
    /// Controllers: the verdict on its last command.
    pub verdict: u8,
    /// Duration of its good answers, s.
    pub well_s: f64,
    /// Duration of good answers that qualifies it, s.
    pub qualify_s: f64,
    /// Controllers: how far it would move the node off its path, m, and within which time, s.
    pub moves_off: Option<(f64, f64)>,
}

impl fmt::Display for StandbyRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { role, cause, well_s, qualify_s, .. } = *self;
        let failed = cause_phrase(role, cause);
        match self.phase {
            MotorSlots::PHASE_EMPTY if failed.is_empty() => f.write_str("is not running; start one first"),
            MotorSlots::PHASE_EMPTY => write!(f, "is not running: it {failed}; start one first"),
            MotorSlots::PHASE_ATTACHED if role == CONTROLLERS && self.verdict != MotorAuthority::VERDICT_ACCEPTED => {
                let verdict = verdict_sentence(self.verdict).trim_end_matches('.');
                write!(f, "has no good answer yet ({verdict}); ask again when it has")
            }
            MotorSlots::PHASE_ATTACHED => {
                f.write_str("has no good answer beside the one in charge yet; ask again when it has")
            }
            MotorSlots::PHASE_SHADOW if well_s == 0.0 && !failed.is_empty() => {
                write!(f, "does not qualify: it {failed}")?;
                if let Some((off_m, within_s)) = self.moves_off.filter(|_| cause == MotorSlots::CAUSE_DEVIATION) {
                    write!(f, " and would move the node {off_m:.2} m off its path within {within_s:.1} s")?;
                }
                f.write_str("; look at its log and its configuration, or swap where the robot holds")
            }
            MotorSlots::PHASE_SHADOW => {
                write!(f, "has answered well for {well_s:.1} of {qualify_s:.1} s; ask again in a second")
            }
            MotorSlots::PHASE_QUARANTINED => {
                write!(f, "was quarantined after repeated failures: it {failed}; admit it again with nims swap --admit")
            }
            _ => f.write_str("is being swapped"),
        }
    }
}

/// Returns the meaning of `position_known`, and what to do.
#[must_use]
pub fn position_sentence(position_known: u8) -> &'static str {
    match position_known {
        MotorState::POSITION_KNOWN => "The position is known.",
        MotorState::POSITION_RESTORED => {
            "The position needs a confirmation, because motor-io was started or a fault made it doubtful: look where the node is, then confirm it (nims confirm-position) or zero (nims zero)."
        }
        _ => "The position is unknown: zero where the node is (nims zero).",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_fault_bit_has_its_own_sentence() {
        let all = FAULTS.iter().fold(0, |all, fault| all | fault.bit);
        assert_eq!(all, messages::faults::HARD | messages::faults::STOPS);
        assert_eq!(FAULTS.len() as u32, all.count_ones());
        let sentences: BTreeSet<String> = fault_sentences(all).collect();
        assert_eq!(sentences.len(), FAULTS.len());
        assert!(sentences.iter().all(|s| s.starts_with(|c: char| c.is_uppercase()) && s.ends_with('.')));
    }

    #[test]
    fn the_cables_and_units_are_named() {
        let mut authority = MotorAuthority { faults: MotorAuthority::FAULT_SLACK, ..Default::default() };
        authority.fault_cable[1] = 1;
        let sentence = fault_sentences(MotorAuthority::FAULT_SLACK).next().unwrap();
        let named = format!("{} (cable 2).", sentence.strip_suffix('.').unwrap());
        assert_eq!(faults_of(&authority), [named]);
    }

    #[test]
    fn units_and_cables_stand_only_behind_what_is_of_units_and_cables() {
        let mut authority = MotorAuthority {
            faults: MotorAuthority::FAULT_LOST_UNIT | MotorAuthority::FAULT_SLACK | MotorAuthority::FAULT_LONG_GAP,
            ..Default::default()
        };
        (authority.fault_unit[0], authority.fault_unit[1], authority.fault_cable[2]) = (1, 1, 1);
        let said = faults_of(&authority);
        assert!(said[0].ends_with("(units 1, 2).") && said[1].ends_with("(cable 3)."), "{said:?}");
        assert!(!said[2].ends_with(")."), "{said:?}");
        // Every fault of the drives or the lines is one or the other, and none is both. That of the commands is
        // neither.
        let of_neither = MotorAuthority::FAULT_DIVERGING;
        assert_eq!((OF_UNITS | OF_CABLES | of_neither, OF_UNITS & OF_CABLES), (messages::faults::HARD, 0));
    }

    #[test]
    fn every_mode_and_verdict_has_a_sentence() {
        let unknown = (mode_sentence(u8::MAX), verdict_sentence(u8::MAX));
        let modes: BTreeSet<_> = (0..=6).map(mode_sentence).chain([unknown.0]).collect();
        let verdicts: BTreeSet<_> = (0..=10).map(verdict_sentence).chain([unknown.1]).collect();
        assert_eq!((modes.len(), verdicts.len()), (7 + 1, 11 + 1));
    }
}
