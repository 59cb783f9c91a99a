//! The states of the bus and of a unit on the way into use.

use crate::codec::Read;
use crate::packet::MAX_PACKET;

/// Where the bus is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// Reading and forgetting until it is quiet; the last byte came at `quiet_from_ns` or before.
    Draining { quiet_from_ns: u64 },
    /// Waiting for the answer to a fence, whatever comes before it.
    Fencing { unit: usize, read: Read, until_ns: u64, window: Window },
    /// Empty, and nothing outstanding.
    Settled,
}

/// What came in place of the answer to a fence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Instead {
    /// Not one byte.
    #[default]
    Nothing,
    /// The question itself.
    Echo,
    /// Something else.
    Foreign,
}

/// What a unit is asked before it is used, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Setup {
    /// Is the watchdog still as it was set? Otherwise the unit has restarted. `whole`: ask for everything in any case.
    Recognise {
        whole: bool,
    },
    Version,
    Status,
    SetWatchdog,
    CheckWatchdog,
    Supply,
    Encoders,
}

/// The last bytes received, to find an answer in.
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
