//! Parsers for the values of arguments: finite numbers, times, points, assignments.

use config::Point;

/// At least one finite number.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers(pub Vec<f64>);

/// Largest accepted number: no quantity of a robot is larger in any unit.
const LARGEST: f64 = 1e9;
/// Longest accepted time, s: four months.
const LONGEST_S: f64 = 1e7;
/// Largest accepted coordinate, m.
const FARTHEST_M: f64 = 1e5;

/// Parses a finite number of at most 1e9.
///
/// # Errors
/// The text is not such a number.
pub fn finite(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| format!("`{text}` is not a number"))?;
    match value {
        _ if !value.is_finite() => Err(format!("{text} is not a finite number")),
        _ if value.abs() > LARGEST => Err(format!("{text} is too large; accepted: numbers within {LARGEST:e}")),
        _ => Ok(value),
    }
}

/// Parses a time above 0, s.
///
/// # Errors
/// The text is not such a time.
pub fn seconds(text: &str) -> Result<f64, String> {
    let value = finite(text)?;
    if value > 0.0 && value <= LONGEST_S {
        Ok(value)
    } else {
        Err(format!("the time is {text}; accepted: above 0, at most {LONGEST_S:e} s"))
    }
}

/// Parses a number above 0.
///
/// # Errors
/// The text is not such a number.
pub fn above_zero(text: &str) -> Result<f64, String> {
    let value = finite(text)?;
    if value > 0.0 { Ok(value) } else { Err(format!("the value is {text}; accepted: above 0")) }
}

/// Parses a number of at least 0.
///
/// # Errors
/// The text is not such a number.
pub fn not_negative(text: &str) -> Result<f64, String> {
    let value = finite(text)?;
    if value >= 0.0 { Ok(value) } else { Err(format!("the value is {text}; accepted: at least 0")) }
}

/// Parses numbers separated by commas.
///
/// # Errors
/// One of them is not a finite number.
pub fn numbers(text: &str) -> Result<Numbers, String> {
    text.split(',')
        .map(finite)
        .collect::<Result<_, _>>()
        .map(Numbers)
        .map_err(|why| format!("{why}; give numbers separated by commas"))
}

/// Parses `KEY=VALUE`.
///
/// # Errors
/// There is no `=` or no key.
pub fn assignment(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key.trim().to_owned(), value.trim().to_owned())),
        _ => Err(format!("`{text}` is not KEY=VALUE, e.g. controller.horizon_cycles=30")),
    }
}

/// Parses two or three coordinates separated by commas, m.
///
/// # Errors
/// The text is not two or three finite coordinates.
pub fn point(text: &str) -> Result<Point, String> {
    let Numbers(values) = numbers(text)?;
    if let Some(far) = values.iter().find(|value| value.abs() > FARTHEST_M) {
        return Err(format!("a coordinate is {far}; accepted: within {FARTHEST_M:e} m"));
    }
    Point::from_numbers(&values).map_err(|why| format!("{why}, separated by commas, e.g. 4.8,3.0,0.3"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_two_or_three_finite_numbers() {
        assert_eq!(point("-1, 2,3e-1"), Ok([-1.0, 2.0, 0.3].into()));
        assert_eq!(point("1,2"), Ok(Point { position_m: [1.0, 0.0, 2.0], planar: true }));
        for bad in ["", "1", "1,2,3,4", "1,2,nan", "1,2,inf", "1;2;3", "1,2,3m"] {
            assert!(point(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn values_out_of_range_are_rejected_with_the_accepted_range() {
        for (refused, says) in [
            (point("1,2,1e300").map(|_| ()), "1e9"),
            (point("1,2,1e6").map(|_| ()), "1e5 m"),
            (finite("-1.7e150").map(|_| ()), "1e9"),
            (numbers("1,1e10").map(|_| ()), "1e9"),
            (above_zero("1e10").map(|_| ()), "1e9"),
            (seconds("1.7e150").map(|_| ()), "1e9"),
            (seconds("1e8").map(|_| ()), "1e7 s"),
            (seconds("0").map(|_| ()), "above 0"),
            (seconds("-3").map(|_| ()), "above 0"),
        ] {
            let sentence = refused.unwrap_err();
            assert!(sentence.contains(says) && sentence.len() < 100, "{sentence}");
        }
        assert_eq!(seconds("1e7"), Ok(1e7));
    }
}
