//! A set of faults with the cables and units they name.

use crate::{CABLES, MotorAuthority, UNITS};

/// Faults that stop the whole robot and stay until a reset.
pub const HARD: u32 = MotorAuthority::FAULT_LOST_UNIT
    | MotorAuthority::FAULT_UNIT_REBOOT
    | MotorAuthority::FAULT_STALL
    | MotorAuthority::FAULT_SLACK
    | MotorAuthority::FAULT_OVER_TENSION
    | MotorAuthority::FAULT_OVER_CURRENT
    | MotorAuthority::FAULT_RUNAWAY
    | MotorAuthority::FAULT_ENCODER_JUMP
    | MotorAuthority::FAULT_DRIVE_ERROR
    | MotorAuthority::FAULT_LENGTH_LIMIT
    | MotorAuthority::FAULT_SUPPLY
    | MotorAuthority::FAULT_DIVERGING
    | MotorAuthority::FAULT_EMERGENCY_INPUT;

/// Causes of a stop on the path after which the robot holds: the motion is kept, and `resume` goes on with it.
pub const STOPS: u32 = MotorAuthority::FAULT_COMMAND_LOST
    | MotorAuthority::FAULT_ESTIMATE_LOST
    | MotorAuthority::FAULT_COMMAND_REFUSED
    | MotorAuthority::FAULT_SUPERVISOR_LOST
    | MotorAuthority::FAULT_PLANNER_LOST
    | MotorAuthority::FAULT_LONG_GAP
    | MotorAuthority::FAULT_OFF_START
    | MotorAuthority::FAULT_COMPUTER;

/// Conditions that are still there while they last, so that a reset has to wait for their end.
pub const LASTING: u32 = MotorAuthority::FAULT_LOST_UNIT
    | MotorAuthority::FAULT_DRIVE_ERROR
    | MotorAuthority::FAULT_SUPPLY
    | MotorAuthority::FAULT_EMERGENCY_INPUT;

/// Faults of a drive unit: only with these do the units mean something that a set of faults names.
pub const OF_UNITS: u32 = MotorAuthority::FAULT_LOST_UNIT
    | MotorAuthority::FAULT_UNIT_REBOOT
    | MotorAuthority::FAULT_SUPPLY
    | MotorAuthority::FAULT_EMERGENCY_INPUT
    | MotorAuthority::FAULT_DRIVE_ERROR;

/// Faults of a cable: only with these do the cables mean something that a set of faults names.
pub const OF_CABLES: u32 = MotorAuthority::FAULT_STALL
    | MotorAuthority::FAULT_SLACK
    | MotorAuthority::FAULT_OVER_TENSION
    | MotorAuthority::FAULT_OVER_CURRENT
    | MotorAuthority::FAULT_RUNAWAY
    | MotorAuthority::FAULT_ENCODER_JUMP
    | MotorAuthority::FAULT_LENGTH_LIMIT;

/// Faults after which the drive's own loop cannot be trusted, because it closes on an encoder that does not tell the truth: this
/// cable, and only this one, goes to duty 0.
pub const RELEASING: u32 = MotorAuthority::FAULT_STALL | MotorAuthority::FAULT_RUNAWAY;

/// See the module's text.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Faults {
    /// Bits `MotorAuthority::FAULT_*`.
    pub bits: u32,
    /// Cables that are named.
    pub cables: [bool; CABLES],
    /// Units that are named.
    pub units: [bool; UNITS],
    /// Cables whose drive cannot be trusted.
    pub release: [bool; CABLES],
}

impl Faults {
    /// A fault of the whole robot.
    pub fn robot(&mut self, bit: u32) {
        self.bits |= bit;
    }

    /// A fault of a cable (from 0).
    pub fn cable(&mut self, bit: u32, cable: usize) {
        self.bits |= bit;
        self.cables[cable] = true;
        self.release[cable] |= bit & RELEASING != 0;
    }

    /// A fault of a unit (from 0).
    pub fn unit(&mut self, bit: u32, unit: usize) {
        self.bits |= bit;
        self.units[unit] = true;
    }

    /// Adds what another set names.
    pub fn add(&mut self, other: &Faults) {
        self.bits |= other.bits;
        for i in 0..CABLES {
            self.cables[i] |= other.cables[i];
            self.release[i] |= other.release[i];
        }
        for i in 0..UNITS {
            self.units[i] |= other.units[i];
        }
    }

    /// True if there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bits == 0
    }
}
