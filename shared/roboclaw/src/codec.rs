//! The bytes of the packet serial protocol.
//!
//! A command that changes something ([`Write`]) is `address code payload crc` and is answered by one byte, [`ACK`]. A question
//! ([`Read`]) is `address code`, without a checksum, and is answered by `payload crc`, where the checksum also covers the question:
//! an answer to another question or from another address does not pass. Integers are big-endian. An invalid packet is not answered.

use std::fmt;

use crate::crc::{Crc, crc16};
use crate::packet::Packet;
use crate::status::{Status, StatusWidth};

/// The answer to every accepted [`Write`].
pub const ACK: u8 = 0xFF;

/// The addresses a unit can have.
pub const ADDRESSES: std::ops::RangeInclusive<u8> = 0x80..=0x87;

/// A pause inside a packet longer than this makes a unit forget the packet, ns. So after this long a silence its parser is empty.
pub const BYTE_GAP_NS: u64 = 10_000_000;

/// What has to be sent with [`Write::Save`], so that noise does not wear out the memory.
pub const SAVE_KEY: u32 = 0xE22E_AB7A;

/// Longest version text that a unit sends, with its end mark.
pub const MAX_VERSION: usize = 48;

/// One of a unit's two motors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motor {
    /// M1.
    One,
    /// M2.
    Two,
}

impl Motor {
    /// 0 or 1.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// Gains of a unit's velocity loop, 16.16 fixed point, and the speed at full duty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pid {
    /// Proportional gain x 65536.
    pub p: u32,
    /// Integral gain x 65536.
    pub i: u32,
    /// Derivative gain x 65536.
    pub d: u32,
    /// Counts per second at full duty.
    pub counts_s_at_full_duty: u32,
}

impl Default for Pid {
    /// The factory's values.
    fn default() -> Pid {
        Pid { p: 0x1_0000, i: 0x8000, d: 0x4000, counts_s_at_full_duty: 44_000 }
    }
}

/// A command that changes something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Write {
    /// 14: stop both motors when no packet came for so many tenths of a second; 0 never.
    Watchdog(u8),
    /// 20: both encoders count from zero again.
    ResetEncoders,
    /// 22, 23: an encoder counts on from here.
    SetEncoder(Motor, i32),
    /// 28, 29.
    VelocityPid(Motor, Pid),
    /// 32, 33: duty in 1/32767 of the supply.
    Duty(Motor, i16),
    /// 34.
    Duties([i16; 2]),
    /// 35, 36: closed-loop speed, counts per second.
    Speed(Motor, i32),
    /// 37.
    Speeds([i32; 2]),
    /// 38, 39: as 35, 36 with a ramp, counts per second squared.
    SpeedRamp(Motor, u32, i32),
    /// 40: both speeds, one ramp.
    SpeedsRamp(u32, [i32; 2]),
    /// 50: each speed with its own ramp.
    SpeedsRamps([(u32, i32); 2]),
    /// 94: keep the settings over a power cut. Slow; not in a control loop.
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

    /// True where doing it twice is the same as doing it once.
    #[must_use]
    pub fn is_idempotent(&self) -> bool {
        // An encoder that is set again after it has moved on loses that movement.
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

    /// What a unit understands: the command with this number and payload, `None` where there is none of this form.
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

impl fmt::Display for Write {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
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
        write!(f, "{name} (command {})", self.code())
    }
}

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

/// Every question there is.
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

/// How long an answer is, without its checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReplyLength {
    /// So many bytes.
    Bytes(usize),
    /// As the firmware has it, see [`StatusWidth`].
    Status,
    /// Up to and with a zero byte, at most [`MAX_VERSION`].
    Text,
}

/// The version text of a unit, with what is left of its line end taken off.
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

    /// The text; empty where the unit sent something that is no text.
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
    /// Tenths of a second; 0 never.
    Watchdog(u8),
    /// Encoder counts modulo 2^32, and flags: 1 underflow, 2 backward, 4 overflow.
    Count(u32, u8),
    /// Counts per second.
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
    /// 0.1 degrees Celsius.
    Temperature(i16),
    /// Conditions, and how wide the unit sent them.
    Status(Status, StatusWidth),
    /// Largest motor current, 10 mA.
    MaxCurrent(u32),
}

/// Why bytes are not the answer to a question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flaw {
    /// Not as long as this answer is.
    Length,
    /// Not from this unit, not to this question, or changed on the way.
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

    /// How long the answer is.
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
                // Some firmware sends a signed number, some a magnitude, both a flag for backward: this is right for either.
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

impl fmt::Display for Read {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
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
        write!(f, "{name} (command {})", self.code())
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

/// A payload with the checksum of an answer.
pub(crate) fn with_reply_crc(mut payload: Packet, address: u8, code: u8) -> Packet {
    let crc = Crc::default().with(&[address, code]).with(&payload).value();
    payload.extend(&crc.to_be_bytes());
    payload
}

const fn by_motor(motor: Motor, one: u8, two: u8) -> u8 {
    match motor {
        Motor::One => one,
        Motor::Two => two,
    }
}

/// Big-endian fields, taken from the front.
pub(crate) struct Fields<'a>(pub(crate) &'a [u8]);

impl Fields<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*first)
    }
    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.take::<1>().map(|[byte]| byte)
    }
    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_be_bytes)
    }
    pub(crate) fn i16(&mut self) -> Option<i16> {
        self.take().map(i16::from_be_bytes)
    }
    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_be_bytes)
    }
    pub(crate) fn i32(&mut self) -> Option<i32> {
        self.take().map(i32::from_be_bytes)
    }
}
