//! A drive family that exists only here, complete, as a model for a new one: text lines with a tag in each question and
//! answer, one motor per unit, positions in turns, torque besides velocity.
//!
//! A question is `@ADDRESS TAG VERB VALUE*CRC`, its answer `@ADDRESS TAG TURNS AMPERES STATUS WATCHDOG_MS*CRC`. The tag
//! makes a late answer harmless: it answers an old question and is skipped. The checksum makes a changed byte harmless.

mod bus;
mod conformance;
mod own;
mod unit;

pub use bus::FakeBus;
pub use unit::FakeWire;

use std::fmt::Write as _;

use arrayvec::ArrayString;

const COUNTS_PER_TURN: f64 = 1000.0;
/// Status bits of a unit.
const EXPIRED: u32 = 1;
const STOPPED: u32 = 2;

/// A text line of the protocol.
type Text = ArrayString<96>;

/// CRC-16/XMODEM: with it two changed bits of a line never cancel out.
fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc: u16, &byte| {
        (0..8).fold(crc ^ (u16::from(byte) << 8), |crc, _| (crc << 1) ^ if crc & 0x8000 != 0 { 0x1021 } else { 0 })
    })
}

/// Completes a line that begins with `@`.
fn seal(mut text: Text) -> Text {
    let sum = crc(text.as_bytes());
    let _ = writeln!(text, "*{sum:04x}");
    text
}

/// The words of a line without its checksum. What was received before the last `@` belongs to no line.
fn unseal(line: &[u8]) -> Option<&str> {
    let begin = line.iter().rposition(|&byte| byte == b'@')?;
    let (body, sum) = std::str::from_utf8(&line[begin..]).ok()?.rsplit_once('*')?;
    let given = (sum.len() == 4).then(|| u16::from_str_radix(sum, 16).ok())??;
    (given == crc(body.as_bytes())).then(|| &body[1..])
}
