//! What the values of options are made of: numbers that are finite, points, assignments.

use service::config::Point;

/// Finite numbers, at least one.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers(pub Vec<f64>);

pub(super) fn finite(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| format!("`{text}` is not a number"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("{text} is not a finite number")) }
}

pub(super) fn above_zero(text: &str) -> Result<f64, String> {
    let value = finite(text)?;
    if value > 0.0 { Ok(value) } else { Err(format!("{text} is not above 0")) }
}

pub(super) fn numbers(text: &str) -> Result<Numbers, String> {
    text.split(',')
        .map(finite)
        .collect::<Result<_, _>>()
        .map(Numbers)
        .map_err(|why| format!("{why}; give numbers separated by commas"))
}

pub(super) fn assignment(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key.trim().to_owned(), value.trim().to_owned())),
        _ => Err(format!("`{text}` is not KEY=VALUE, e.g. controller.horizon_cycles=30")),
    }
}

pub(super) fn point(text: &str) -> Result<Point, String> {
    let Numbers(values) = numbers(text)?;
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
}
