//! What a radius of the pulleys that was not measured may hide.
//!
//! Lengths over wheels that are taken for lengths through eyes leave residuals of millimetres and anchors that are off
//! by a decimetre: heights and distances imitate the wheels. "Eye" is a word, and no measurement. The alternative, all
//! radii changed by the same amount, is therefore always fitted unless a radius was measured, which
//! `sigma_pulley_radius_m` states. The result is as uncertain as the farthest alternative that the measurements leave
//! possible.

use super::estimate::calibrate;
use super::measurements::{Calibration, Measurements};
use super::pattern;

/// Largest radius of a pulley that is considered where none was measured, m: sheaves for cords have 15 to 40 mm, those
/// for ropes of 10 mm up to 60.
pub const LARGEST_RADIUS_M: f64 = 0.06;

/// A radius is excluded if it is this many standard deviations from the estimated one. The deviation of the radius is
/// linear and counts no poles that yield and no cables that sag, so two are not enough.
const EXCLUDED_SIGMAS: f64 = 4.0;

/// Half-width of a normal 95 % interval, in standard deviations.
const HALF_WIDTH_95: f64 = 1.959_964;

/// Shares of the change of the radius that are tried until one of them has a calibration.
const SHARES: [f64; 3] = [1.0, 0.5, 0.25];

/// What another radius of the pulleys, which was not measured, would change.
#[derive(Debug, Clone, PartialEq)]
pub struct UnmeasuredRadius {
    /// Mean radius of the farthest alternative that the measurements leave possible, m.
    pub radius_m: f64,
    /// Its difference from the stated one, m.
    pub change_m: f64,
    /// The coordinate that would move most: anchor from 0.
    pub anchor: usize,
    /// Axis of that coordinate: 0 x, 1 y, 2 z.
    pub axis: usize,
    /// How far it would move, m.
    pub shift_m: f64,
    /// How far each coordinate would move, m.
    pub shifts_m: Vec<[f64; 3]>,
}

/// Compares a calibration with those for other radii of all pulleys together, from 0 to [`LARGEST_RADIUS_M`] and within
/// four standard deviations of the radius that the measurements suggest; it returns the farthest. None if the radius
/// was measured (`sigma_pulley_radius_m`), or if no alternative remains.
#[must_use]
pub fn unmeasured_radius(measured: &Measurements, found: &Calibration) -> Option<UnmeasuredRadius> {
    let radii_m = &measured.pulley_radius_m;
    let has_wheels = radii_m.iter().any(|r| *r > 0.0);
    if has_wheels && measured.sigma_pulley_radius_m.is_some() {
        return None;
    }
    let stated_m = radii_m.iter().sum::<f64>() / radii_m.len().max(1) as f64;
    let (least_m, most_m) = match pattern::radius_beyond(measured, found) {
        Some((change_m, std_m)) => {
            let about_m = stated_m + change_m;
            (about_m - EXCLUDED_SIGMAS * std_m, about_m + EXCLUDED_SIGMAS * std_m)
        }
        None => (0.0, LARGEST_RADIUS_M),
    };
    let alternatives = [least_m, most_m].map(|m| m.clamp(0.0, LARGEST_RADIUS_M.max(stated_m)));
    let far = |a: &UnmeasuredRadius, b: &UnmeasuredRadius| a.shift_m.total_cmp(&b.shift_m);
    alternatives.iter().filter_map(|radius_m| alternative(measured, found, stated_m, *radius_m)).max_by(far)
}

/// The calibration with this mean radius, beside the one with the stated radius.
fn alternative(measured: &Measurements, found: &Calibration, stated_m: f64, radius_m: f64) -> Option<UnmeasuredRadius> {
    let n = measured.cable_count;
    let change_m = radius_m - stated_m;
    if change_m == 0.0 {
        return None;
    }
    let with = |share: f64| {
        let stated = |i: usize| measured.pulley_radius_m.get(i).copied().unwrap_or(0.0);
        let pulley_radius_m = (0..n).map(|i| (stated(i) + share * change_m).max(0.0)).collect();
        let refuse_above_std_m = f64::MAX;
        calibrate(&Measurements { pulley_radius_m, refuse_above_std_m, ..measured.clone() }, found.method).ok()
    };
    // Lengths that are nearly those of a cable straight down may be too short for the whole wheel.
    let (share, other) = SHARES.iter().find_map(|share| Some((share, with(*share)?)))?;
    let shift = |a: &[f64; 3], b: &[f64; 3]| [0, 1, 2].map(|k| (a[k] - b[k]) / share);
    let shifts_m: Vec<[f64; 3]> = other.anchors_m.iter().zip(&found.anchors_m).map(|(a, b)| shift(a, b)).collect();
    let mut worst = UnmeasuredRadius { radius_m, change_m, anchor: 0, axis: 2, shift_m: 0.0, shifts_m };
    for i in 0..n {
        for k in 0..3 {
            let shift_m = worst.shifts_m[i][k].abs();
            if shift_m > worst.shift_m {
                (worst.anchor, worst.axis, worst.shift_m) = (i, k, shift_m);
            }
        }
    }
    Some(worst)
}

impl Calibration {
    /// The same calibration, as uncertain as an alternative makes it: the 95 % interval of every coordinate reaches the
    /// alternative.
    #[must_use]
    pub fn widened_to(mut self, other: &UnmeasuredRadius) -> Self {
        let standard_m: Vec<f64> = other.shifts_m.iter().flatten().map(|m| m / HALF_WIDTH_95).collect();
        self.covariance = self.covariance.with_shift(&standard_m);
        let standard = |anchor: &[f64; 3]| anchor.map(|m| m / HALF_WIDTH_95);
        let anchors_m: Vec<_> = other.shifts_m.iter().map(standard).collect();
        let radius_m = other.change_m / HALF_WIDTH_95;
        self.lengths = self.lengths.map(|lengths| lengths.with_shift(&anchors_m, radius_m));
        self
    }
}
