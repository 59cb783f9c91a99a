//! Bytes between a port and the text lines of a protocol.

use arrayvec::ArrayVec;
use serial::Transport;

/// Bytes that are read at once.
const PIECE: usize = 256;
/// Reads of a discard: noise that does not end must not keep the cycle.
const DISCARDS: usize = 4;

/// Bytes that were received and not used yet. A line has at most `N` bytes, without its end.
#[derive(Debug)]
pub struct Inbox<const N: usize> {
    bytes: [u8; PIECE],
    from: usize,
    to: usize,
    /// The text line that is not complete yet.
    line: ArrayVec<u8, N>,
}

/// What an [`Inbox`] heard.
#[derive(Debug)]
pub enum Heard<const N: usize> {
    /// A text line without its end, a carriage return or a line feed; never an empty one.
    Line(ArrayVec<u8, N>),
    /// So many bytes that are longer than any line. They are dropped.
    TooLong(usize),
    /// No whole line until the end of the wait.
    Nothing,
}

impl<const N: usize> Default for Inbox<N> {
    fn default() -> Self {
        Self { bytes: [0; PIECE], from: 0, to: 0, line: ArrayVec::new() }
    }
}

impl<const N: usize> Inbox<N> {
    /// Forgets what was received.
    pub fn clear(&mut self) {
        (self.from, self.to) = (0, 0);
        self.line.clear();
    }

    /// Discards what was received and what waits in the port; returns how many bytes that was.
    ///
    /// # Errors
    /// The port cannot be read.
    pub fn discard(&mut self, transport: &mut impl Transport) -> Result<usize, serial::Error> {
        let mut discarded = self.to - self.from + self.line.len();
        self.clear();
        for _ in 0..DISCARDS {
            let got = transport.read(&mut self.bytes, 0)?;
            discarded += got;
            if got == 0 {
                break;
            }
        }
        Ok(discarded)
    }

    /// Waits until `until_ns` for the next text line.
    ///
    /// # Errors
    /// The port cannot be read.
    pub fn hear(&mut self, transport: &mut impl Transport, until_ns: u64) -> Result<Heard<N>, serial::Error> {
        loop {
            while self.from < self.to {
                let byte = self.bytes[self.from];
                self.from += 1;
                if matches!(byte, b'\r' | b'\n') {
                    if !self.line.is_empty() {
                        return Ok(Heard::Line(std::mem::take(&mut self.line)));
                    }
                } else if self.line.try_push(byte).is_err() {
                    let bytes = self.line.len() + 1;
                    self.line.clear();
                    return Ok(Heard::TooLong(bytes));
                }
            }
            // The first condition ends a stream of bytes without a pause.
            if transport.now_ns() > until_ns {
                return Ok(Heard::Nothing);
            }
            let got = transport.read(&mut self.bytes, until_ns)?;
            (self.from, self.to) = (0, got);
            if got == 0 {
                return Ok(Heard::Nothing);
            }
        }
    }
}
