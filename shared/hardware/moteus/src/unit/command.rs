//! The command that a unit has.

use crate::codec::{Mode, Register};

/// Settings of a command besides those that the unit acts on.
const OTHERS: usize = (Register::COMMAND_LAST - Register::COMMAND_FIRST + 1) as usize;

/// Their values after the mode was written, from the maker's reference: feedforward torque, gain scales, largest
/// torque, stop position, (time limit), velocity and acceleration limits, overrides, integral scale, bounds.
const OTHER_DEFAULTS: [f32; OTHERS] =
    [0.0, 1.0, 1.0, f32::NAN, f32::NAN, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.0, f32::NAN, 0.0];

/// The command that a unit has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Command {
    pub(super) mode: Mode,
    /// Turns; NaN: where the motor is.
    pub(super) position: f32,
    /// Turns per second.
    pub(super) velocity: f32,
    /// s; 0: the default, NaN: none.
    pub(super) timeout_s: f32,
    /// The other settings, by register.
    pub(super) others: [f32; OTHERS],
}

impl Command {
    /// The command of a unit that was just switched on.
    pub(super) const NONE: Command =
        Command { mode: Mode::STOPPED, position: 0.0, velocity: 0.0, timeout_s: 0.0, others: OTHER_DEFAULTS };

    fn other(&self, register: u16) -> f32 {
        self.others[usize::from(register - Register::COMMAND_FIRST)]
    }

    /// True where neither position nor velocity are controlled, but only a torque.
    pub(super) fn is_torque(&self) -> bool {
        self.other(Register::COMMAND_KP_SCALE) == 0.0 && self.other(Register::COMMAND_KD_SCALE) == 0.0
    }

    /// Feedforward torque, N m.
    pub(super) fn torque_n_m(&self) -> f32 {
        let torque_n_m = self.other(Register::COMMAND_TORQUE);
        if torque_n_m.is_finite() { torque_n_m } else { 0.0 }
    }
}
