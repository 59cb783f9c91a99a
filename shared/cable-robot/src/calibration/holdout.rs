//! How well points that took no part in a calibration are predicted: what a small residual does not show.

use nalgebra::Vector3;

use super::heights::{Frame, point_in_plane};
use super::{Calibration, CalibrationError, Measurements, Method, calibrate};
use crate::{Anchors, CableVec, kinematics};

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
