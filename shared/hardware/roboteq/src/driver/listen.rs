//! Text lines that arrive, and bytes that answer nothing.

use arrayvec::ArrayVec;
use drives::{Error, Heard, Instead};
use serial::Transport;

use super::Bus;
use crate::codec::MAX_LINE;

impl<T: Transport> Bus<T> {
    /// Counts a line that answers nothing.
    pub(super) fn stray(&mut self, line: &[u8]) {
        let sent = line.first().is_some_and(|first| b"?!~^#".contains(first));
        self.noise.is(if sent { Instead::Echo } else { Instead::Foreign });
        self.count_stray(line.len() + 1);
    }

    fn count_stray(&mut self, bytes: usize) {
        self.counters.stray_bytes += bytes as u64;
        let now_ns = self.transport.now_ns();
        self.noise.heard(now_ns);
    }

    /// Discards what arrived before a batch.
    pub(super) fn discard(&mut self) -> Result<(), Error> {
        let expected = self.tail.take().is_some();
        let discarded = self.inbox.discard(&mut self.transport);
        let stray = discarded.map_err(|error| self.port_failed(error))?;
        if stray > 0 && !expected {
            self.count_stray(stray);
        }
        Ok(())
    }

    /// The next text line; `None` after `until_ns`.
    pub(super) fn hear(&mut self, until_ns: u64) -> Result<Option<ArrayVec<u8, MAX_LINE>>, Error> {
        loop {
            let heard = self.inbox.hear(&mut self.transport, until_ns).map_err(|error| self.port_failed(error))?;
            match heard {
                Heard::Line(line) => return Ok(Some(line)),
                Heard::Nothing => return Ok(None),
                Heard::TooLong(bytes) => {
                    self.noise.is(Instead::Foreign);
                    self.count_stray(bytes);
                }
            }
        }
    }
}
