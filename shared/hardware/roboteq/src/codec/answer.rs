//! Answers of a controller.

use std::fmt;

use arrayvec::ArrayVec;

use super::{Flaw, Name};

/// Values of an answer: one for each channel, or one for the controller.
pub type Numbers = ArrayVec<i32, 3>;

/// The values as an answer has them.
#[must_use]
pub fn numbers(values: &[i32]) -> Numbers {
    values.iter().copied().take(3).collect()
}

/// An answer of a controller.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer<'a> {
    /// `+`: the command or setting is accepted.
    Accepted,
    /// `-`: it is not.
    Refused,
    /// Values of a reading or setting.
    Numbers(Name, Numbers),
    /// Text of a reading.
    Text(Name, &'a str),
}

impl fmt::Display for Answer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Answer::Accepted => f.write_str("+"),
            Answer::Refused => f.write_str("-"),
            Answer::Numbers(name, values) => {
                f.write_str(name.text())?;
                let mut mark = '=';
                values.iter().try_for_each(|value| write!(f, "{}{value}", std::mem::replace(&mut mark, ':')))
            }
            Answer::Text(name, text) => write!(f, "{}={text}", name.text()),
        }
    }
}

impl<'a> Answer<'a> {
    /// Reads an answer. Only the form in which a controller writes it counts: a wire that changes bytes makes others.
    ///
    /// # Errors
    /// It is none.
    pub fn parse(line: &'a [u8]) -> Result<Answer<'a>, Flaw> {
        let text = std::str::from_utf8(line).map_err(|_| Flaw)?;
        match text {
            "+" => return Ok(Answer::Accepted),
            "-" => return Ok(Answer::Refused),
            _ => {}
        }
        let (name, values) = text.split_once('=').ok_or(Flaw)?;
        let name = Name::ALL.into_iter().find(|known| known.text() == name).ok_or(Flaw)?;
        if name.is_text() {
            let printed = !values.is_empty() && values.bytes().all(|byte| (b' '..0x7F).contains(&byte));
            return if printed { Ok(Answer::Text(name, values)) } else { Err(Flaw) };
        }
        let mut read = Numbers::new();
        for value in values.split(':') {
            read.try_push(canonical(value)?).map_err(|_| Flaw)?;
        }
        Ok(Answer::Numbers(name, read))
    }
}

/// A decimal number without a plus, and without zeros before it.
fn canonical(text: &str) -> Result<i32, Flaw> {
    let digits = text.strip_prefix('-').unwrap_or(text);
    let zeros = digits.starts_with('0') && text != "0";
    if zeros || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return Err(Flaw);
    }
    text.parse().map_err(|_| Flaw)
}
