//! Text lines that arrive, and bytes that answer nothing.

use arrayvec::ArrayVec;
use drives::{Error, Instead};
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
        let mut stray = self.inbox_to - self.inbox_from + self.line.len();
        (self.inbox_from, self.inbox_to) = (0, 0);
        self.line.clear();
        // Noise that does not end must not keep the cycle.
        for _ in 0..4 {
            let got = self.transport.read(&mut self.inbox, 0).map_err(|error| self.port_failed(error))?;
            stray += got;
            if got == 0 {
                break;
            }
        }
        if stray > 0 && !expected {
            self.count_stray(stray);
        }
        Ok(())
    }

    /// The next text line; `None` after `until_ns`.
    pub(super) fn hear(&mut self, until_ns: u64) -> Result<Option<ArrayVec<u8, MAX_LINE>>, Error> {
        loop {
            while self.inbox_from < self.inbox_to {
                let byte = self.inbox[self.inbox_from];
                self.inbox_from += 1;
                if matches!(byte, b'\r' | b'\n') {
                    if !self.line.is_empty() {
                        return Ok(Some(std::mem::take(&mut self.line)));
                    }
                } else if self.line.try_push(byte).is_err() {
                    self.noise.is(Instead::Foreign);
                    self.count_stray(self.line.len() + 1);
                    self.line.clear();
                }
            }
            // The first condition ends a stream of bytes without a pause.
            if self.transport.now_ns() > until_ns {
                return Ok(None);
            }
            let got = self.transport.read(&mut self.inbox, until_ns).map_err(|error| self.port_failed(error))?;
            (self.inbox_from, self.inbox_to) = (0, got);
            if got == 0 {
                return Ok(None);
            }
        }
    }
}
