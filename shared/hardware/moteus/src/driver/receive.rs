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
        let mut stray = self.inbox.waiting();
        self.inbox.clear();
        // Noise that does not end must not keep the cycle.
        for _ in 0..4 {
            let got = self.transport.read(&mut self.inbox.bytes, 0).map_err(|error| self.port_failed(error))?;
            stray += got;
            if got == 0 {
                break;
            }
        }
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
            while self.inbox.from < self.inbox.to {
                let byte = self.inbox.bytes[self.inbox.from];
                self.inbox.from += 1;
                if matches!(byte, b'\r' | b'\n') {
                    if let Some(heard) = self.end_of_line() {
                        return Ok(Some(heard));
                    }
                } else if self.inbox.line.try_push(byte).is_err() {
                    self.count_stray(self.inbox.line.len() + 1);
                    self.noise.is(Instead::Foreign);
                    self.inbox.line.clear();
                }
            }
            // The first condition ends a stream of bytes without a pause.
            if self.transport.now_ns() > until_ns {
                return Ok(None);
            }
            let got = self.transport.read(&mut self.inbox.bytes, until_ns).map_err(|error| self.port_failed(error))?;
            (self.inbox.from, self.inbox.to) = (0, got);
            if got == 0 {
                return Ok(None);
            }
        }
    }

    fn end_of_line(&mut self) -> Option<Heard> {
        let length = self.inbox.line.len();
        if length == 0 {
            return None;
        }
        let heard = match Line::parse(&self.inbox.line, self.checksums) {
            Ok(line) => Heard::Line(line),
            Err(_) => {
                let echo = self.inbox.line.starts_with(b"can send ");
                self.noise.is(if echo { Instead::Echo } else { Instead::Foreign });
                self.counters.garbled += 1;
                self.count_stray(length);
                Heard::Garbled { short: length <= SHORT }
            }
        };
        self.inbox.line.clear();
        Some(heard)
    }
}
