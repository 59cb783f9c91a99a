//! Registers, their scales, and modes; from the maker's register reference.

use super::subframe::{Resolution, Value};

/// Counts of this family per turn: the position's resolution as a 32-bit integer.
pub const COUNTS_PER_TURN: f64 = 100_000.0;

/// Registers that this crate uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Register;

#[allow(missing_docs)] // the maker's names
impl Register {
    pub const MODE: u16 = 0x000;
    pub const POSITION: u16 = 0x001;
    pub const VELOCITY: u16 = 0x002;
    pub const TORQUE: u16 = 0x003;
    pub const Q_CURRENT: u16 = 0x004;
    pub const D_CURRENT: u16 = 0x005;
    pub const ABSOLUTE_POSITION: u16 = 0x006;
    pub const POWER: u16 = 0x007;
    pub const MOTOR_TEMPERATURE: u16 = 0x00A;
    pub const TRAJECTORY_COMPLETE: u16 = 0x00B;
    pub const HOME_STATE: u16 = 0x00C;
    pub const VOLTAGE: u16 = 0x00D;
    pub const TEMPERATURE: u16 = 0x00E;
    pub const FAULT: u16 = 0x00F;
    pub const COMMAND_POSITION: u16 = 0x020;
    pub const COMMAND_VELOCITY: u16 = 0x021;
    pub const COMMAND_TORQUE: u16 = 0x022;
    pub const COMMAND_KP_SCALE: u16 = 0x023;
    pub const COMMAND_KD_SCALE: u16 = 0x024;
    pub const COMMAND_KI_LIMIT_SCALE: u16 = 0x02B;
    /// First and last of the other settings of a command.
    pub const COMMAND_FIRST: u16 = 0x022;
    pub const COMMAND_LAST: u16 = 0x02D;
    pub const COMMAND_TIMEOUT: u16 = 0x027;
    /// Encoder of the first source, turns of that encoder; those of the other sources are 2 and 4 further.
    pub const ENCODER_POSITION: u16 = 0x050;
    pub const AUX1_GPIO: u16 = 0x05E;
    pub const AUX2_GPIO: u16 = 0x05F;
    pub const MILLISECONDS: u16 = 0x070;
    pub const MODEL: u16 = 0x100;
    pub const FIRMWARE: u16 = 0x101;
    pub const REGISTER_MAP: u16 = 0x102;
    pub const SERIAL_NUMBER: u16 = 0x120;
}

/// Sources of `motor_position`, each of which may be an encoder.
pub const SOURCES: u8 = 3;

impl Register {
    /// Position of the encoder of a source, turns of that encoder from 0 to 1.
    #[must_use]
    pub fn encoder_position(source: u8) -> u16 {
        Register::ENCODER_POSITION + 2 * u16::from(source)
    }
}

/// What a unit does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mode(pub i8);

#[allow(missing_docs)] // the maker's names
impl Mode {
    pub const STOPPED: Mode = Mode(0);
    pub const FAULT: Mode = Mode(1);
    pub const POSITION: Mode = Mode(10);
    pub const TIMEOUT: Mode = Mode(11);
    pub const ZERO_VELOCITY: Mode = Mode(12);
    pub const BRAKE: Mode = Mode(15);

    /// True where only a stop brings the unit out of it.
    #[must_use]
    pub fn is_latched(self) -> bool {
        matches!(self, Mode::FAULT | Mode::TIMEOUT)
    }
}

/// Size of one step of a register's integers, for 8, 16 and 32 bits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale(pub [f32; 3]);

impl Scale {
    /// Turns.
    pub const POSITION: Scale = Scale([0.01, 0.000_1, 0.000_01]);
    /// Turns per second.
    pub const VELOCITY: Scale = Scale([0.1, 0.000_25, 0.000_01]);
    /// A and degrees Celsius.
    pub const CURRENT: Scale = Scale([1.0, 0.1, 0.001]);
    /// V.
    pub const VOLTAGE: Scale = Scale([0.5, 0.1, 0.001]);
    /// N m.
    pub const TORQUE: Scale = Scale([0.5, 0.01, 0.001]);
    /// s.
    pub const TIME: Scale = Scale([0.01, 0.001, 0.000_001]);
    /// W.
    pub const POWER: Scale = Scale([10.0, 0.05, 0.000_1]);
    /// Whole numbers.
    pub const WHOLE: Scale = Scale([1.0, 1.0, 1.0]);

    /// A value on the wire: cut to whole steps and to the type's range, with its smallest integer for "not a number".
    #[must_use]
    pub fn encode(self, value: f32, resolution: Resolution) -> Value {
        let [small, middle, large] = self.0;
        // `as` saturates; the smallest integer is kept for what is no number, infinity too.
        let steps = |step: f32, most: f32| (value / step).clamp(-most, most);
        match resolution {
            Resolution::F32 => Value::F32(value),
            Resolution::I8 if !value.is_finite() => Value::I8(i8::MIN),
            Resolution::I16 if !value.is_finite() => Value::I16(i16::MIN),
            Resolution::I32 if !value.is_finite() => Value::I32(i32::MIN),
            Resolution::I8 => Value::I8(steps(small, 127.0) as i8),
            Resolution::I16 => Value::I16(steps(middle, 32_767.0) as i16),
            Resolution::I32 => Value::I32((steps(large, i32::MAX as f32) as i32).max(-i32::MAX)),
        }
    }

    /// Meaning of a value on the wire; NaN where it is none.
    #[must_use]
    pub fn decode(self, value: Value) -> f32 {
        let [small, middle, large] = self.0;
        match value {
            Value::F32(value) => value,
            _ => value.integer().map_or(f32::NAN, |steps| {
                steps as f32
                    * match value.resolution() {
                        Resolution::I8 => small,
                        Resolution::I16 => middle,
                        _ => large,
                    }
            }),
        }
    }
}
