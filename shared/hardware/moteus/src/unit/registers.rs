//! Registers of a unit.

use super::Unit;
use super::command::Command;
use crate::codec::{COUNTS_PER_TURN, Mode, Register, Resolution, Scale, Value};

/// Codes of errors: unknown register, and one that cannot be written.
const UNKNOWN: u16 = 1;
const READ_ONLY: u16 = 2;

impl Unit {
    /// Writes a register of the command; returns the mode, if it was that.
    pub(super) fn write(&mut self, register: u16, value: Value) -> Result<Option<Mode>, u16> {
        match register {
            Register::MODE => {
                let mode = Mode(Scale::WHOLE.decode(value) as i8);
                self.command = Command { mode, ..Command::NONE };
                return Ok(Some(mode));
            }
            Register::COMMAND_POSITION => self.command.position = Scale::POSITION.decode(value),
            Register::COMMAND_VELOCITY => self.command.velocity = Scale::VELOCITY.decode(value),
            Register::COMMAND_TIMEOUT => {
                let timeout_s = Scale::TIME.decode(value);
                self.command.timeout_s = self.kept_timeout_s.unwrap_or(timeout_s);
            }
            Register::COMMAND_FIRST..=Register::COMMAND_LAST => {
                self.command.others[usize::from(register - Register::COMMAND_FIRST)] =
                    other_scale(register).decode(value);
            }
            _ if self.read(register, Resolution::I32).is_some() => return Err(READ_ONLY),
            _ => return Err(UNKNOWN),
        }
        Ok(None)
    }

    /// Reads a register; `None` for an unknown one.
    pub(super) fn read(&self, register: u16, resolution: Resolution) -> Option<Value> {
        let measured = &self.measured;
        let (scale, value) = match register {
            Register::MODE => return Some(whole(i32::from(self.mode.0), resolution)),
            Register::POSITION => return Some(self.position(resolution)),
            Register::VELOCITY => (Scale::VELOCITY, measured.speed_counts_s / COUNTS_PER_TURN),
            Register::TORQUE => (Scale::TORQUE, self.options.torque_constant_n_m_a * measured.current_a),
            Register::Q_CURRENT => (Scale::CURRENT, measured.current_a),
            Register::D_CURRENT => (Scale::CURRENT, 0.0),
            Register::ABSOLUTE_POSITION => (Scale::POSITION, f64::NAN),
            Register::POWER => (Scale::POWER, measured.duty * measured.supply_v * measured.current_a),
            Register::MOTOR_TEMPERATURE => (Scale::CURRENT, 0.0),
            Register::TRAJECTORY_COMPLETE => return Some(whole(1, resolution)),
            Register::HOME_STATE => return Some(whole(1, resolution)),
            Register::VOLTAGE => (Scale::VOLTAGE, measured.supply_v),
            Register::TEMPERATURE => (Scale::CURRENT, measured.temperature_c),
            Register::FAULT => return Some(whole(i32::from(self.fault), resolution)),
            Register::COMMAND_POSITION => (Scale::POSITION, f64::from(self.command.position)),
            Register::COMMAND_VELOCITY => (Scale::VELOCITY, f64::from(self.command.velocity)),
            Register::COMMAND_TIMEOUT => (Scale::TIME, f64::from(self.command.timeout_s)),
            Register::COMMAND_FIRST..=Register::COMMAND_LAST => {
                let value = self.command.others[usize::from(register - Register::COMMAND_FIRST)];
                (other_scale(register), f64::from(value))
            }
            // Each encoder within its own turn, where it stands, whatever the position is.
            Register::ENCODER_POSITION | 0x052 | 0x054 => {
                let second = u16::from(self.options.second_source) == (register - Register::ENCODER_POSITION) / 2;
                let counts = if second { measured.second_counts } else { measured.counts };
                let steps = counts.rem_euclid(COUNTS_PER_TURN as i64);
                let missing = second && measured.second_fails;
                (Scale::POSITION, if missing { f64::NAN } else { steps as f64 / COUNTS_PER_TURN })
            }
            Register::AUX1_GPIO => return Some(whole(0, resolution)),
            Register::AUX2_GPIO => return Some(whole(i32::from(measured.pins), resolution)),
            Register::MILLISECONDS => {
                let ms = self.now_ns.saturating_sub(self.booted_ns) / 1_000_000;
                return Some(whole(ms as i32, resolution));
            }
            Register::MODEL => return words(0x0100_0001, resolution),
            Register::FIRMWARE => return words(self.options.firmware, resolution),
            Register::REGISTER_MAP => return words(5, resolution),
            Register::SERIAL_NUMBER => return words(i32::from(self.options.address), resolution),
            _ => return None,
        };
        Some(scale.encode(value as f32, resolution))
    }

    fn position(&self, resolution: Resolution) -> Value {
        let count = self.count();
        if resolution == Resolution::I32 && !self.options.rounds_position {
            let most = i64::from(i32::MAX);
            return Value::I32(count.clamp(-most, most) as i32);
        }
        Scale::POSITION.encode((count as f64 / COUNTS_PER_TURN) as f32, resolution)
    }
}

fn other_scale(register: u16) -> Scale {
    match register {
        0x022 | 0x025 => Scale::TORQUE,
        0x026 => Scale::POSITION,
        0x028 => Scale::VELOCITY,
        0x02A => Scale::VOLTAGE,
        0x02C => Scale::CURRENT,
        // Shares of a gain; the largest integer is 1.
        0x023 | 0x024 | 0x02B => Scale([1.0 / 127.0, 1.0 / 32_767.0, 1.0 / 2_147_483_647.0]),
        _ => Scale::WHOLE,
    }
}

/// A whole number; counters wrap at the type's range.
fn whole(value: i32, resolution: Resolution) -> Value {
    match resolution {
        Resolution::I8 => Value::I8(value as i8),
        Resolution::I16 => Value::I16(value as i16),
        Resolution::I32 => Value::I32(value),
        Resolution::F32 => Value::F32(value as f32),
    }
}

/// A word of 32 bits, which has no other type.
fn words(value: i32, resolution: Resolution) -> Option<Value> {
    (resolution == Resolution::I32).then_some(Value::I32(value))
}
