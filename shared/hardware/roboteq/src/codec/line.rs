//! Lines to a controller.

use std::fmt::{self, Write as _};

use super::{Flaw, Name, Text};

/// A line to a controller. Channels are counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Line {
    /// `!M`: commands of both motors, thousandths of full speed.
    Motors([i32; 2]),
    /// `!G`: command of one motor, thousandths of full speed.
    Go(u8, i32),
    /// `!S`: speed of one motor, turns per minute.
    Speed(u8, i32),
    /// `!C`: sets an encoder counter. The driver never does.
    SetCounter(u8, i32),
    /// `!VAR`: sets a user variable.
    SetVariable(u8, i32),
    /// `!EX`: emergency stop.
    Stop,
    /// `!MG`: end of the emergency stop.
    Resume,
    /// A question, about all channels or one.
    Ask(Name, Option<u8>),
    /// Sets a setting, of all channels or one.
    Set(Name, Option<u8>, i32),
    /// `# C`: clears the history of questions, which ends their repetition.
    ClearHistory,
    /// `# nn`: repeats one question of the history every so many milliseconds.
    Repeat(u16),
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Line::Motors([one, two]) => write!(f, "!M {one} {two}"),
            Line::Go(channel, value) => write!(f, "!G {channel} {value}"),
            Line::Speed(channel, rpm) => write!(f, "!S {channel} {rpm}"),
            Line::SetCounter(channel, value) => write!(f, "!C {channel} {value}"),
            Line::SetVariable(variable, value) => write!(f, "!VAR {variable} {value}"),
            Line::Stop => f.write_str("!EX"),
            Line::Resume => f.write_str("!MG"),
            Line::Ask(name, channel) => {
                write!(f, "{}{}", if name.is_setting() { '~' } else { '?' }, name.text())?;
                channel.map_or(Ok(()), |channel| write!(f, " {channel}"))
            }
            Line::Set(name, None, value) => write!(f, "^{} {value}", name.text()),
            Line::Set(name, Some(channel), value) => write!(f, "^{} {channel} {value}", name.text()),
            Line::ClearHistory => f.write_str("# C"),
            Line::Repeat(period_ms) => write!(f, "# {period_ms}"),
        }
    }
}

impl Line {
    /// The line without its end.
    #[must_use]
    pub fn encode(&self) -> Text {
        let mut text = Text::new();
        // No line of this crate is too long.
        let _ = write!(text, "{self}");
        text
    }

    /// Reads a line as a controller does.
    ///
    /// # Errors
    /// None that this crate has.
    pub fn parse(text: &str) -> Result<Line, Flaw> {
        let text = text.trim_matches(' ');
        let sigil = text.chars().next().ok_or(Flaw)?;
        let mut words = text.get(1..).ok_or(Flaw)?.split(' ').filter(|word| !word.is_empty());
        let name = words.next().ok_or(Flaw)?;
        let words = [words.next(), words.next(), words.next()];
        match (sigil, words) {
            ('!', words) => command(name, words),
            ('?', [channel, None, None]) => question(name, channel, false),
            ('~', [channel, None, None]) => question(name, channel, true),
            ('^', [Some(value), None, None]) => Ok(Line::Set(setting(name)?, None, number(value)?)),
            ('^', [Some(channel), Some(value), None]) => {
                Ok(Line::Set(setting(name)?, Some(number(channel)?), number(value)?))
            }
            ('#', [None, None, None]) if name.eq_ignore_ascii_case("C") => Ok(Line::ClearHistory),
            ('#', [None, None, None]) => Ok(Line::Repeat(number(name)?)),
            _ => Err(Flaw),
        }
    }
}

fn command(name: &str, words: [Option<&str>; 3]) -> Result<Line, Flaw> {
    let is = |wanted: &str| name.eq_ignore_ascii_case(wanted);
    match words {
        [None, None, None] if is("EX") => Ok(Line::Stop),
        [None, None, None] if is("MG") => Ok(Line::Resume),
        [Some(first), Some(second), None] => {
            let value = number(second)?;
            match () {
                () if is("M") => Ok(Line::Motors([number(first)?, value])),
                () if is("G") => Ok(Line::Go(number(first)?, value)),
                () if is("S") => Ok(Line::Speed(number(first)?, value)),
                () if is("C") => Ok(Line::SetCounter(number(first)?, value)),
                () if is("VAR") => Ok(Line::SetVariable(number(first)?, value)),
                () => Err(Flaw),
            }
        }
        _ => Err(Flaw),
    }
}

fn question(name: &str, channel: Option<&str>, of_setting: bool) -> Result<Line, Flaw> {
    let name = Name::named(name).filter(|name| name.is_setting() == of_setting).ok_or(Flaw)?;
    Ok(Line::Ask(name, channel.map(number).transpose()?))
}

fn setting(name: &str) -> Result<Name, Flaw> {
    Name::named(name).filter(|name| name.is_setting()).ok_or(Flaw)
}

/// A decimal number, without a plus.
fn number<N: std::str::FromStr>(text: &str) -> Result<N, Flaw> {
    if text.starts_with('+') { Err(Flaw) } else { text.parse().map_err(|_| Flaw) }
}
