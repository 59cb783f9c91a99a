//! Straight distances from lengths over pulleys of known radius.
//!
//! The part of a cable that a pulley adds depends on the positions of anchor and point only weakly (a share of about
//! radius / length), so the estimate with straightened lengths and the straightening with the estimate converge in a
//! few rounds, each ten to a hundred times closer. At the fixed point the residuals are measured lengths minus
//! [`cable_robot::pulley`] lengths.

use super::error::{CalibrationError, degenerate, invalid};
use super::joint::DirectHeight;
use cable_robot::CableVec;
use cable_robot::anchors::RADII_M;
use cable_robot::pulley::Pulley;
use nalgebra::Vector3;

/// Bound of the rounds; each brings the lengths ten to a hundred times closer.
const MAX_ROUNDS: usize = 20;

/// Change of the straightened lengths below which a further round changes nothing that can be measured, m.
const SETTLED_M: f64 = 1e-8;

/// Least height of an anchor, m: a cable shorter than half of its wheel has no height.
const SMALLEST_HEIGHT_M: f64 = 1e-3;

/// Addition of a pulley to the straight distance before anything is known, in radii: for a cable that falls by 30°.
const TYPICAL: f64 = 1.2;

/// Length that a pulley adds to the straight distance between anchor and point, m.
fn added_m(anchor: &[f64; 3], radius_m: f64, point: &[f64; 3]) -> f64 {
    let (anchor, point) = (Vector3::from(*anchor), Vector3::from(*point));
    let added_m = Pulley::new(anchor, radius_m).length_m(&point) - (point - anchor).norm();
    // A poor estimate may put the point inside the wheel.
    if added_m.is_finite() { added_m } else { TYPICAL * radius_m }
}

/// Straightens the lengths to one point with typical additions.
pub(crate) fn typical(lengths_m: &CableVec, radii_m: &[f64]) -> CableVec {
    lengths_m.zip_map(radii_m, |l, r| l - TYPICAL * r)
}

/// Straightens the lengths to one point for anchors and point that are known approximately; `scale` is measured divided
/// by true length.
pub(crate) fn at(
    lengths_m: &CableVec,
    radii_m: &[f64],
    anchors_m: &[[f64; 3]],
    point_m: &[f64; 3],
    scale: f64,
) -> CableVec {
    CableVec::from_fn(lengths_m.len(), |i| lengths_m[i] - scale * added_m(&anchors_m[i], radii_m[i], point_m))
}

/// Where anchors and points are according to an estimate with straightened lengths.
pub(crate) struct Geometry {
    pub(crate) anchors_m: Vec<[f64; 3]>,
    pub(crate) points_m: Vec<[f64; 3]>,
    /// Measured divided by true length.
    pub(crate) scale: f64,
}

/// Checks one radius per cable.
pub(crate) fn check_radii(cables: usize, radii_m: &[f64]) -> Result<(), CalibrationError> {
    if radii_m.len() != cables {
        return invalid(format!("{} pulley radii are given for {cables} cables", radii_m.len()));
    }
    match radii_m.iter().find(|r| !RADII_M.contains(*r)) {
        Some(r) => invalid(format!("a pulley radius is {r} m; accepted: 0 (an eye) to {} m", RADII_M.end())),
        None => Ok(()),
    }
}

/// Heights above the plane; a cable that hangs to the floor lies on half of its wheel.
fn heights(heights: &[DirectHeight], radii_m: &[f64], scale: f64) -> Vec<DirectHeight> {
    let straight = |h: &DirectHeight| {
        let wheel_m = if h.by_line { scale * std::f64::consts::PI * radii_m[h.anchor] } else { 0.0 };
        DirectHeight { m: (h.m - wheel_m).max(SMALLEST_HEIGHT_M), ..*h }
    };
    heights.iter().map(straight).collect()
}

/// Refuses lengths that the wheel uses up: the measurements contradict each other, although each of them is a length.
fn check_straight(straight_m: &[CableVec], lengths_m: &[CableVec], radii_m: &[f64]) -> Result<(), CalibrationError> {
    for (point, (straight, measured)) in straight_m.iter().zip(lengths_m).enumerate() {
        // Also true for NaN.
        if let Some(cable) = straight.iter().position(|l| !(*l >= 0.0)) {
            return degenerate(format!(
                "the length of cable {} at point {} is {:.3} m, and its wheel of {:.0} mm takes up more than that; \
                 measure the length and the radius again",
                cable + 1,
                point + 1,
                measured[cable],
                1000.0 * radii_m[cable]
            ));
        }
    }
    Ok(())
}

/// Alternates between `estimate` with straightened lengths and heights, and the straightening with its result.
///
/// # Errors
/// `degenerate_geometry` for lengths that the wheels use up, and the errors of `estimate`.
pub(crate) fn settle<T>(
    lengths_m: &[CableVec],
    direct: &[DirectHeight],
    radii_m: &[f64],
    estimate: impl Fn(&[CableVec], &[DirectHeight]) -> Result<T, CalibrationError>,
    geometry: impl Fn(&T) -> Geometry,
) -> Result<T, CalibrationError> {
    let mut straight: Vec<_> = lengths_m.iter().map(|l| typical(l, radii_m)).collect();
    check_straight(&straight, lengths_m, radii_m)?;
    let mut found = estimate(&straight, &heights(direct, radii_m, 1.0))?;
    for _ in 0..MAX_ROUNDS {
        let near = geometry(&found);
        let next: Vec<_> = (lengths_m.iter().zip(&near.points_m))
            .map(|(l, point)| at(l, radii_m, &near.anchors_m, point, near.scale))
            .collect();
        let change = next.iter().zip(&straight).map(|(a, b)| a.zip_map(b, |a, b| a - b).max_abs()).fold(0.0, f64::max);
        straight = next;
        check_straight(&straight, lengths_m, radii_m)?;
        found = estimate(&straight, &heights(direct, radii_m, near.scale))?;
        if change < SETTLED_M {
            break;
        }
    }
    Ok(found)
}
