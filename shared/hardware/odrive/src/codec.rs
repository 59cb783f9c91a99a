//! The text lines of the protocol, without state and without allocation.
//!
//! A line with a checksum ends in `*` and the exclusive or of the bytes before it, as a decimal number. A board
//! executes no line whose checksum is wrong, says nothing about it, and ends its answer to a line with a checksum in
//! the same way. It does not answer a command that changes something. `f N` with a number that no axis has is answered
//! by `invalid motor N`: a numbered mark between other answers.

use std::fmt::{self, Write as _};

use arrayvec::ArrayString;

/// Longest text line that this crate writes or reads.
pub const MAX_LINE: usize = 80;

/// A text line without its end.
pub type Text = ArrayString<MAX_LINE>;

/// Counts of this family per turn: its velocities and positions have five decimals.
pub const COUNTS_PER_TURN: f64 = 100_000.0;

/// The same as an integer.
const STEPS: u32 = 100_000;

/// Axes of a board.
pub const AXES: usize = 2;

/// Characters of the answer to a question about a property: the board cuts off the rest.
pub const PROPERTY_WIDTH: usize = 9;

/// Smallest number of a mark, and how many there are; no board has so many axes.
pub const MARKS: std::ops::Range<u32> = 10_000..100_000;

/// States of an axis.
pub mod state {
    /// No drive output.
    pub const IDLE: u32 = 1;
    /// The loops of the axis are closed.
    pub const CLOSED_LOOP: u32 = 8;
}

/// What the controller of an axis controls.
pub mod control {
    /// Torque alone.
    pub const TORQUE: u32 = 1;
    /// Velocity.
    pub const VELOCITY: u32 = 2;
    /// Position: the default of the factory.
    pub const POSITION: u32 = 3;
}

/// Bits of an axis' error word, from firmware 0.5.
pub mod error {
    /// The requested state is not possible.
    pub const INVALID_STATE: u32 = 1;
    /// The motor has an error of its own.
    pub const MOTOR: u32 = 64;
    /// The encoder has.
    pub const ENCODER: u32 = 256;
    /// The controller has.
    pub const CONTROLLER: u32 = 512;
    /// No command arrived in time.
    pub const WATCHDOG: u32 = 2048;
    /// An emergency stop was requested.
    pub const EMERGENCY_STOP: u32 = 16_384;
}

/// A text line was changed on the wire, or is none of the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flaw;

/// A line to a board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Line<'a> {
    /// Velocity of an axis, counts per second, without a torque besides.
    Velocity(usize, i32),
    /// Torque of an axis, in hundred-thousandths of N m.
    Torque(usize, i32),
    /// Feeds the watchdog of an axis.
    Feed(usize),
    /// Asks for position and velocity of an axis.
    Feedback(usize),
    /// Asks for the answer that marks a place among the others.
    Mark(u32),
    /// Asks for a property of an axis.
    Read(usize, &'a str),
    /// Asks for a property of the board.
    ReadBoard(&'a str),
    /// Sets a property of an axis to a whole number.
    Write(usize, &'a str, u32),
    /// Sets a property of an axis to a number of thousandths.
    WriteThousandths(usize, &'a str, u32),
    /// Clears the errors of all axes.
    ClearErrors,
}

impl fmt::Display for Line<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Line::Velocity(axis, steps) | Line::Torque(axis, steps) => {
                let command = if let Line::Velocity(..) = self { 'v' } else { 'c' };
                let (sign, size) = (if steps < 0 { "-" } else { "" }, steps.unsigned_abs());
                write!(f, "{command} {axis} {sign}{}.{:05}", size / STEPS, size % STEPS)?;
                // A board keeps the torque of a command before as a feedforward, unless a velocity brings another one.
                if let Line::Velocity(..) = self { f.write_str(" 0") } else { Ok(()) }
            }
            Line::Feed(axis) => write!(f, "u {axis}"),
            Line::Feedback(axis) => write!(f, "f {axis}"),
            Line::Mark(number) => write!(f, "f {number}"),
            Line::Read(axis, property) => write!(f, "r axis{axis}.{property}"),
            Line::ReadBoard(property) => write!(f, "r {property}"),
            Line::Write(axis, property, value) => write!(f, "w axis{axis}.{property} {value}"),
            Line::WriteThousandths(axis, property, value) => {
                write!(f, "w axis{axis}.{property} {}.{:03}", value / 1000, value % 1000)
            }
            Line::ClearErrors => f.write_str("sc"),
        }
    }
}

impl Line<'_> {
    /// The line with its checksum.
    #[must_use]
    pub fn encode(&self) -> Text {
        let mut text = Text::new();
        // No line of this crate is too long.
        let _ = write!(text, "{self}");
        seal(text)
    }
}

/// Checksum of a line: the exclusive or of its bytes.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}

/// Appends the checksum.
#[must_use]
pub fn seal(mut text: Text) -> Text {
    let sum = checksum(text.as_bytes());
    let _ = write!(text, "*{sum}");
    text
}

/// The text before the checksum, and whether there is a right one.
///
/// # Errors
/// The checksum is wrong, or bytes are no letters.
pub fn unseal(line: &[u8]) -> Result<(&str, bool), Flaw> {
    let text = std::str::from_utf8(line).ok().filter(|text| text.is_ascii()).ok_or(Flaw)?;
    let text = text.trim_matches(['\r', ' ']);
    let Some((body, sum)) = text.rsplit_once('*') else { return Ok((text, false)) };
    let plain = !sum.is_empty() && sum.len() <= 3 && sum.bytes().all(|byte| byte.is_ascii_digit());
    if plain && sum.parse() == Ok(checksum(body.as_bytes())) { Ok((body, true)) } else { Err(Flaw) }
}

/// Number of a mark, if the answer is one.
#[must_use]
pub fn mark(answer: &str) -> Option<u32> {
    let number = answer.strip_prefix("invalid motor ")?;
    if number.bytes().all(|byte| byte.is_ascii_digit()) { number.parse().ok() } else { None }
}

/// A decimal number without exponent.
#[must_use]
pub fn number(text: &str) -> Option<f64> {
    let plain = text.bytes().all(|byte| byte.is_ascii_digit() || matches!(byte, b'-' | b'.'));
    if plain { text.parse().ok().filter(|value: &f64| value.is_finite()) } else { None }
}

/// Position and velocity, turns and turns per second.
#[must_use]
pub fn feedback(answer: &str) -> Option<[f64; 2]> {
    let (position, velocity) = answer.split_once(' ')?;
    // An answer to `f` has six decimals; the property of a question may be cut off.
    let whole = |text: &str| text.rsplit_once('.').is_some_and(|(_, decimals)| decimals.len() == 6);
    (whole(position) && whole(velocity)).then_some([number(position)?, number(velocity)?])
}
