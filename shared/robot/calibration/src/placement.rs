//! Positions of the points, and the accuracy to expect from them.
//!
//! Points near the corners of the polygon of the anchors determine the heights two to three times better than as many
//! points all over it: three at the corners are equivalent to about twenty at random.
//!
//! Anchors and points as [x, y] in m, predicted standard deviations in m.

use super::{AnchorCovariance, CalibrationError, Measurements, Method, calibrate};
use cable_robot::pulley::Pulley;
use cable_robot::{CableVec, Vector3};

/// Returns `count` points near the corners of the polygon of the anchors: every corner in turn, moved towards the mean
/// of the anchors to `reach` of its distance (0.9 keeps every cable taut), later rounds a little nearer. x and y, m.
///
/// ```
/// use calibration::placement::corners;
/// let points = corners(&[[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]], 3, 0.9);
/// assert!((points[1][0] - 8.4).abs() < 1e-12 && (points[1][1] - 0.3).abs() < 1e-12);
/// ```
pub fn corners(anchors_xy_m: &[[f64; 2]], count: usize, reach: f64) -> Vec<[f64; 2]> {
    let n = anchors_xy_m.len();
    let mean = anchors_xy_m.iter().fold([0.0; 2], |s, a| [s[0] + a[0] / n as f64, s[1] + a[1] / n as f64]);
    (0..count)
        .map(|k| {
            let round = k / n;
            // A different position each round, so that a bump of the floor does not affect all of them.
            let share = reach * (1.0 - 0.05 * (round % 4) as f64);
            let a = anchors_xy_m[k % n];
            [mean[0] + share * (a[0] - mean[0]), mean[1] + share * (a[1] - mean[1])]
        })
        .collect()
}

/// Predicts the covariance for points at these positions and roughly known anchors, by a calibration of exact
/// measurements with the stated standard deviations. Lengths and direct heights in `plan` are replaced; of its ranges
/// only the anchors and standard deviations are used.
///
/// # Errors
/// The errors of [`calibrate`]: then these points are not sufficient.
pub fn predict(
    anchors_m: &[[f64; 3]],
    points_xy_m: &[[f64; 2]],
    plan: &Measurements,
    method: Method,
) -> Result<AnchorCovariance, CalibrationError> {
    let mut measured = plan.clone();
    for r in &mut measured.ranges {
        let (Some(a), Some(b)) = (anchors_m.get(r.from), anchors_m.get(r.to)) else { continue };
        let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
        r.m = (dx * dx + dy * dy).sqrt();
    }
    for h in &mut measured.heights {
        if let Some(a) = anchors_m.get(h.anchor) {
            let wheel_m = plan.pulley_radius_m.get(h.anchor).map_or(0.0, |r| std::f64::consts::PI * r);
            h.m = a[2] + if h.by_line { wheel_m } else { 0.0 };
        }
    }
    measured.lengths_m = points_xy_m
        .iter()
        .map(|c| {
            CableVec::from_fn(anchors_m.len(), |i| {
                let [x, y, z] = anchors_m[i];
                let (dx, dy) = (x - c[0], y - c[1]);
                if let Some(radius_m) = plan.pulley_radius_m.get(i).copied().filter(|r| *r > 0.0) {
                    let pulley = Pulley::new(Vector3::new(x, y, z), radius_m);
                    return pulley.length_m(&Vector3::new(c[0], c[1], 0.0));
                }
                (dx * dx + dy * dy + z * z).sqrt()
            })
        })
        .collect();
    measured.gps_m = points_xy_m.iter().map(|c| [c[0], c[1], 0.0]).collect();
    calibrate(&measured, method).map(|found| found.covariance)
}
