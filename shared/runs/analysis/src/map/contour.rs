//! Contour lines of a grid by marching squares.

use plot::ticks;

/// Approximate number of labels at the colour bar of a map.
const NUMBERS: f64 = 8.0;

/// Returns the labels for the colour bar of this range.
pub(super) fn numbers(range: [f64; 2]) -> Vec<f64> {
    ticks(range, NUMBERS)
}

/// Returns the values of the contour lines, half-way between the labels: built objects often have round heights, and a
/// contour line at the height of level ground only follows noise.
#[must_use]
pub fn levels([low, high]: [f64; 2]) -> Vec<f64> {
    let numbers = numbers([low, high]);
    let half = numbers.windows(2).map(|two| 0.5 * (two[1] - two[0])).next().unwrap_or(high - low);
    let below = numbers.first().map(|first| first - half).into_iter();
    below.chain(numbers.iter().map(|number| number + half)).filter(|level| (low..high).contains(level)).collect()
}

/// Returns the contour line of one value as pieces between the centres of four known cells, x and y in columns and
/// rows.
///
/// If opposite corners of a square are on the same side of the value and adjacent ones are not, the mean of the four
/// corners decides which pairs are joined.
#[must_use]
pub fn contours(
    value: &dyn Fn(usize, usize) -> Option<f64>,
    columns: usize,
    rows: usize,
    level: f64,
) -> Vec<[[f64; 2]; 2]> {
    let mut lines = Vec::new();
    for row in 0..rows.saturating_sub(1) {
        for column in 0..columns.saturating_sub(1) {
            // Anticlockwise from the low corner.
            let corners = [(0, 0), (1, 0), (1, 1), (0, 1)];
            let values = corners.map(|(c, r)| value(column + c, row + r));
            let [Some(a), Some(b), Some(c), Some(d)] = values else { continue };
            let over = [a, b, c, d].map(|value| value > level);
            let at = |k: usize| {
                let (from, to) = (corners[k], corners[(k + 1) % 4]);
                let (low, high) = ([a, b, c, d][k], [a, b, c, d][(k + 1) % 4]);
                let share = if high == low { 0.5 } else { (level - low) / (high - low) };
                let along = |from: usize, to: usize| from as f64 + share * (to as f64 - from as f64);
                [column as f64 + along(from.0, to.0), row as f64 + along(from.1, to.1)]
            };
            let crossed: Vec<usize> = (0..4).filter(|k| over[*k] != over[(k + 1) % 4]).collect();
            match crossed.as_slice() {
                [one, other] => lines.push([at(*one), at(*other)]),
                [_, _, _, _] => {
                    let middle = 0.25 * (a + b + c + d) > level;
                    // Cut off the corners that are not on the same side as the middle.
                    let pairs = if over[0] == middle { [[0, 1], [2, 3]] } else { [[3, 0], [1, 2]] };
                    lines.extend(pairs.map(|[one, other]| [at(one), at(other)]));
                }
                _ => {}
            }
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contours_of_a_plane_are_exact() {
        let plane = |column: usize, row: usize| Some(column as f64 + 2.0 * row as f64);
        let lines = contours(&plane, 10, 10, 7.3);
        assert!(lines.len() > 8);
        for [x, y] in lines.into_iter().flatten() {
            assert!((x + 2.0 * y - 7.3).abs() < 1e-12);
        }
    }

    #[test]
    fn the_contour_of_a_cone_is_a_closed_circle() {
        let hill = |column: usize, row: usize| {
            let (x, y) = (column as f64 - 50.0, row as f64 - 50.0);
            Some((x * x + y * y).sqrt())
        };
        let lines = contours(&hill, 101, 101, 30.5);
        let length: f64 = lines.iter().map(|[a, b]| ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sqrt()).sum();
        assert!((length / (std::f64::consts::TAU * 30.5) - 1.0).abs() < 0.01, "{length}");
        // Each end point is shared by two pieces.
        for [x, y] in lines.iter().flatten() {
            let near = lines.iter().flatten().filter(|p| (p[0] - x).abs() < 1e-9 && (p[1] - y).abs() < 1e-9);
            assert_eq!(near.count(), 2);
        }
    }

    #[test]
    fn a_saddle_has_two_lines_and_unknown_cells_have_none() {
        let saddle = |column: usize, row: usize| Some(if (column + row).is_multiple_of(2) { 1.0 } else { 0.0 });
        for level in [0.4, 0.6] {
            let lines = contours(&saddle, 2, 2, level);
            assert_eq!(lines.len(), 2);
            // Below the mean the two high corners are joined, above it the low ones.
            let cut = lines.iter().flatten().filter(|p| p[0] + p[1] < 1.0).count();
            assert_eq!(cut, if level < 0.5 { 0 } else { 2 } + usize::from(level < 0.5) * 2);
        }
        let holed = |column: usize, row: usize| (column + row > 0).then_some(column as f64);
        assert!(contours(&holed, 2, 2, 0.5).is_empty());
    }
}
