//! Commands that change something.

use drives::CommandName;

use super::fields::{Fields, Motor, Pid, by_motor};
use crate::crc::crc16;
use crate::packet::Packet;

/// A command that changes something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Write {
    /// 14: time without a packet after which both motors stop, tenths of a second; 0: off.
    Watchdog(u8),
    /// 20: sets both encoders to zero.
    ResetEncoders,
    /// 22, 23: sets an encoder to this count.
    SetEncoder(Motor, i32),
    /// 28, 29: gains of a velocity loop.
    VelocityPid(Motor, Pid),
    /// 32, 33: duty in 1/32767 of the supply.
    Duty(Motor, i16),
    /// 34: both duties.
    Duties([i16; 2]),
    /// 35, 36: closed-loop speed, counts per second.
    Speed(Motor, i32),
    /// 37: both speeds.
    Speeds([i32; 2]),
    /// 38, 39: as 35, 36 with a ramp, counts per second squared.
    SpeedRamp(Motor, u32, i32),
    /// 40: both speeds, one ramp.
    SpeedsRamp(u32, [i32; 2]),
    /// 50: each speed with its own ramp.
    SpeedsRamps([(u32, i32); 2]),
    /// 94: stores the settings over a power cut. Slow; not in a control loop.
    Save,
    /// 133, 134: largest motor current, 10 mA.
    MaxCurrent(Motor, u32),
}

impl Write {
    /// The command's number in the manual.
    #[must_use]
    pub fn code(&self) -> u8 {
        match *self {
            Write::Watchdog(_) => 14,
            Write::ResetEncoders => 20,
            Write::SetEncoder(motor, _) => by_motor(motor, 22, 23),
            Write::VelocityPid(motor, _) => by_motor(motor, 28, 29),
            Write::Duty(motor, _) => by_motor(motor, 32, 33),
            Write::Duties(_) => 34,
            Write::Speed(motor, _) => by_motor(motor, 35, 36),
            Write::Speeds(_) => 37,
            Write::SpeedRamp(motor, _, _) => by_motor(motor, 38, 39),
            Write::SpeedsRamp(_, _) => 40,
            Write::SpeedsRamps(_) => 50,
            Write::Save => 94,
            Write::MaxCurrent(motor, _) => by_motor(motor, 133, 134),
        }
    }

    /// True for a command that can be repeated without another effect.
    #[must_use]
    pub fn is_idempotent(&self) -> bool {
        // Setting an encoder again after it moved loses that motion.
        !matches!(self, Write::ResetEncoders | Write::SetEncoder(..) | Write::Save)
    }

    /// The bytes to send.
    #[must_use]
    pub fn encode(&self, address: u8) -> Packet {
        let mut packet = Packet::new();
        packet.extend(&[address, self.code()]);
        match *self {
            Write::Watchdog(tenths) => packet.extend(&[tenths]),
            Write::ResetEncoders => {}
            Write::SetEncoder(_, value) | Write::Speed(_, value) => packet.extend(&value.to_be_bytes()),
            Write::VelocityPid(_, pid) => {
                // The order differs from the one in the answer to 55 and 56.
                for value in [pid.d, pid.p, pid.i, pid.counts_s_at_full_duty] {
                    packet.extend(&value.to_be_bytes());
                }
            }
            Write::Duty(_, duty) => packet.extend(&duty.to_be_bytes()),
            Write::Duties(duties) => duties.iter().for_each(|duty| packet.extend(&duty.to_be_bytes())),
            Write::Speeds(speeds) => speeds.iter().for_each(|speed| packet.extend(&speed.to_be_bytes())),
            Write::SpeedRamp(_, ramp, speed) => {
                packet.extend(&ramp.to_be_bytes());
                packet.extend(&speed.to_be_bytes());
            }
            Write::SpeedsRamp(ramp, speeds) => {
                packet.extend(&ramp.to_be_bytes());
                speeds.iter().for_each(|speed| packet.extend(&speed.to_be_bytes()));
            }
            Write::SpeedsRamps(both) => {
                for (ramp, speed) in both {
                    packet.extend(&ramp.to_be_bytes());
                    packet.extend(&speed.to_be_bytes());
                }
            }
            Write::Save => packet.extend(&SAVE_KEY.to_be_bytes()),
            Write::MaxCurrent(_, centiamps) => {
                packet.extend(&centiamps.to_be_bytes());
                packet.extend(&0u32.to_be_bytes());
            }
        }
        let crc = crc16(&packet);
        packet.extend(&crc.to_be_bytes());
        packet
    }

    /// Decodes the command with this number and payload; `None` for an unknown or malformed one.
    #[must_use]
    pub fn decode(code: u8, payload: &[u8]) -> Option<Write> {
        use Motor::{One, Two};
        let mut fields = Fields(payload);
        let write = match code {
            14 => Write::Watchdog(fields.u8()?),
            20 => Write::ResetEncoders,
            22 => Write::SetEncoder(One, fields.i32()?),
            23 => Write::SetEncoder(Two, fields.i32()?),
            28 | 29 => {
                let [d, p, i, counts_s_at_full_duty] = [fields.u32()?, fields.u32()?, fields.u32()?, fields.u32()?];
                let motor = if code == 28 { One } else { Two };
                Write::VelocityPid(motor, Pid { p, i, d, counts_s_at_full_duty })
            }
            32 => Write::Duty(One, fields.i16()?),
            33 => Write::Duty(Two, fields.i16()?),
            34 => Write::Duties([fields.i16()?, fields.i16()?]),
            35 => Write::Speed(One, fields.i32()?),
            36 => Write::Speed(Two, fields.i32()?),
            37 => Write::Speeds([fields.i32()?, fields.i32()?]),
            38 => Write::SpeedRamp(One, fields.u32()?, fields.i32()?),
            39 => Write::SpeedRamp(Two, fields.u32()?, fields.i32()?),
            40 => Write::SpeedsRamp(fields.u32()?, [fields.i32()?, fields.i32()?]),
            50 => Write::SpeedsRamps([(fields.u32()?, fields.i32()?), (fields.u32()?, fields.i32()?)]),
            94 => (fields.u32()? == SAVE_KEY).then_some(Write::Save)?,
            133 | 134 => {
                let (motor, centiamps) = (if code == 133 { One } else { Two }, fields.u32()?);
                fields.u32()?;
                Write::MaxCurrent(motor, centiamps)
            }
            _ => return None,
        };
        fields.0.is_empty().then_some(write)
    }
}

impl Write {
    /// Its name and number for messages.
    #[must_use]
    pub fn command_name(self) -> CommandName {
        let words = match self {
            Write::Watchdog(_) => "set watchdog",
            Write::ResetEncoders => "reset encoders",
            Write::SetEncoder(..) => "set encoder",
            Write::VelocityPid(..) => "set velocity gains",
            Write::Duty(..) | Write::Duties(_) => "set duty",
            Write::Speed(..) | Write::Speeds(_) => "set speed",
            Write::SpeedRamp(..) | Write::SpeedsRamp(..) | Write::SpeedsRamps(_) => "set speed with ramp",
            Write::Save => "save settings",
            Write::MaxCurrent(..) => "set largest current",
        };
        CommandName { words, code: Some(self.code().into()) }
    }
}

/// Key that [`Write::Save`] carries, so that noise does not wear out the memory.
pub const SAVE_KEY: u32 = 0xE22E_AB7A;
