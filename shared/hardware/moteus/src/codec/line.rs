//! Text lines between the computer and an adapter, or a unit on a UART.

use arrayvec::ArrayVec;

use super::checksum::crc8;
use super::subframe::{Frame, MAX_FRAME};

/// Longest text line of the protocol: words, 64 bytes in hexadecimal, flags, a timestamp and a checksum.
pub const MAX_LINE: usize = 192;

/// A text line.
pub type Text = ArrayVec<u8, MAX_LINE>;

/// Lengths of CAN-FD frames.
const LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, MAX_FRAME];

/// Whether lines end with a checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Checksums {
    /// A UART: each line has one, and a line without is rejected.
    Required,
    /// A USB adapter: USB has its own.
    Absent,
}

/// Reason why a text line is none of the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flaw {
    /// No checksum, or a wrong one.
    Checksum,
    /// Other words, or digits that are no digits.
    Form,
}

/// A text line from the adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Line {
    /// The adapter has sent the frame.
    Sent,
    /// The adapter refused a line.
    Refused,
    /// A frame arrived.
    Received {
        /// Its identifier.
        identifier: u16,
        /// Its bytes.
        frame: Frame,
    },
}

/// A frame, filled up to a length that CAN-FD has.
#[must_use]
pub fn padded(mut frame: Frame) -> Frame {
    let length = LENGTHS.into_iter().find(|&length| length >= frame.as_slice().len()).unwrap_or(MAX_FRAME);
    while frame.as_slice().len() < length {
        frame.nothing();
    }
    frame
}

/// Line with a frame: `verb` is `can send` to the adapter, `rcv` from it.
#[must_use]
pub fn frame_line(verb: &str, identifier: u16, frame: &Frame, flags: &str, checksums: Checksums) -> Text {
    let mut text = Text::new();
    put(&mut text, verb.as_bytes());
    put(&mut text, b" ");
    identifier
        .to_be_bytes()
        .iter()
        .for_each(|&byte| put(&mut text, &hexadecimal(byte).map(|c| c.to_ascii_lowercase())));
    put(&mut text, b" ");
    frame.as_slice().iter().for_each(|&byte| put(&mut text, &hexadecimal(byte)));
    put(&mut text, b" ");
    put(&mut text, flags.as_bytes());
    seal(text, checksums)
}

/// A line with its checksum, where it has one.
#[must_use]
pub(crate) fn seal(mut text: Text, checksums: Checksums) -> Text {
    if checksums == Checksums::Required {
        put(&mut text, b" ");
        let sum = hexadecimal(crc8(&text));
        put(&mut text, b"*");
        put(&mut text, &sum);
    }
    text
}

/// Text before the checksum, and whether there is a right one.
pub(crate) fn unseal(line: &[u8]) -> Result<(&[u8], bool), Flaw> {
    let line = line.trim_ascii();
    let Some((body, &[b'*', high, low])) = line.split_last_chunk::<3>() else { return Ok((line, false)) };
    let sum = (digit(high).ok_or(Flaw::Checksum)? << 4) | digit(low).ok_or(Flaw::Checksum)?;
    if crc8(body) == sum { Ok((body.trim_ascii(), true)) } else { Err(Flaw::Checksum) }
}

impl Line {
    /// Reads a line without its end.
    ///
    /// # Errors
    /// The line was changed on the wire, or is none of the protocol.
    pub fn parse(line: &[u8], checksums: Checksums) -> Result<Line, Flaw> {
        let (body, sealed) = unseal(line)?;
        if checksums == Checksums::Required && !sealed {
            return Err(Flaw::Checksum);
        }
        let mut words = body.split(|&byte| byte == b' ').filter(|word| !word.is_empty());
        match words.next() {
            Some(b"OK") => Ok(Line::Sent),
            Some(b"ERR") => Ok(Line::Refused),
            Some(b"rcv") => {
                let identifier = number(words.next().ok_or(Flaw::Form)?).ok_or(Flaw::Form)?;
                let frame = bytes(words.next().ok_or(Flaw::Form)?).ok_or(Flaw::Form)?;
                Ok(Line::Received { identifier, frame })
            }
            _ => Err(Flaw::Form),
        }
    }
}

/// Identifier in hexadecimal.
pub(crate) fn number(word: &[u8]) -> Option<u16> {
    if word.is_empty() || word.len() > 4 {
        return None;
    }
    word.iter().try_fold(0, |value, &byte| Some((value << 4) | u16::from(digit(byte)?)))
}

/// Bytes of a frame in hexadecimal.
pub(crate) fn bytes(word: &[u8]) -> Option<Frame> {
    let (pairs, rest) = word.as_chunks::<2>();
    if !rest.is_empty() || pairs.len() > MAX_FRAME {
        return None;
    }
    let mut frame = Frame::new();
    for &[high, low] in pairs {
        frame.push((digit(high)? << 4) | digit(low)?);
    }
    Some(frame)
}

fn put(text: &mut Text, bytes: &[u8]) {
    // The longest line fits.
    let _ = text.try_extend_from_slice(bytes);
}

fn hexadecimal(byte: u8) -> [u8; 2] {
    [byte >> 4, byte & 0x0F].map(|digit| b"0123456789ABCDEF"[usize::from(digit)])
}

fn digit(byte: u8) -> Option<u8> {
    char::from(byte).to_digit(16).map(|digit| digit as u8)
}
