//! How well points that took no part in a calibration are predicted: what a small residual does not show.
//! Lengths in m, one set of N per point of the plane; everything that comes out in m.
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
//! // Without any error what was left out is predicted to rounding.
//! let exact = hold_out(&measured, Method::Survey)?.expect("five points are enough");
//! assert!(exact.folds == 5 && exact.rms_m < 1e-9 && exact.position_rms_m < 1e-6);
//! // A line whose zero is 5 cm off: seen here, when points are predicted that took no part.
//! let mut wrong = measured;
//! wrong.lengths_m.iter_mut().for_each(|point| *point = CableVec::from_fn(3, |i| point[i] + [0.05, 0.0, 0.0][i]));
//! assert!(hold_out(&wrong, Method::Survey)?.expect("five points").position_rms_m > 100.0 * exact.position_rms_m);
//! # Ok::<(), calibration::CalibrationError>(())
//! ```

use nalgebra::Vector3;

use super::heights::{Frame, point_in_plane};
use super::{Calibration, CalibrationError, Measurements, Method, calibrate};
use cable_robot::{Anchors, CableVec, kinematics};

/// Most calibrations of one check. Up to so many points each is left out alone; of more, groups.
const MAX_FOLDS: usize = 20;

/// Points that took no part, predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Holdout {
    /// Root mean square of measured less predicted length, m, the x and y of each point fitted to its lengths. Compare
    /// with [`Calibration::rms_residual_m`].
    pub rms_m: f64,
    /// Root mean square of the height at which forward kinematics finds these points, which is 0 on the plane, m; for
    /// the GPS method the distance from the known position.
    pub position_rms_m: f64,
    /// How many calibrations were made.
    pub folds: usize,
}

/// Calibrates without each point (of more than 20: each of 20 groups) and predicts it. None where there are too few
/// points to leave any out.
///
/// # Errors
/// What [`calibrate`] refuses with all points. A group without which the rest determines nothing is passed over.
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
            let Some((sum, off)) = predict(&found, &measured.lengths_m[j], known) else { continue };
            squares += sum;
            lengths += found.anchors_m.len();
            heights += off;
            points += 1;
        }
    }
    // One calibration in a few says little, and says it badly.
    if points < 2 || folds * 2 < groups {
        return Ok(None);
    }
    Ok(Some(Holdout {
        rms_m: (squares / lengths as f64).sqrt(),
        position_rms_m: (heights / points as f64).sqrt(),
        folds,
    }))
}

/// Sum of squared length residuals and squared miss of the position of one point.
fn predict(found: &Calibration, measured: &CableVec, known: Option<[f64; 3]>) -> Option<(f64, f64)> {
    let corrected = measured.zip_map(&found.offsets_m, |l, o| (l - o) / found.scale);
    let anchors = Anchors::new(&found.anchors_m).ok()?;
    let expected = match known {
        Some(p) => Vector3::from(p),
        None => {
            let xy: Vec<_> = found.anchors_m.iter().map(|a| [a[0], a[1]]).collect();
            let w: Vec<_> = found.anchors_m.iter().map(|a| a[2] * a[2]).collect();
            let start = Frame::new(&xy).point(&corrected, &w);
            let [x, y] = point_in_plane(&found.anchors_m, &corrected, start);
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
