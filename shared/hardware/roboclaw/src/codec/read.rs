//! Questions and their answers.

use std::fmt;

use drives::CommandName;

use super::fields::{Fields, MAX_VERSION, Pid, with_reply_crc};
use crate::crc::Crc;
use crate::packet::Packet;
use crate::status::{Status, StatusWidth};

/// A question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)] // the names are the manual's; the answers are described at `Reply`
pub enum Read {
    Watchdog = 15,
    Encoder1 = 16,
    Encoder2 = 17,
    Speed1 = 18,
    Speed2 = 19,
    Version = 21,
    MainBattery = 24,
    LogicBattery = 25,
    RawSpeed1 = 30,
    RawSpeed2 = 31,
    Pwms = 48,
    Currents = 49,
    VelocityPid1 = 55,
    VelocityPid2 = 56,
    Encoders = 78,
    RawSpeeds = 79,
    Temperature = 82,
    Status = 90,
    Speeds = 108,
    MaxCurrent1 = 135,
    MaxCurrent2 = 136,
}

/// Every question.
pub const READS: [Read; 21] = [
    Read::Watchdog,
    Read::Encoder1,
    Read::Encoder2,
    Read::Speed1,
    Read::Speed2,
    Read::Version,
    Read::MainBattery,
    Read::LogicBattery,
    Read::RawSpeed1,
    Read::RawSpeed2,
    Read::Pwms,
    Read::Currents,
    Read::VelocityPid1,
    Read::VelocityPid2,
    Read::Encoders,
    Read::RawSpeeds,
    Read::Temperature,
    Read::Status,
    Read::Speeds,
    Read::MaxCurrent1,
    Read::MaxCurrent2,
];

/// Length of an answer without its checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReplyLength {
    /// A fixed number of bytes.
    Bytes(usize),
    /// Depends on the firmware, see [`StatusWidth`].
    Status,
    /// Ends with a zero byte, at most [`MAX_VERSION`].
    Text,
}

/// Version text of a unit, without its line end.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Version(Packet);

impl Version {
    /// A version text; at most 46 bytes of it are kept, so that it fits with its end mark.
    #[must_use]
    pub fn new(text: &str) -> Version {
        let mut packet = Packet::new();
        packet.extend(text.as_bytes().get(..MAX_VERSION - 2).unwrap_or(text.as_bytes()));
        Version(packet)
    }

    /// The text; empty where the unit sent bytes that are not text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        std::str::from_utf8(&self.0).unwrap_or_default().trim_end()
    }
}

impl fmt::Debug for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

/// An answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reply {
    /// Watchdog time, tenths of a second; 0: off.
    Watchdog(u8),
    /// Encoder counts modulo 2^32, and flags: 1 underflow, 2 backward, 4 overflow.
    Count(u32, u8),
    /// Speed of one motor, counts per second.
    Speed(i32),
    /// Version text.
    Version(Version),
    /// Supply voltage, 0.1 V.
    Battery(u16),
    /// Duty of both motors, 1/32767 of the supply.
    Pwms([i16; 2]),
    /// Current of both motors, 10 mA.
    Currents([i16; 2]),
    /// Gains of the velocity loop.
    VelocityPid(Pid),
    /// Counts of both encoders modulo 2^32.
    Counts([u32; 2]),
    /// Counts per second of both motors.
    Speeds([i32; 2]),
    /// Board temperature, 0.1 degrees Celsius.
    Temperature(i16),
    /// Conditions, and the width in which the unit sent them.
    Status(Status, StatusWidth),
    /// Largest motor current, 10 mA.
    MaxCurrent(u32),
}

/// Reason why bytes are not the answer to a question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flaw {
    /// The length is wrong.
    Length,
    /// From another unit, to another question, or changed on the wire.
    Checksum,
}

impl Read {
    /// The command's number in the manual.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The question with this number.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Read> {
        READS.into_iter().find(|read| read.code() == code)
    }

    /// The bytes to send.
    #[must_use]
    pub fn encode(self, address: u8) -> Packet {
        let mut packet = Packet::new();
        packet.extend(&[address, self.code()]);
        packet
    }

    /// Length of the answer.
    #[must_use]
    pub fn reply_length(self) -> ReplyLength {
        match self {
            Read::Watchdog => ReplyLength::Bytes(1),
            Read::MainBattery | Read::LogicBattery | Read::Temperature => ReplyLength::Bytes(2),
            Read::Pwms | Read::Currents => ReplyLength::Bytes(4),
            Read::Encoder1 | Read::Encoder2 | Read::Speed1 | Read::Speed2 | Read::RawSpeed1 | Read::RawSpeed2 => {
                ReplyLength::Bytes(5)
            }
            Read::Encoders | Read::RawSpeeds | Read::Speeds | Read::MaxCurrent1 | Read::MaxCurrent2 => {
                ReplyLength::Bytes(8)
            }
            Read::VelocityPid1 | Read::VelocityPid2 => ReplyLength::Bytes(16),
            Read::Status => ReplyLength::Status,
            Read::Version => ReplyLength::Text,
        }
    }

    /// The answer in `bytes`, which end with the checksum and hold nothing else.
    pub fn decode(self, address: u8, bytes: &[u8]) -> Result<Reply, Flaw> {
        let payload = bytes.len().checked_sub(2).and_then(|end| bytes.get(..end)).ok_or(Flaw::Length)?;
        let fits = match self.reply_length() {
            ReplyLength::Bytes(n) => payload.len() == n,
            ReplyLength::Status => payload.len() == 2 || payload.len() == 4,
            ReplyLength::Text => payload.len() <= MAX_VERSION && payload.last() == Some(&0),
        };
        if !fits {
            return Err(Flaw::Length);
        }
        if Crc::default().with(&[address, self.code()]).with(bytes).value() != 0 {
            return Err(Flaw::Checksum);
        }
        self.decode_payload(payload).ok_or(Flaw::Length)
    }

    fn decode_payload(self, payload: &[u8]) -> Option<Reply> {
        let mut fields = Fields(payload);
        Some(match self {
            Read::Watchdog => Reply::Watchdog(fields.u8()?),
            Read::Encoder1 | Read::Encoder2 => Reply::Count(fields.u32()?, fields.u8()?),
            Read::Speed1 | Read::Speed2 | Read::RawSpeed1 | Read::RawSpeed2 => {
                // Some firmware sends a signed number, some a magnitude, both with a flag for backward: this handles
                // either.
                let (value, backward) = (fields.i32()?, fields.u8()? & 1 != 0);
                Reply::Speed(if backward { value.wrapping_abs().wrapping_neg() } else { value.wrapping_abs() })
            }
            Read::Version => {
                let mut text = Packet::new();
                text.extend(payload.get(..payload.len() - 1)?);
                Reply::Version(Version(text))
            }
            Read::MainBattery | Read::LogicBattery => Reply::Battery(fields.u16()?),
            Read::Pwms => Reply::Pwms([fields.i16()?, fields.i16()?]),
            Read::Currents => Reply::Currents([fields.i16()?, fields.i16()?]),
            Read::VelocityPid1 | Read::VelocityPid2 => Reply::VelocityPid(Pid {
                p: fields.u32()?,
                i: fields.u32()?,
                d: fields.u32()?,
                counts_s_at_full_duty: fields.u32()?,
            }),
            Read::Encoders => Reply::Counts([fields.u32()?, fields.u32()?]),
            Read::RawSpeeds | Read::Speeds => Reply::Speeds([fields.i32()?, fields.i32()?]),
            Read::Temperature => Reply::Temperature(fields.i16()?),
            Read::Status if payload.len() == 2 => {
                Reply::Status(Status::from_narrow(fields.u16()?), StatusWidth::Narrow)
            }
            Read::Status => Reply::Status(Status(fields.u32()?), StatusWidth::Wide),
            Read::MaxCurrent1 | Read::MaxCurrent2 => Reply::MaxCurrent(fields.u32()?),
        })
    }
}

impl Read {
    /// Its name and number for messages.
    #[must_use]
    pub fn command_name(self) -> CommandName {
        let words = match self {
            Read::Watchdog => "read watchdog",
            Read::Encoder1 | Read::Encoder2 | Read::Encoders => "read encoders",
            Read::Speed1 | Read::Speed2 | Read::RawSpeed1 | Read::RawSpeed2 | Read::RawSpeeds | Read::Speeds => {
                "read speed"
            }
            Read::Version => "read version",
            Read::MainBattery => "read main supply",
            Read::LogicBattery => "read logic supply",
            Read::Pwms => "read duty",
            Read::Currents => "read currents",
            Read::VelocityPid1 | Read::VelocityPid2 => "read velocity gains",
            Read::Temperature => "read temperature",
            Read::Status => "read status",
            Read::MaxCurrent1 | Read::MaxCurrent2 => "read largest current",
        };
        CommandName { words, code: Some(self.code().into()) }
    }
}

impl Reply {
    /// The bytes a unit at `address` sends in answer to the question with number `code`.
    #[must_use]
    pub fn encode(&self, address: u8, code: u8) -> Packet {
        let mut packet = Packet::new();
        match *self {
            Reply::Watchdog(tenths) => packet.extend(&[tenths]),
            Reply::Count(count, flags) => {
                packet.extend(&count.to_be_bytes());
                packet.extend(&[flags]);
            }
            Reply::Speed(speed) => {
                packet.extend(&speed.to_be_bytes());
                packet.extend(&[u8::from(speed < 0)]);
            }
            Reply::Version(version) => {
                packet.extend(version.as_str().as_bytes());
                packet.extend(b"\n\0");
            }
            Reply::Battery(value) => packet.extend(&value.to_be_bytes()),
            Reply::Temperature(value) => packet.extend(&value.to_be_bytes()),
            Reply::Pwms(pair) | Reply::Currents(pair) => pair.iter().for_each(|v| packet.extend(&v.to_be_bytes())),
            Reply::VelocityPid(pid) => {
                for value in [pid.p, pid.i, pid.d, pid.counts_s_at_full_duty] {
                    packet.extend(&value.to_be_bytes());
                }
            }
            Reply::Counts(pair) => pair.iter().for_each(|v| packet.extend(&v.to_be_bytes())),
            Reply::Speeds(pair) => pair.iter().for_each(|v| packet.extend(&v.to_be_bytes())),
            Reply::Status(status, StatusWidth::Narrow) => packet.extend(&status.to_narrow().to_be_bytes()),
            Reply::Status(status, StatusWidth::Wide) => packet.extend(&status.0.to_be_bytes()),
            Reply::MaxCurrent(centiamps) => {
                packet.extend(&centiamps.to_be_bytes());
                packet.extend(&0u32.to_be_bytes());
            }
        }
        with_reply_crc(packet, address, code)
    }
}
