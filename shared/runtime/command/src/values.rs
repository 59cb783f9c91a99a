//! What the values of options are made of: numbers that are finite, points, assignments.

use config::Point;

/// Finite numbers, at least one.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers(pub Vec<f64>);

/// No quantity of a robot is larger, in whatever unit: what is has lost its decimal point.
const LARGEST: f64 = 1e9;
/// Longest time that can be asked for, s: four months.
const LONGEST_S: f64 = 1e7;
/// Farthest point, m.
const FARTHEST_M: f64 = 1e5;

/// A finite number within what any quantity of a robot can be.
///
/// # Errors
/// Not such a number.
pub fn finite(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| format!("`{text}` is not a number"))?;
    match value {
        _ if !value.is_finite() => Err(format!("{text} is not a finite number")),
        _ if value.abs() > LARGEST => Err(format!("{text} is too large; accepted: numbers within {LARGEST:e}")),
        _ => Ok(value),
    }
}

/// A time above 0, s.
///
/// # Errors
/// Not such a time.
pub fn seconds(text: &str) -> Result<f64, String> {
    let value = finite(text)?;
    if value > 0.0 && value <= LONGEST_S {
        Ok(value)
    } else {
        Err(format!("{text} is no such time; accepted: above 0, at most {LONGEST_S:e} s"))
    }
}

/// A number above 0.
///
/// # Errors
/// Not such a number.
pub fn above_zero(text: &str) -> Result<f64, String> {
    let value = finite(text)?;
    if value > 0.0 { Ok(value) } else { Err(format!("{text} is not above 0")) }
}

/// A number that is not below 0.
///
/// # Errors
/// Not such a number.
pub fn not_negative(text: &str) -> Result<f64, String> {
    let value = finite(text)?;
    if value >= 0.0 { Ok(value) } else { Err(format!("{text} is less than 0")) }
}

/// Numbers separated by commas.
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

/// `KEY=VALUE`.
///
/// # Errors
/// There is no key.
pub fn assignment(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key.trim().to_owned(), value.trim().to_owned())),
        _ => Err(format!("`{text}` is not KEY=VALUE, e.g. controller.horizon_cycles=30")),
    }
}

/// Two or three coordinates separated by commas, m.
///
/// # Errors
/// Not two or three finite coordinates.
pub fn point(text: &str) -> Result<Point, String> {
    let Numbers(values) = numbers(text)?;
    if let Some(far) = values.iter().find(|value| value.abs() > FARTHEST_M) {
        return Err(format!("{far} is too far away; accepted: coordinates within {FARTHEST_M:e} m"));
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
    fn what_is_beyond_any_robot_is_refused_with_what_is_accepted() {
        for (refused, says) in [
            (point("1,2,1e300").map(|_| ()), "1e9"),
            (point("1,2,1e6").map(|_| ()), "1e5 m"),
            (finite("-1.7e150").map(|_| ()), "1e9"),
            (numbers("1,1e10").map(|_| ()), "1e9"),
            (above_zero("1e10").map(|_| ()), "1e9"),
            (seconds("1.7e150").map(|_| ()), "1e9"),
            (seconds("1e8").map(|_| ()), "at most 1e7 s"),
            (seconds("0").map(|_| ()), "above 0"),
            (seconds("-3").map(|_| ()), "above 0"),
        ] {
            let sentence = refused.unwrap_err();
            assert!(sentence.contains(says) && sentence.len() < 100, "{sentence}");
        }
        assert_eq!(seconds("1e7"), Ok(1e7));
    }
}
