//! The bytes of the packet serial protocol.
//!
//! A command that changes something ([`Write`]) is `address code payload crc` and is answered by one byte, [`ACK`]. A question
//! ([`Read`]) is `address code`, without a checksum, and is answered by `payload crc`, where the checksum also covers the question:
//! an answer to another question or from another address does not pass. Integers are big-endian. An invalid packet is not answered.

mod read;
mod write;

pub use read::{Flaw, READS, Read, Reply, ReplyLength, Version};
pub use write::Write;

use drives::Asked;

use crate::crc::Crc;
use crate::packet::Packet;

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

/// A packet to a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// A command that changes something.
    Write(Write),
    /// A question.
    Read(Read),
}

impl Command {
    /// Its name and number for messages.
    #[must_use]
    pub fn asked(self) -> Asked {
        match self {
            Command::Write(write) => write.asked(),
            Command::Read(read) => read.asked(),
        }
    }
}

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
