//! Whether a measured radius of the pulleys may be their diameter, or half of the radius.
//!
//! A diameter that is stated as a radius is the usual slip, and the deviation that is stated with it (a millimetre of a
//! ruler) excludes what is true. The lengths are therefore asked without that deviation which of three radii fits them
//! best: the stated one, half of it, or twice as much. Nine to twelve points leave the radius uncertain by 30 to 50 mm,
//! so they seldom tell; heights by a tape do.

use super::measurements::{Calibration, Measurements, Method};
use super::pattern;

/// Least advantage of one radius over another, as twice the logarithm of the ratio of their likelihoods. By chance
/// alone it is met less than once in a hundred calibrations; what the model does not have, poles that yield and cables
/// that sag, may give a part of it.
const LEAST_ADVANTAGE: f64 = 9.0;

/// What the lengths say about a radius that may be a diameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RadiusCheck {
    /// They exclude half and twice the stated radius.
    Confirmed,
    /// They do not tell.
    Open,
    /// Half or twice the stated radius fits them much better.
    Slip(RadiusSlip),
}

/// A radius that is rather half or twice as large as stated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadiusSlip {
    /// The stated radius, mean of all pulleys, m.
    pub stated_m: f64,
    /// Half or twice of it, m.
    pub likely_m: f64,
    /// The radius that the lengths suggest by themselves, m.
    pub suggested_m: f64,
    /// Standard deviation of `suggested_m`.
    pub suggested_std_m: f64,
}

/// Compares a measured radius with half and twice of it. None if no radius was measured (`sigma_pulley_radius_m`), and
/// for methods other than the joint one.
///
/// ```
/// use cable_robot::{CableVec, Vector3, pulley::Pulley};
/// use calibration::{DirectHeight, Measurements, Method, RadiusCheck, Range, calibrate, radius_check};
/// let anchors = [[0.0, 0.0, 3.0], [10.0, 0.0, 3.2], [10.0, 8.0, 2.9f64], [0.0, 8.0, 3.1]];
/// let mut measured = Measurements { sigma_pulley_radius_m: Some(0.001), ..Measurements::new(4) };
/// for (from, to) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
///     let (a, b): ([f64; 3], [f64; 3]) = (anchors[from], anchors[to]);
///     measured.ranges.push(Range { from, to, m: (a[0] - b[0]).hypot(a[1] - b[1]), sigma_m: 0.003 });
/// }
/// for [x, y] in [[1.0, 0.8], [9.0, 0.8], [9.0, 7.2], [1.0, 7.2], [5.0, 4.0], [3.0, 2.0]] {
///     let length = |i: usize| Pulley::new(anchors[i].into(), 0.03).length_m(&Vector3::new(x, y, 0.0));
///     measured.lengths_m.push(CableVec::from_fn(4, length));
/// }
/// let check = |measured: &Measurements, radius_m: f64| {
///     let measured = Measurements { pulley_radius_m: vec![radius_m; 4], ..measured.clone() };
///     radius_check(&measured, &calibrate(&measured, Method::Joint).unwrap()).unwrap()
/// };
/// // Six points do not tell a radius from a diameter.
/// assert_eq!(check(&measured, 0.06), RadiusCheck::Open);
/// // With the heights of the anchors they do.
/// let height = |anchor: usize| DirectHeight { anchor, m: anchors[anchor][2], sigma_m: 0.01, by_line: false };
/// measured.heights = (0..4).map(height).collect();
/// assert!(matches!(check(&measured, 0.06), RadiusCheck::Slip(_)));
/// assert_eq!(check(&measured, 0.03), RadiusCheck::Confirmed);
/// ```
#[must_use]
pub fn radius_check(measured: &Measurements, found: &Calibration) -> Option<RadiusCheck> {
    let stated_m = measured.pulley_radius_m.iter().sum::<f64>() / measured.pulley_radius_m.len().max(1) as f64;
    if found.method != Method::Joint || measured.sigma_pulley_radius_m.is_none() || !(stated_m > 0.0) {
        return None;
    }
    let open = Measurements { sigma_pulley_radius_m: None, ..measured.clone() };
    let Some((change_m, std_m)) = pattern::radius_beyond(&open, found) else { return Some(RadiusCheck::Open) };
    // By how much the radius `to_m` fits worse than the best one.
    let misfit = |to_m: f64| ((stated_m + change_m - to_m) / std_m).powi(2);
    let (half_m, twice_m) = (0.5 * stated_m, 2.0 * stated_m);
    let likely_m = if misfit(half_m) < misfit(twice_m) { half_m } else { twice_m };
    let advantage = misfit(stated_m) - misfit(likely_m);
    Some(if advantage > LEAST_ADVANTAGE {
        let suggested_m = stated_m + change_m;
        RadiusCheck::Slip(RadiusSlip { stated_m, likely_m, suggested_m, suggested_std_m: std_m })
    } else if advantage < -LEAST_ADVANTAGE {
        RadiusCheck::Confirmed
    } else {
        RadiusCheck::Open
    })
}
