//! Devices that send text lines: NMEA 0183, columns, or names with values.

use messages::Reading;

use crate::settings::{LineFormat, LineSection, ValueSection};
use crate::{Frame, Protocol, VALUES};

/// Longest text line, bytes; NMEA 0183 allows 82.
const LONGEST: usize = 512;

/// Decoder of text lines.
#[derive(Debug)]
pub struct TextLines {
    section: LineSection,
    values: Vec<ValueSection>,
    text: Vec<u8>,
    /// Whether the present text line may lack its start.
    truncated: bool,
    /// Whether the present text line is longer than [`LONGEST`].
    too_long: bool,
}

impl TextLines {
    /// Creates a decoder for the described text lines.
    pub fn new(section: &LineSection, values: &[ValueSection]) -> Self {
        let text = Vec::with_capacity(LONGEST);
        Self { section: section.clone(), values: values.to_vec(), text, truncated: true, too_long: false }
    }

    /// Decodes the text line; returns `None` for an empty one and for another NMEA sentence.
    fn decode(&self) -> Option<Frame> {
        let Ok(text) = std::str::from_utf8(&self.text) else { return Some(Frame::Bad) };
        let text = text.trim();
        if text.is_empty() {
            return None;
        }
        match self.section.format {
            LineFormat::Nmea => match nmea(text) {
                None => Some(Frame::Bad),
                Some(fields) if !fields[0].ends_with(&self.section.sentence) => None,
                Some(fields) => Some(self.decode_fields(&fields[1..])),
            },
            LineFormat::Csv => {
                let fields: Vec<&str> = text.split(self.section.separator).collect();
                Some(self.decode_fields(&fields))
            }
            LineFormat::KeyValue => {
                Some(self.collect(true, |value| value_of(text, value.key.as_deref().unwrap_or_default())))
            }
        }
    }

    fn decode_fields(&self, fields: &[&str]) -> Frame {
        let field = |number: usize| number.checked_sub(1).and_then(|at| fields.get(at)).map(|field| field.trim());
        let valid = self.section.valid.as_ref().is_none_or(|valid| field(valid.field) == Some(valid.is.as_str()));
        self.collect(valid, |value| field(value.field.unwrap_or(0)))
    }

    /// Collects the values. An empty field is an invalid value; a missing field, or one that is no number, makes the
    /// whole text line a bad frame.
    fn collect<'a>(&self, valid: bool, text_of: impl Fn(&ValueSection) -> Option<&'a str>) -> Frame {
        let mut values = [0.0; VALUES];
        let mut quality = if valid { Reading::QUALITY_GOOD } else { Reading::QUALITY_INVALID };
        for (place, section) in values.iter_mut().zip(&self.values) {
            let Some(text) = text_of(section) else { return Frame::Bad };
            if text.is_empty() {
                (*place, quality) = (f64::NAN, Reading::QUALITY_INVALID);
                continue;
            }
            let Some(number) = number(text) else { return Frame::Bad };
            *place = number * section.scale + section.offset;
        }
        Frame::Values(values, quality)
    }
}

impl Protocol for TextLines {
    fn reset(&mut self) {
        self.text.clear();
        (self.truncated, self.too_long) = (true, false);
    }

    fn push(&mut self, byte: u8) -> Option<Frame> {
        if byte != b'\n' {
            match self.text.len() < LONGEST {
                true => self.text.push(byte),
                false => self.too_long = true,
            }
            return None;
        }
        let truncated = std::mem::take(&mut self.truncated);
        let frame = match std::mem::take(&mut self.too_long) {
            true => Some(Frame::Bad),
            false => self.decode(),
        };
        self.text.clear();
        // A truncated text line can look like a whole one with other values.
        frame.filter(|_| !truncated)
    }
}

/// Returns the fields of a sentence between `$` and `*`, of which the first is its name; `None` if the checksum is
/// missing or wrong.
fn nmea(text: &str) -> Option<Vec<&str>> {
    let (body, sum) = text.strip_prefix(['$', '!'])?.rsplit_once('*')?;
    let given = u8::from_str_radix(sum, 16).ok().filter(|_| sum.len() == 2)?;
    let true_sum = body.bytes().fold(0, |sum, byte| sum ^ byte);
    (given == true_sum).then(|| body.split(',').collect())
}

/// Returns the text after `KEY=` or `KEY:`, up to the next separator.
fn value_of<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.match_indices(key).find_map(|(at, _)| {
        let alone = text.get(..at)?.chars().next_back().is_none_or(|c| !c.is_alphanumeric() && c != '_');
        let rest = text.get(at + key.len()..)?.trim_start().strip_prefix(['=', ':'])?.trim_start();
        let value = rest.split([',', ';', ' ', '\t']).next()?;
        alone.then_some(value)
    })
}

/// Parses a finite number, which a unit may follow.
fn number(text: &str) -> Option<f64> {
    let whole = text.parse::<f64>().ok();
    let digits = text.find(|c: char| !matches!(c, '0'..='9' | '.' | '+' | '-')).unwrap_or(text.len());
    whole.or_else(|| text.get(..digits)?.parse().ok()).filter(|number: &f64| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_may_have_units_and_must_be_finite() {
        let cases = [("21.5", Some(21.5)), ("-3e2", Some(-300.0)), ("412ppm", Some(412.0)), ("+7.0C", Some(7.0))];
        for (text, expected) in cases.into_iter().chain(["", "nan", "inf", "x1", "-", "1e999"].map(|text| (text, None)))
        {
            assert_eq!(number(text), expected, "{text}");
        }
    }

    #[test]
    fn a_key_matches_whole_words_only() {
        let text = "RTD=5 T = 21.5C;CO2:412 T2=9";
        for (key, expected) in
            [("T", Some("21.5C")), ("CO2", Some("412")), ("T2", Some("9")), ("TD", None), ("X", None)]
        {
            assert_eq!(value_of(text, key), expected, "{key}");
        }
    }
}
