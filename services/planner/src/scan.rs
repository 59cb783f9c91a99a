//! Patterns over an area, a line or points: the way points of their entries in mission files.
//!
//! Pure geometry in metres; the limits of the robot are checked when segments are made. A pattern is a list of
//! [`Stop`]s, flown straight from one to the next.

use cable_robot::Vector3;
pub use mission::pattern::{Adaptive, Axis, By, DwellPoints, Profile, Raster, Transect};
use survey::adaptive::{Merit, Patch};
use thiserror::Error;

/// Most lines of a raster.
pub const MAX_LINES: usize = 500;

/// Most stops of a transect.
pub const MAX_STOPS: usize = 1000;

/// Coordinates of two corners that differ by less than this are the same, m.
const SAME_M: f64 = 1e-6;

/// Returns the merit by which an entry of a mission file chooses.
#[must_use]
pub fn merit(by: By) -> Merit {
    match by {
        By::Gradient => Merit::Gradient,
        By::Variance => Merit::Variance,
    }
}

/// Point of a pattern, with the duration of the stay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// Position, m.
    pub at: Vector3<f64>,
    /// Duration of the stay, s; 0: only a rest between two segments.
    pub dwell_s: f64,
}

/// Invalid pattern.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ScanError {
    /// All three coordinates of the corners differ.
    #[error(
        "corner_m and opposite_m differ in x, y and z; a raster is level, or upright along x or y: make one of the coordinates the same"
    )]
    Box,
    /// The corners are one point.
    #[error("corner_m and opposite_m are the same point; give two corners of the area")]
    NoArea,
    /// The requested direction leaves the plane of the area.
    #[error(
        "along is {axis}, and the area has no extent in that direction; accepted: an axis in which the corners differ"
    )]
    Across {
        /// Requested axis.
        axis: &'static str,
    },
    /// The pitch needs too many lines.
    #[error(
        "the raster would have {lines} lines; accepted: up to {MAX_LINES}; take a larger pitch_m or several missions"
    )]
    TooFine {
        /// Required number.
        lines: f64,
    },
    /// Too many stays.
    #[error("it would stop {stops} times; accepted: up to {MAX_STOPS}; take a larger step_m or pitch_m")]
    TooMany {
        /// Required number.
        stops: f64,
    },
}

/// Returns alternating lines over the rectangle between two corners (m), evenly spaced by `spacing_m` or less: no point
/// of the rectangle is farther than half of that from a line. It begins on the side of `corner`. A rectangle without
/// width is one line.
///
/// # Errors
/// Corners that span no level or upright rectangle, a direction across it, or more than [`MAX_LINES`] lines.
pub fn raster(
    corner: Vector3<f64>,
    opposite: Vector3<f64>,
    spacing_m: f64,
    along: Option<Axis>,
) -> Result<Vec<Vector3<f64>>, ScanError> {
    let size = opposite - corner;
    let spanned = |axis: usize| size[axis].abs() > SAME_M;
    let longer = match (0..3).filter(|axis| spanned(*axis)).count() {
        0 => return Err(ScanError::NoArea),
        3 => return Err(ScanError::Box),
        _ => size.iamax(),
    };
    let fast = match along {
        None => longer,
        Some(axis) if spanned(axis.index()) => axis.index(),
        Some(axis) => return Err(ScanError::Across { axis: Axis::ALL[axis.index()].1 }),
    };
    let slow = (0..3).find(|axis| *axis != fast && spanned(*axis));
    let width_m = slow.map_or(0.0, |axis| size[axis].abs());
    // a strip that is wider by rounding alone needs no second line
    let lines = (width_m / spacing_m - 1e-9).ceil();
    let lines = if lines < 1.0 { 1.0 } else { lines };
    // NaN is too many as well.
    if !lines.is_finite() || lines > MAX_LINES as f64 {
        return Err(ScanError::TooFine { lines });
    }
    let mut points = Vec::with_capacity(2 * lines as usize);
    for line in 0..lines as usize {
        let mut near = corner;
        if let Some(axis) = slow {
            near[axis] += size[axis] * (line as f64 + 0.5) / lines;
        }
        let mut far = near;
        far[fast] = opposite[fast];
        points.extend(if line % 2 == 0 { [near, far] } else { [far, near] });
    }
    Ok(points)
}

/// Returns alternating lines over each of the patches at a height (m), at most `spacing_m` apart, beginning at the end
/// of a patch that is nearer to the end of the last one; from `from` on.
///
/// # Errors
/// A patch that needs more than [`MAX_LINES`] lines.
pub fn over_patches(
    patches: &[Patch],
    height_m: f64,
    spacing_m: f64,
    from: Vector3<f64>,
) -> Result<Vec<Vector3<f64>>, ScanError> {
    let mut way: Vec<Vector3<f64>> = Vec::new();
    for patch in patches {
        let [low, high] = [patch.low_m, patch.high_m].map(|[x, y]| Vector3::new(x, y, height_m));
        let along = if patch.along == 0 { Axis::X } else { Axis::Y };
        let mut lines = raster(low, high, spacing_m, Some(along))?;
        let here = way.last().copied().unwrap_or(from);
        if let (Some(first), Some(last)) = (lines.first(), lines.last())
            && (last - here).norm() < (first - here).norm()
        {
            lines.reverse();
        }
        way.extend(lines);
    }
    Ok(way)
}

/// Returns a straight path with stays at both ends and in between, at most `step_m` apart.
///
/// # Errors
/// More than [`MAX_STOPS`] stays.
pub fn transect(
    from: Vector3<f64>,
    to: Vector3<f64>,
    step_m: Option<f64>,
    dwell_s: f64,
) -> Result<Vec<Stop>, ScanError> {
    let steps = step_m.map_or(1.0, |step_m| ((to - from).norm() / step_m - 1e-9).ceil().max(1.0));
    if !steps.is_finite() || steps >= MAX_STOPS as f64 {
        return Err(ScanError::TooMany { stops: steps + 1.0 });
    }
    let at = |step: usize| from + (to - from) * (step as f64 / steps);
    Ok((0..=steps as usize).map(|step| Stop { at: at(step), dwell_s }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn distance(point: &Vector3<f64>, way: &[Vector3<f64>]) -> f64 {
        let to_piece = |a: &Vector3<f64>, b: &Vector3<f64>| {
            let along = b - a;
            let share = if along.norm() > 0.0 { (point - a).dot(&along) / along.norm_squared() } else { 0.0 };
            (point - (a + along * share.clamp(0.0, 1.0))).norm()
        };
        way.windows(2).map(|pair| to_piece(&pair[0], &pair[1])).fold(f64::INFINITY, f64::min)
    }

    proptest! {
        /// No point of the area is farther than half a spacing from the way, and the way never leaves the area.
        #[test]
        fn a_raster_covers_its_area_and_stays_inside(
            corner in prop::array::uniform3(-5.0..5.0f64),
            size in prop::array::uniform2(-3.0..3.0f64),
            flat in 0..3usize,
            pitch_m in 0.05..1.0f64,
            overlap in 0.0..0.9f64,
            lengthwise in prop::option::of(any::<bool>()),
            probes in prop::collection::vec(prop::array::uniform2(0.0..=1.0f64), 50),
        ) {
            let corner = Vector3::from(corner);
            let free: Vec<usize> = (0..3).filter(|axis| *axis != flat).collect();
            prop_assume!(size.iter().all(|side| side.abs() > 0.01));
            let mut opposite = corner;
            opposite[free[0]] += size[0];
            opposite[free[1]] += size[1];
            let along = lengthwise.map(|first| Axis::ALL[free[usize::from(!first)]].0);
            let spacing_m = pitch_m * (1.0 - overlap);
            let way = raster(corner, opposite, spacing_m, along).unwrap();
            for probe in probes {
                let mut point = corner;
                point[free[0]] += size[0] * probe[0];
                point[free[1]] += size[1] * probe[1];
                prop_assert!(distance(&point, &way) <= 0.5 * spacing_m + 1e-9);
            }
            for point in &way {
                for axis in 0..3 {
                    let (low, high) = (corner[axis].min(opposite[axis]), corner[axis].max(opposite[axis]));
                    prop_assert!((low - 1e-9..=high + 1e-9).contains(&point[axis]));
                }
            }
            // it begins on the side of the corner, and never needs more lines than strips
            prop_assert!((way[0] - corner).norm() <= 0.5 * spacing_m + 1e-9);
            let across = (0..3).find(|axis| (way[0] - way[1])[*axis] == 0.0 && *axis != flat);
            if let Some(across) = across {
                let width = (opposite - corner)[across].abs();
                prop_assert!(way.len() as f64 / 2.0 <= width / spacing_m + 1.0 + 1e-6);
            }
        }

        #[test]
        fn stays_of_a_transect_are_even_and_close_enough(
            from in prop::array::uniform3(-5.0..5.0f64),
            to in prop::array::uniform3(-5.0..5.0f64),
            step_m in 0.05..2.0f64,
        ) {
            let (from, to) = (Vector3::from(from), Vector3::from(to));
            let stops = transect(from, to, Some(step_m), 1.0).unwrap();
            prop_assert!((stops[0].at - from).norm() < 1e-12 && (stops[stops.len() - 1].at - to).norm() < 1e-12);
            for pair in stops.windows(2) {
                prop_assert!((pair[1].at - pair[0].at).norm() <= step_m + 1e-9);
            }
        }
    }

    #[test]
    fn invalid_areas_are_rejected_with_their_reason() {
        let at = |x, y, z| Vector3::new(x, y, z);
        let corner = at(1.0, 1.0, 1.0);
        let refusal = |opposite, spacing_m, along| raster(corner, opposite, spacing_m, along).unwrap_err();
        assert_eq!(refusal(at(2.0, 2.0, 2.0), 0.1, None), ScanError::Box);
        assert_eq!(refusal(corner, 0.1, None), ScanError::NoArea);
        assert_eq!(refusal(at(2.0, 2.0, 1.0), 0.1, Some(Axis::Z)), ScanError::Across { axis: "z" });
        // A metre in steps of a millimetre.
        let fine = refusal(at(2.0, 2.0, 1.0), 0.001, None);
        assert!(matches!(fine, ScanError::TooFine { lines } if (1000.0..=1001.0).contains(&lines)), "{fine:?}");
        let unknown = refusal(at(2.0, 2.0, 1.0), f64::NAN, None);
        assert!(matches!(unknown, ScanError::TooFine { lines } if lines.is_nan()), "{unknown:?}");
        assert_eq!(raster(corner, at(2.0, 1.0, 1.0), 0.1, None).unwrap(), [corner, at(2.0, 1.0, 1.0)]);
        let often = transect(corner, at(2.0, 1.0, 1.0), Some(1e-4), 1.0).unwrap_err();
        assert!(matches!(often, ScanError::TooMany { stops } if stops >= 1e4), "{often:?}");
    }
}
