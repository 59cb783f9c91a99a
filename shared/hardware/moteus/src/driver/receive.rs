//! Bytes to text lines.

use drives::Error;
use serial::Transport;

use super::Bus;
use crate::codec::Line;
use drives::Instead;

/// A text line that arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Heard {
    Line(Line),
    /// Changed on the wire. A short one may have been no answer.
    Garbled {
        short: bool,
    },
}

/// Longest text line without a frame: `OK` and its checksum.
const SHORT: usize = 12;

impl<T: Transport> Bus<T> {
    /// Discards what arrived before a question.
    pub(super) fn discard(&mut self) -> Result<(), Error> {
        let discarded = self.inbox.discard(&mut self.transport);
        let stray = discarded.map_err(|error| self.port_failed(error))?;
        if stray > 0 {
            self.count_stray(stray);
        }
        Ok(())
    }

    pub(super) fn count_stray(&mut self, bytes: usize) {
        self.counters.stray_bytes += bytes as u64;
        let now_ns = self.transport.now_ns();
        self.noise.heard(now_ns);
    }

    /// The next text line; `None` after `until_ns`.
    pub(super) fn hear(&mut self, until_ns: u64) -> Result<Option<Heard>, Error> {
        loop {
            let heard = self.inbox.hear(&mut self.transport, until_ns).map_err(|error| self.port_failed(error))?;
            match heard {
                drives::Heard::Line(bytes) => return Ok(Some(self.parsed(&bytes))),
                drives::Heard::Nothing => return Ok(None),
                drives::Heard::TooLong(bytes) => {
                    self.count_stray(bytes);
                    self.noise.is(Instead::Foreign);
                }
            }
        }
    }

    fn parsed(&mut self, bytes: &[u8]) -> Heard {
        match Line::parse(bytes, self.checksums) {
            Ok(line) => Heard::Line(line),
            Err(_) => {
                let echo = bytes.starts_with(b"can send ");
                self.noise.is(if echo { Instead::Echo } else { Instead::Foreign });
                self.counters.garbled += 1;
                self.count_stray(bytes.len());
                Heard::Garbled { short: bytes.len() <= SHORT }
            }
        }
    }
}
