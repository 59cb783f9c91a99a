//! The bytes of the protocol, without state and without allocation.
//!
//! A frame of CAN-FD holds subframes ([`Subframe`]) that write registers, ask for them, or answer. A serial port
//! carries frames as text lines ([`Line`]): `can send ID HEX FLAGS` to the adapter, which answers `OK` or `ERR ..`, and
//! `rcv ID HEX FLAGS` for each frame that it receives. A unit on a UART speaks the same lines and ends each with a
//! checksum, ` *XX`; after the first line with one it accepts no line without.

mod checksum;
mod line;
mod register;
mod subframe;

pub use checksum::crc8;
pub use line::{Checksums, Flaw, Line, MAX_LINE, Text, frame_line, padded};
pub(crate) use line::{bytes, number, seal, unseal};
pub use register::{COUNTS_PER_TURN, Mode, Register, SOURCES, Scale};
pub use subframe::{Frame, MAX_FRAME, Resolution, Subframe, Subframes, Value};

/// Bit of a frame's identifier with which the sender asks for an answer.
pub const REPLY_WANTED: u16 = 0x8000;

/// Identifiers that a unit can have; 0 is this program's.
pub const ADDRESSES: std::ops::RangeInclusive<u8> = 1..=126;

/// Identifier of a frame to a unit, which it is to answer.
#[must_use]
pub fn to_unit(address: u8) -> u16 {
    REPLY_WANTED | u16::from(address & 0x7F)
}

/// Unit that sent a frame with this identifier to this program.
#[must_use]
pub fn from_unit(identifier: u16) -> Option<u8> {
    let [source, destination] = identifier.to_be_bytes();
    (destination & 0x7F == 0).then_some(source & 0x7F)
}
