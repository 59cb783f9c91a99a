//! Bytes between the port and the text lines.

use crate::codec::Text;

/// Bytes that were received and not used yet.
#[derive(Debug)]
pub(super) struct Inbox {
    pub(super) bytes: [u8; 256],
    pub(super) from: usize,
    pub(super) to: usize,
    /// The text line that is not complete yet.
    pub(super) line: Text,
}

impl Inbox {
    pub(super) fn new() -> Inbox {
        Inbox { bytes: [0; 256], from: 0, to: 0, line: Text::new() }
    }

    pub(super) fn clear(&mut self) {
        (self.from, self.to) = (0, 0);
        self.line.clear();
    }

    pub(super) fn waiting(&self) -> usize {
        self.to - self.from + self.line.len()
    }
}
