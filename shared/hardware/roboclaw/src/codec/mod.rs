//! The bytes of the packet serial protocol.
//!
//! A command that changes something ([`Write`]) is `address code payload crc` and is answered by one byte, [`ACK`]. A
//! question ([`Read`]) is `address code`, without a checksum, and is answered by `payload crc`, where the checksum also
//! covers the question: an answer to another question or from another address is rejected. Integers are big-endian. An
//! invalid packet is not answered.

mod fields;
mod read;
mod write;

pub(crate) use fields::{Fields, with_reply_crc};
pub use fields::{MAX_VERSION, Motor, Pid};
pub use read::{Flaw, READS, Read, Reply, ReplyLength, Version};
pub use write::{SAVE_KEY, Write};

use drives::CommandName;

/// Answer to every accepted [`Write`].
pub const ACK: u8 = 0xFF;

/// Addresses that a unit can have.
pub const ADDRESSES: std::ops::RangeInclusive<u8> = 0x80..=0x87;

/// Longest pause inside a packet, ns. A unit discards the packet after it, so its parser is then empty.
pub const BYTE_GAP_NS: u64 = 10_000_000;

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
    pub fn command_name(self) -> CommandName {
        match self {
            Command::Write(write) => write.command_name(),
            Command::Read(read) => read.command_name(),
        }
    }
}
