//! Parses lengths as people write them: `12.43`, `12,43`, `12.43 m`, `1243 cm`; several in one text line, separated by
//! spaces, semicolons, or commas that cannot be decimal commas.

/// Accepted range of a length, m.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// Minimum, m.
    pub least_m: f64,
    /// Maximum, m.
    pub most_m: f64,
}

/// Distances between plumb lines; no portable instrument measures longer ones.
pub const DISTANCE: Bounds = Bounds { least_m: 0.3, most_m: 300.0 };
/// Cable lengths with the node on the floor.
pub const LENGTH: Bounds = Bounds { least_m: 0.1, most_m: 300.0 };
/// Heights of pulleys, on poles or trees.
pub const HEIGHT: Bounds = Bounds { least_m: 0.3, most_m: 100.0 };

/// Wheels from side to side: sheaves for cords have 30 to 80 mm.
pub const ACROSS: Bounds = Bounds { least_m: 0.01, most_m: 0.4 };
/// Cable that passes in one turn of such a wheel.
pub const TURN: Bounds = Bounds { least_m: 0.025, most_m: 1.5 };

/// Parses a small length, m: `50 mm`, `5 cm` or `0.05`.
///
/// # Errors
/// One sentence: what is accepted.
pub fn small(what: &str, text: &str, bounds: Bounds) -> Result<f64, String> {
    let number = text.trim().strip_suffix("mm").or_else(|| text.trim().strip_suffix("MM"));
    let m = match number {
        Some(digits) => parse_digits(digits.trim()).map(|mm| mm / 1000.0),
        None => length(text, Bounds { least_m: 0.0, ..bounds }).ok(),
    };
    m.filter(|m| (bounds.least_m..=bounds.most_m).contains(m)).ok_or_else(|| {
        say!(
            "`{}` is not {what} (accepted: {:.0} to {:.0} mm); write it like 50 mm or 5 cm",
            excerpt(text),
            1e3 * bounds.least_m,
            1e3 * bounds.most_m
        )
    })
}

/// Parses one length, m.
///
/// # Errors
/// One sentence: why the text is not a length, or not an accepted one.
pub fn length(text: &str, bounds: Bounds) -> Result<f64, String> {
    match lengths(text, bounds)?.as_slice() {
        [one] => Ok(*one),
        several => Err(say!("`{}` is {} numbers; type one", excerpt(text), several.len())),
    }
}

/// Parses one or more lengths, m.
///
/// # Errors
/// As for [`length`].
pub fn lengths(text: &str, bounds: Bounds) -> Result<Vec<f64>, String> {
    let no_length =
        || say!("`{}` is not understood; write a length as 12.43, 12,43, 12.43 m or 1243 cm", excerpt(text));
    // (number as written, its unit)
    let mut written: Vec<(&str, Option<Unit>)> = Vec::new();
    for word in text.split(|c: char| c.is_whitespace() || c == ';') {
        // A comma before a space is a separator, not a decimal comma.
        let word = word.strip_suffix(',').unwrap_or(word);
        if word.is_empty() {
            continue;
        }
        let (digits, unit) = word.split_at(word.find(|c: char| c.is_alphabetic()).unwrap_or(word.len()));
        let unit = if unit.is_empty() { None } else { Some(Unit::named(unit).ok_or_else(no_length)?) };
        if digits.is_empty() {
            match written.last_mut() {
                Some((_, missing @ None)) => *missing = unit,
                _ => return Err(no_length()),
            }
            continue;
        }
        // A decimal comma occurs once and excludes a decimal point.
        let decimal = digits.matches(',').count() == 1 && !digits.contains('.');
        match digits.split(',').collect::<Vec<_>>().as_slice() {
            [_] => written.push((digits, unit)),
            _ if decimal => written.push((digits, unit)),
            parts if parts.iter().all(|part| part.contains('.')) && unit.is_none() => {
                written.extend(parts.iter().map(|part| (*part, None)));
            }
            _ => return Err(no_length()),
        }
    }
    if written.is_empty() {
        return Err(no_length());
    }
    if written.iter().any(|(_, unit)| *unit == Some(Unit::Centimetre)) && written.iter().any(|(_, unit)| unit.is_none())
    {
        return Err(say!("some of these numbers have a unit and some do not; write cm after each of them"));
    }
    let value = |(digits, unit): (&str, Option<Unit>)| {
        let number = parse_digits(digits).ok_or_else(no_length)?;
        // Division gives 1243 cm the same bits as 12.43; multiplication by 0.01 does not.
        let m = if unit == Some(Unit::Centimetre) { number / 100.0 } else { number };
        if (bounds.least_m..=bounds.most_m).contains(&m) {
            return Ok(m);
        }
        Err(say!(
            "{m} m is not plausible (accepted: {} to {} m); write centimetres like 1243 cm",
            bounds.least_m,
            bounds.most_m
        ))
    };
    written.into_iter().map(value).collect()
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Unit {
    Metre,
    Centimetre,
}

impl Unit {
    fn named(text: &str) -> Option<Self> {
        match text {
            "m" | "M" => Some(Self::Metre),
            "cm" | "CM" | "Cm" => Some(Self::Centimetre),
            _ => None,
        }
    }
}

/// Parses digits with at most one decimal sign between or after them; rejects signs and exponents.
fn parse_digits(digits: &str) -> Option<f64> {
    let signs = digits.matches(['.', ',']).count();
    let only_digits = digits.chars().all(|c| c.is_ascii_digit() || c == '.' || c == ',');
    if signs > 1 || !only_digits || !digits.starts_with(|c: char| c.is_ascii_digit()) || digits.len() > 12 {
        return None;
    }
    digits.replace(',', ".").parse().ok()
}

/// Returns the beginning of the typed text for use in a sentence.
pub fn excerpt(text: &str) -> String {
    let clean = clean(text.trim());
    if clean.chars().count() <= 30 { clean } else { clean.chars().take(30).chain(['…']).collect() }
}

/// Returns the typed text without control characters, which could move the cursor.
pub fn clean(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_has_four_notations() {
        for text in ["12.43", "12,43", "12.43 m", "1243 cm", " 12.43m ", "1243cm", "12,43 M", "012.430"] {
            assert_eq!(length(text, DISTANCE), Ok(12.43), "{text}");
        }
        assert_eq!(length("9", DISTANCE), Ok(9.0));
        assert_eq!(length("9.", DISTANCE), Ok(9.0));
    }

    #[test]
    fn a_small_length_may_be_in_millimetres() {
        for text in ["50 mm", "50mm", "5 cm", "5,0 cm", "0.05", "0,050 m", "50.0 MM"] {
            assert_eq!(small("a width", text, ACROSS), Ok(0.05), "{text}");
        }
        for text in ["50", "0", "500 mm", "2 mm", "", "mm", "-50 mm", "50 mm 3", "50 in"] {
            assert!(small("a width", text, ACROSS).unwrap_err().contains("50 mm"), "{text}");
        }
    }

    #[test]
    fn other_texts_are_not_lengths() {
        for text in [
            "",
            " ",
            "m",
            "cm",
            "-3",
            "+3",
            "1e1",
            "inf",
            "nan",
            "NaN",
            "12.43.1",
            "12 ft",
            "1243 mm",
            "3 4",
            "1,2,3",
            "1,243.5",
            "٣",
            "3m4",
            "3 m m",
            "0x10",
            ".5",
            ",5",
            "twelve",
            "12.43 m 3",
            "99999999999999999999",
            "…",
        ] {
            let why = length(text, DISTANCE).unwrap_err();
            assert_eq!(why.lines().count(), 1, "{why}");
        }
        assert!(length("0", DISTANCE).unwrap_err().contains("0.3 to 300 m"));
        assert!(length("1243", DISTANCE).unwrap_err().contains("1243 cm"));
        assert!(length("310", HEIGHT).unwrap_err().contains("100 m"));
    }

    #[test]
    fn several_lengths_fit_in_one_text_line() {
        for text in [
            "3.1 9.8 9.75",
            "3,1 9,8 9,75",
            "3.1, 9.8, 9.75",
            "3,1, 9,8, 9,75",
            "3.1,9.8,9.75",
            "3.1; 9.8; 9.75",
            "3,1;9,8;9,75",
            "310 cm 980 cm 975 cm",
            "310cm, 980cm, 975cm",
            "3.1 m 9.8 m 9.75",
        ] {
            assert_eq!(lengths(text, LENGTH), Ok(vec![3.1, 9.8, 9.75]), "{text}");
        }
        // A unit behind the last one only: the sentence shows how it is meant.
        assert!(lengths("310 980 975 cm", LENGTH).unwrap_err().contains("cm"));
        assert!(lengths("3,1,9,8,9,75", LENGTH).is_err());
    }
}
