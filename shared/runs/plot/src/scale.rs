//! Ranges of axes, their labels, and what of a line is inside them.

use crate::picture::Axis;

/// Returns the limits of an axis: the given ones, or those of the data with a margin.
pub(crate) fn axis_range(axis: &Axis, values: impl Iterator<Item = f64>) -> [f64; 2] {
    if let Some(range) = axis.range {
        return range;
    }
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in values.filter(|value| value.is_finite()) {
        (low, high) = (low.min(value), high.max(value));
    }
    if low > high {
        return [0.0, 1.0];
    }
    // Charts of quantities that start at zero show the zero.
    if low >= 0.0 && low < 0.4 * high {
        return [0.0, high * 1.06];
    }
    let air = 0.05 * (high - low).max(1e-9 * high.abs()).max(1e-12);
    [low - air, high + air]
}

/// Extends the narrower of two ranges until both have the same scale on an area of this size in px.
pub fn equalise(x: &mut [f64; 2], y: &mut [f64; 2], (width, height): (u32, u32)) {
    let per_pixel = |range: &[f64; 2], pixels: u32| (range[1] - range[0]) / f64::from(pixels.max(1));
    let scale = per_pixel(x, width).max(per_pixel(y, height));
    for (range, pixels) in [(x, width), (y, height)] {
        let (middle, half) = (0.5 * (range[0] + range[1]), 0.5 * scale * f64::from(pixels));
        *range = [middle - half, middle + half];
    }
}

/// Formats a tick value with the fewest digits that distinguish it from its neighbours.
pub fn format_tick(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    if rounded == 0.0 { "0".to_owned() } else { format!("{rounded}") }
}

/// Returns the parts of a line inside the ranges. A line that leaves the chart is cut at its edge, not at a false
/// value.
pub(crate) fn clip_line(points: &[[f64; 2]], x: [f64; 2], y: [f64; 2]) -> Vec<Vec<(f64, f64)>> {
    let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut open = false;
    for pair in points.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        // Clipping by Liang and Barsky: the share of the segment that is inside.
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        let mut inside = a.iter().chain(&b).all(|value| value.is_finite());
        for (k, range) in [x, y].iter().enumerate() {
            let d = b[k] - a[k];
            if d == 0.0 {
                inside &= (range[0]..=range[1]).contains(&a[k]);
            } else {
                let (s, t) = ((range[0] - a[k]) / d, (range[1] - a[k]) / d);
                enter = enter.max(s.min(t));
                leave = leave.min(s.max(t));
            }
        }
        if !inside || enter > leave {
            open = false;
            continue;
        }
        let at = |share: f64| (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]));
        match pieces.last_mut() {
            Some(piece) if open && enter == 0.0 => piece.push(at(leave)),
            _ => pieces.push(vec![at(enter), at(leave)]),
        }
        open = leave == 1.0;
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_scale_on_both_axes_keeps_the_middle() {
        let (mut x, mut y) = ([0.0, 2.0], [0.0, 1.0]);
        equalise(&mut x, &mut y, (100, 100));
        assert_eq!((x, y), ([0.0, 2.0], [-0.5, 1.5]));
    }

    #[test]
    fn a_line_is_cut_where_it_leaves_the_chart() {
        let points = [[0.0, 4.0], [1.0, 0.0], [2.0, 1.0], [f64::NAN, 0.0], [3.0, 1.0], [4.0, -1.0]];
        let pieces = clip_line(&points, [0.0, 10.0], [0.0, 2.0]);
        assert_eq!(pieces, [vec![(0.5, 2.0), (1.0, 0.0), (2.0, 1.0)], vec![(3.0, 1.0), (3.5, 0.0)]]);
    }
}
