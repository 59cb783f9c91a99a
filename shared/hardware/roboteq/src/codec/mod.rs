//! The text lines of the protocol, without state and without allocation.
//!
//! A line ends with a carriage return, for which `_` may stand. `!` commands, `?` asks for a reading, `^` sets a
//! setting and `~` asks for one. A command is answered by `+` or `-`, a question by its name and its values. There is
//! no checksum and no number.

mod answer;
mod line;
mod name;

pub use answer::{Answer, Numbers, numbers};
pub use line::Line;
pub use name::Name;

use arrayvec::ArrayString;

/// Longest text line that this crate writes or reads, without its end.
pub const MAX_LINE: usize = 64;

/// A text line without its end.
pub type Text = ArrayString<MAX_LINE>;

/// Motors of a controller.
pub const AXES: usize = 2;

/// Largest value of a command: the speed of the setting `MXRPM`.
pub const FULL_SPEED: i32 = 1000;

/// Counts of an encoder pulse.
pub const COUNTS_PER_PULSE: f64 = 4.0;

/// A text line was changed on the wire, or is none of the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flaw;

/// Operating modes of a motor, values of [`Name::Mode`].
pub mod mode {
    /// The command is the drive output.
    pub const OPEN_LOOP: i32 = 0;
    /// The command is a speed.
    pub const CLOSED_SPEED: i32 = 1;
}

/// Bits of the answer to `?FF`.
pub mod fault {
    /// The controller is too hot.
    pub const OVERHEAT: u32 = 1;
    /// The supply is too high.
    pub const OVER_VOLTAGE: u32 = 2;
    /// The supply is too low.
    pub const UNDER_VOLTAGE: u32 = 4;
    /// An output is shorted.
    pub const SHORT: u32 = 8;
    /// An emergency stop.
    pub const EMERGENCY_STOP: u32 = 16;
    /// Sensor or setup.
    pub const SENSOR: u32 = 32;
    /// A power transistor failed.
    pub const MOSFET: u32 = 64;
    /// The settings are those of the factory.
    pub const DEFAULT_SETTINGS: u32 = 128;
}

/// Bits of the answer to `?FM`, for each motor.
pub mod motor_fault {
    /// The current is at its limit.
    pub const AMPS_LIMIT: u32 = 1;
    /// The motor stands though it is driven.
    pub const STALL: u32 = 2;
    /// The loop does not follow.
    pub const LOOP_ERROR: u32 = 4;
    /// Stopped for safety.
    pub const SAFETY_STOP: u32 = 8;
    /// A limit in forward direction.
    pub const FORWARD_LIMIT: u32 = 16;
    /// A limit in reverse direction.
    pub const REVERSE_LIMIT: u32 = 32;
    /// The current was beyond its trigger.
    pub const AMPS_TRIGGER: u32 = 64;
}
