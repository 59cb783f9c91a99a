//! Frames: a header as JSON and a body of raw bytes, each with its length in front.

use thiserror::Error;

/// Bytes of the two lengths in front of a frame.
const PREFIX: usize = 8;

/// Largest frame that a receiver accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Header, bytes.
    pub header: usize,
    /// Body, bytes.
    pub body: usize,
}

/// What a gateway accepts: the longest request has a few hundred bytes of JSON, the longest mission 1 MB.
pub const CALL_LIMITS: Limits = Limits { header: 16 << 10, body: 1 << 20 };
/// What a client accepts: a list of channels in the header, the configuration of a robot or a picture in the body.
pub const REPLY_LIMITS: Limits = Limits { header: 1 << 20, body: 64 << 20 };

/// A frame.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Frame {
    /// One JSON object.
    pub header: Vec<u8>,
    /// Raw bytes.
    pub body: Vec<u8>,
}

/// A frame that is not accepted; the connection cannot continue, because the next frame cannot be found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum FrameError {
    /// A part is longer than accepted.
    #[error("the {part} of a frame has {bytes} bytes; accepted: {most}; see the gateway's protocol")]
    TooLong {
        /// Header or body.
        part: &'static str,
        /// Length that the frame states, bytes.
        bytes: u32,
        /// Largest accepted length, bytes.
        most: usize,
    },
}

/// Returns the bytes of a frame: the lengths of header and body as little-endian `u32`, the header, the body.
#[must_use]
pub fn encode(header: &[u8], body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(PREFIX + header.len() + body.len());
    // Both are far below 4 GB: a receiver accepts 64 MB.
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend((body.len() as u32).to_le_bytes());
    bytes.extend(header);
    bytes.extend(body);
    bytes
}

/// Splits a stream of bytes into frames.
#[derive(Debug)]
pub struct Decoder {
    limits: Limits,
    bytes: Vec<u8>,
    /// Bytes of frames that were returned already.
    taken: usize,
}

impl Decoder {
    /// Creates a decoder for frames up to these limits.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self { limits, bytes: Vec::new(), taken: 0 }
    }

    /// Adds received bytes. The caller adds a bounded piece, then calls [`Decoder::next_frame`] until it returns
    /// `None`.
    pub fn push(&mut self, bytes: &[u8]) {
        self.bytes.drain(..self.taken);
        self.taken = 0;
        self.bytes.extend_from_slice(bytes);
    }

    /// Number of bytes that wait for the rest of their frame.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.bytes.len() - self.taken
    }

    /// Returns the next whole frame; `None` until the rest of it has arrived.
    ///
    /// # Errors
    /// The frame states a length that is not accepted. Then nothing further can be decoded.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, FrameError> {
        let rest = &self.bytes[self.taken..];
        let Some((header, after)) = rest.split_first_chunk::<4>() else { return Ok(None) };
        let header = within("header", u32::from_le_bytes(*header), self.limits.header)?;
        let Some((body, after)) = after.split_first_chunk::<4>() else { return Ok(None) };
        let body = within("body", u32::from_le_bytes(*body), self.limits.body)?;
        let Some(both) = after.get(..header + body) else { return Ok(None) };
        let (header, body) = both.split_at(header);
        let frame = Frame { header: header.to_vec(), body: body.to_vec() };
        self.taken += PREFIX + both.len();
        Ok(Some(frame))
    }
}

fn within(part: &'static str, bytes: u32, most: usize) -> Result<usize, FrameError> {
    let length = bytes as usize;
    if length <= most { Ok(length) } else { Err(FrameError::TooLong { part, bytes, most }) }
}
