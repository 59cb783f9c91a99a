//! The parts of packets that commands and questions share.

use crate::crc::Crc;
use crate::packet::Packet;

/// Longest version text that a unit sends, with its end mark.
pub const MAX_VERSION: usize = 48;

/// One of a unit's two motors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motor {
    /// Motor M1.
    One,
    /// Motor M2.
    Two,
}

impl Motor {
    /// Index in arrays of both motors, 0 or 1.
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
    /// Factory settings.
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

pub(super) const fn by_motor(motor: Motor, one: u8, two: u8) -> u8 {
    match motor {
        Motor::One => one,
        Motor::Two => two,
    }
}

/// Big-endian fields, taken from the front.
pub(crate) struct Fields<'a>(pub(crate) &'a [u8]);

impl Fields<'_> {
    fn next_bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*first)
    }
    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.next_bytes::<1>().map(|[byte]| byte)
    }
    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.next_bytes().map(u16::from_be_bytes)
    }
    pub(crate) fn i16(&mut self) -> Option<i16> {
        self.next_bytes().map(i16::from_be_bytes)
    }
    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.next_bytes().map(u32::from_be_bytes)
    }
    pub(crate) fn i32(&mut self) -> Option<i32> {
        self.next_bytes().map(i32::from_be_bytes)
    }
}
