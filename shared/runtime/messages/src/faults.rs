//! A set of faults with the cables and units they name.

use crate::{CABLES, MotorAuthority, UNITS};

/// Faults that stop the whole robot until a reset.
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
    | MotorAuthority::FAULT_EMERGENCY_INPUT
    | MotorAuthority::FAULT_SLIP;

/// Causes of a stop on the path after which the robot holds and keeps the motion for `resume`.
pub const STOPS: u32 = MotorAuthority::FAULT_COMMAND_LOST
    | MotorAuthority::FAULT_ESTIMATE_LOST
    | MotorAuthority::FAULT_COMMAND_REFUSED
    | MotorAuthority::FAULT_SUPERVISOR_LOST
    | MotorAuthority::FAULT_PLANNER_LOST
    | MotorAuthority::FAULT_LONG_GAP
    | MotorAuthority::FAULT_OFF_START
    | MotorAuthority::FAULT_BORDER
    | MotorAuthority::FAULT_SOFT_SPEED
    | MotorAuthority::FAULT_COMPUTER;

/// Faults with a lasting condition: a reset waits for its end.
pub const LASTING: u32 = MotorAuthority::FAULT_LOST_UNIT
    | MotorAuthority::FAULT_DRIVE_ERROR
    | MotorAuthority::FAULT_SUPPLY
    | MotorAuthority::FAULT_EMERGENCY_INPUT;

/// Faults of a drive unit: only these use the units of a set of faults.
pub const OF_UNITS: u32 = MotorAuthority::FAULT_LOST_UNIT
    | MotorAuthority::FAULT_UNIT_REBOOT
    | MotorAuthority::FAULT_SUPPLY
    | MotorAuthority::FAULT_EMERGENCY_INPUT
    | MotorAuthority::FAULT_DRIVE_ERROR;

/// Faults of a cable: only these use the cables of a set of faults.
pub const OF_CABLES: u32 = MotorAuthority::FAULT_STALL
    | MotorAuthority::FAULT_SLACK
    | MotorAuthority::FAULT_OVER_TENSION
    | MotorAuthority::FAULT_OVER_CURRENT
    | MotorAuthority::FAULT_RUNAWAY
    | MotorAuthority::FAULT_ENCODER_JUMP
    | MotorAuthority::FAULT_LENGTH_LIMIT
    | MotorAuthority::FAULT_SLIP;

/// Faults after which the velocity loop of the drive cannot be trusted, because its encoder may be wrong: only this
/// cable goes to duty 0, and always.
pub const RELEASING: u32 = MotorAuthority::FAULT_STALL | MotorAuthority::FAULT_RUNAWAY;

/// Faults after which a cable that they name may be at duty 0. After a slip it is only where the encoder of the drive's
/// loop may be the wrong one, which [`Faults::release`] marks.
pub const MAY_RELEASE: u32 = RELEASING | MotorAuthority::FAULT_SLIP;

/// Set of faults with the cables and units that they name.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Faults {
    /// Bits `MotorAuthority::FAULT_*`.
    pub bits: u32,
    /// Named cables.
    pub cables: [bool; CABLES],
    /// Named units.
    pub units: [bool; UNITS],
    /// Cables whose drive cannot be trusted.
    pub release: [bool; CABLES],
}

impl Faults {
    /// Returns the faults that a sample names.
    #[must_use]
    pub fn from_authority(authority: &MotorAuthority) -> Self {
        let named = |mark: u8| mark == 1;
        let (cables, units) = (authority.fault_cable.map(named), authority.fault_unit.map(named));
        Self { bits: authority.faults, cables, units, ..Self::default() }
    }

    /// Adds a fault of the whole robot.
    pub fn robot(&mut self, bit: u32) {
        self.bits |= bit;
    }

    /// Adds a fault of a cable (from 0).
    pub fn cable(&mut self, bit: u32, cable: usize) {
        self.bits |= bit;
        self.cables[cable] = true;
        self.release[cable] |= bit & RELEASING != 0;
    }

    /// Marks a cable (from 0) whose drive cannot be trusted.
    pub fn release(&mut self, cable: usize) {
        self.release[cable] = true;
    }

    /// Adds a fault of a unit (from 0).
    pub fn unit(&mut self, bit: u32, unit: usize) {
        self.bits |= bit;
        self.units[unit] = true;
    }

    /// Adds another set.
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

    /// Returns whether the set is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bits == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_releases_a_cable_only_where_it_is_marked() {
        for bit in (0..u32::BITS).map(|bit| 1 << bit) {
            let mut found = Faults::default();
            found.cable(bit, 2);
            assert_eq!(found.release[2], RELEASING & bit != 0);
            assert!(!found.release[2] || MAY_RELEASE & bit != 0);
        }
        let mut found = Faults::default();
        found.cable(MotorAuthority::FAULT_SLIP, 2);
        found.release(2);
        assert!(found.release[2] && MAY_RELEASE & found.bits != 0);
    }
}
