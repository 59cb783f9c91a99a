//! Prediction of points that a calibration did not use: reveals errors that small residuals hide. Lengths in m, one set
//! of N per point of the plane; all results in m.
//!
//! ```
//! use cable_robot::CableVec;
//! use calibration::{Measurements, Method, Range, hold_out};
//! let anchors = [[0.0, 0.0, 3.0], [10.0, 0.0, 3.2], [5.0, 8.0, 2.9f64]];
//! let range = |i: usize, j: usize| {
//!     let (dx, dy) = (anchors[i][0] - anchors[j][0], anchors[i][1] - anchors[j][1]);
//!     Range { from: i, to: j, m: dx.hypot(dy), sigma_m: 0.002 }
//! };
//! let lengths = |[x, y]: [f64; 2]| {
//!     CableVec::from_fn(3, |i| (anchors[i][0] - x).hypot(anchors[i][1] - y).hypot(anchors[i][2]))
//! };
//! let measured = Measurements {
//!     ranges: vec![range(0, 1), range(0, 2), range(1, 2)],
//!     lengths_m: [[1.0, 0.5], [9.0, 0.5], [5.0, 7.0], [5.0, 3.0], [2.0, 2.0]].map(lengths).to_vec(),
//!     ..Measurements::new(3)
//! };
//! // Without measurement errors, excluded points are predicted up to rounding.
//! let exact = hold_out(&measured, Method::Survey)?.expect("five points are enough");
//! assert!(exact.folds == 5 && exact.rms_m < 1e-9 && exact.position_rms_m < 1e-6);
//! // A cable whose zero is wrong by 5 cm: the prediction of excluded points reveals it.
//! let mut wrong = measured;
//! wrong.lengths_m.iter_mut().for_each(|point| *point = CableVec::from_fn(3, |i| point[i] + [0.05, 0.0, 0.0][i]));
//! assert!(hold_out(&wrong, Method::Survey)?.expect("five points").position_rms_m > 100.0 * exact.position_rms_m);
//! # Ok::<(), calibration::CalibrationError>(())
//! ```

use nalgebra::Vector3;

use super::heights::{Frame, point_in_plane};
use super::straight;
use super::{Calibration, CalibrationError, Measurements, Method, calibrate};
use cable_robot::{Anchors, CableVec, kinematics};

/// Largest number of calibrations of one check. Up to this number of points, each is excluded alone;
/// otherwise in groups.
const MAX_FOLDS: usize = 20;

/// Prediction errors of excluded points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Holdout {
    /// Root mean square of measured minus predicted length, m, where the x and y of each point are fitted to its
    /// lengths. Compare with [`Calibration::rms_residual_m`].
    pub rms_m: f64,
    /// Root mean square of the height of these points by forward kinematics, which is 0 on the plane, m; for the GPS
    /// method, of the distance from the known position.
    pub position_rms_m: f64,
    /// Number of calibrations.
    pub folds: usize,
}

/// Calibrates without each point (for more than 20: without each of 20 groups) and predicts it. None if there are too
/// few points to exclude any.
///
/// # Errors
/// The errors of [`calibrate`] with all points. A group without which the rest determines nothing is skipped.
pub fn hold_out(measured: &Measurements, method: Method) -> Result<Option<Holdout>, CalibrationError> {
    calibrate(measured, method)?;
    let m = measured.lengths_m.len();
    let groups = m.min(MAX_FOLDS);
    let (mut squares, mut lengths, mut heights, mut points, mut folds) = (0.0, 0usize, 0.0, 0usize, 0);
    for g in 0..groups {
        let keep = |j: &usize| j % groups != g;
        let rest = Measurements {
            lengths_m: (0..m).filter(keep).map(|j| measured.lengths_m[j]).collect(),
            gps_m: (0..measured.gps_m.len()).filter(keep).map(|j| measured.gps_m[j]).collect(),
            ..measured.clone()
        };
        let Ok(found) = calibrate(&rest, method) else { continue };
        folds += 1;
        for j in (g..m).step_by(groups) {
            let known = (method == Method::Gps).then(|| measured.gps_m.get(j).copied()).flatten();
            let Some((sum, off)) = predict(&found, &measured.lengths_m[j], known) else {
                continue;
            };
            squares += sum;
            lengths += found.anchors_m.len();
            heights += off;
            points += 1;
        }
    }
    // With few successful calibrations the result is not reliable.
    if points < 2 || folds * 2 < groups {
        return Ok(None);
    }
    Ok(Some(Holdout {
        rms_m: (squares / lengths as f64).sqrt(),
        position_rms_m: (heights / points as f64).sqrt(),
        folds,
    }))
}

/// Sum of squared length residuals and squared position error of one point.
fn predict(found: &Calibration, measured: &CableVec, known: Option<[f64; 3]>) -> Option<(f64, f64)> {
    let radii_m = found.pulley_radius_m.as_slice();
    let corrected = measured.zip_map(&found.offsets_m, |l, o| (l - o) / found.scale);
    let mut anchors = Anchors::new(&found.anchors_m).ok()?;
    if !radii_m.is_empty() {
        anchors = anchors.with_pulleys(radii_m).ok()?;
    }
    let expected = match known {
        Some(p) => Vector3::from(p),
        None => {
            let xy: Vec<_> = found.anchors_m.iter().map(|a| [a[0], a[1]]).collect();
            let w: Vec<_> = found.anchors_m.iter().map(|a| a[2] * a[2]).collect();
            let mut straight = if anchors.have_pulleys() { straight::typical(&corrected, radii_m) } else { corrected };
            let start = Frame::new(&xy).point(&straight, &w);
            let [mut x, mut y] = point_in_plane(&found.anchors_m, &straight, start);
            // Each round is a hundred times closer.
            for _ in 0..if anchors.have_pulleys() { 5 } else { 0 } {
                straight = straight::at(&corrected, radii_m, &found.anchors_m, &[x, y, 0.0], 1.0);
                [x, y] = point_in_plane(&found.anchors_m, &straight, [x, y]);
            }
            Vector3::new(x, y, 0.0)
        }
    };
    let predicted = kinematics::inverse_kinematics(&anchors, &expected);
    let sum = corrected.iter().zip(predicted.iter()).map(|(l, p)| (l - p) * (l - p)).sum();
    let miss = match kinematics::forward_kinematics(&anchors, &corrected, Some(&expected)) {
        Ok(at) if known.is_some() => (at.position - expected).norm_squared(),
        Ok(at) => at.position.z * at.position.z,
        Err(_) => return None,
    };
    Some((sum, miss))
}
