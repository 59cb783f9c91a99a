//! The states of the bus and of a unit on the way into use.

use crate::codec::{ACK, Command, Read, Reply};
use crate::packet::MAX_PACKET;
use drives::Instead;

/// Where the bus is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// Reads and discards until the port is quiet; the last byte arrived at `quiet_from_ns` or before.
    Draining { quiet_from_ns: u64 },
    /// Waits for the answer to a fence, and skips bytes before it.
    Fencing { unit: usize, read: Read, until_ns: u64, window: Window },
    /// Waits for an answer that a call left.
    Late(Late),
    /// Nothing received, nothing outstanding.
    Settled,
}

/// An answer under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Late {
    pub(super) unit: usize,
    pub(super) command: Command,
    pub(super) sent_ns: u64,
    /// The same on the machine's clock, ns.
    pub(super) stamp_ns: u64,
    /// End of the wait, ns.
    pub(super) until_ns: u64,
    pub(super) wanted: usize,
    bytes: [u8; MAX_PACKET],
    pub(super) got: usize,
}

impl Late {
    /// Nothing of it is there yet. The time of the question is that of the port's clock and of the machine's, ns.
    pub(super) fn new(unit: usize, command: Command, sent_ns: [u64; 2], until_ns: u64, wanted: usize) -> Self {
        let [sent_ns, stamp_ns] = sent_ns;
        Self { unit, command, sent_ns, stamp_ns, until_ns, wanted, bytes: [0; MAX_PACKET], got: 0 }
    }

    /// The same with bytes that arrived.
    pub(super) fn with(mut self, arrived: &[u8]) -> Self {
        for (place, byte) in self.bytes.iter_mut().skip(self.got).zip(arrived) {
            *place = *byte;
            self.got += 1;
        }
        self
    }

    /// The answer to this question, where the bytes are one.
    pub(super) fn reply(&self, read: Read, address: u8) -> Option<Reply> {
        read.decode(address, self.bytes.get(..self.got)?).ok()
    }

    /// True where the bytes answer the question.
    pub(super) fn answers(&self, address: u8) -> bool {
        let bytes = self.bytes.get(..self.got).unwrap_or_default();
        match self.command {
            Command::Write(_) => bytes == [ACK],
            Command::Read(read) => self.reply(read, address).is_some(),
        }
    }
}

/// Questions of a unit's setup, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Setup {
    /// Reads the watchdog: another value than the one that was set means a restart. `whole`: continue the setup in any
    /// case.
    Recognise {
        whole: bool,
    },
    /// Releases the motors of a unit that restarted: it may have executed a command before its watchdog showed that.
    Stop,
    Version,
    Status,
    SetWatchdog,
    CheckWatchdog,
    Supply,
    Encoders,
}

/// The last bytes received, in which an answer is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    bytes: [u8; MAX_PACKET],
    len: usize,
}

impl Window {
    pub(super) const EMPTY: Window = Window { bytes: [0; MAX_PACKET], len: 0 };

    pub(super) fn push(&mut self, byte: u8) {
        if self.len == MAX_PACKET {
            self.bytes.copy_within(1.., 0);
            self.len -= 1;
        }
        self.bytes[self.len] = byte;
        self.len += 1;
    }

    /// What it holds, for a question of which it has no answer.
    pub(super) fn instead(&self, question: &[u8]) -> Instead {
        match self.bytes.get(..self.len) {
            None | Some([]) => Instead::Nothing,
            Some(bytes) if bytes == question => Instead::Echo,
            Some(_) => Instead::Foreign,
        }
    }

    pub(super) fn last(&self, n: usize) -> Option<&[u8]> {
        self.bytes.get(self.len.checked_sub(n)?..self.len)
    }
}
