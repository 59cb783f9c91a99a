//! The closed form and the joint estimate for cables over pulleys of known radius.

use super::error::CalibrationError;
use super::heights::{Heights, calibrate_heights};
use super::joint::{DirectHeight, Joint, JointInput, calibrate_joint};
use super::straight::{self, Geometry};
use cable_robot::CableVec;

fn in_plane(points_xy_m: &[[f64; 2]]) -> Vec<[f64; 3]> {
    points_xy_m.iter().map(|c| [c[0], c[1], 0.0]).collect()
}

/// As [`calibrate_joint`], with pulleys of these radii (m, one per anchor; 0 for an eye). Lengths, and heights that
/// were measured with the cable, include the part on the wheel.
///
/// # Errors
/// The errors of [`calibrate_joint`], and `invalid_argument` for radii that are not accepted.
///
/// ```
/// use cable_robot::{CableVec, Vector3, pulley::Pulley};
/// use calibration::{JointInput, calibrate_joint_with_pulleys};
/// let anchors = [[0.0, 0.0], [8.0, 0.0], [4.0, 6.0]];
/// let length = |a: &[f64; 2], c: [f64; 2]| {
///     let pulley = Pulley::new(Vector3::new(a[0], a[1], 3.0), 0.04);
///     pulley.length_m(&Vector3::new(c[0], c[1], 0.0))
/// };
/// let points = [[1.0, 1.0], [7.0, 1.0], [4.0, 5.0], [4.0, 3.0]];
/// let lengths = points.map(|c| CableVec::from_fn(3, |i| length(&anchors[i], c)));
/// let found = calibrate_joint_with_pulleys(&JointInput::new(&anchors, &lengths, 0.005), &[0.04; 3])?;
/// assert!(found.anchors_m.iter().all(|a| (a[2] - 3.0).abs() < 1e-6));
/// # Ok::<(), calibration::CalibrationError>(())
/// ```
pub fn calibrate_joint_with_pulleys(input: &JointInput, radii_m: &[f64]) -> Result<Joint, CalibrationError> {
    let cables = input.anchors_xy_m.len();
    straight::check_radii(cables, radii_m)?;
    // Also checks the input before its anchors and cables are used as indices.
    let eyes = calibrate_joint(input)?;
    if radii_m.iter().all(|r| *r == 0.0) {
        return Ok(eyes);
    }
    let estimate = |lengths_m: &[CableVec], heights: &[DirectHeight]| {
        calibrate_joint(&JointInput { lengths_m, heights, ..*input })
    };
    let geometry = |found: &Joint| Geometry {
        anchors_m: found.anchors_m.clone(),
        points_m: in_plane(&found.points_xy_m),
        scale: found.scale,
    };
    straight::settle(input.lengths_m, input.heights, radii_m, estimate, geometry)
}

/// As [`calibrate_heights`], with pulleys of these radii (m, one per anchor; 0 for an eye).
///
/// # Errors
/// The errors of [`calibrate_heights`], and `invalid_argument` for radii that are not accepted.
pub fn calibrate_heights_with_pulleys(
    anchors_xy_m: &[[f64; 2]],
    lengths_m: &[CableVec],
    radii_m: &[f64],
) -> Result<Heights, CalibrationError> {
    straight::check_radii(anchors_xy_m.len(), radii_m)?;
    let eyes = calibrate_heights(anchors_xy_m, lengths_m)?;
    if radii_m.iter().all(|r| *r == 0.0) {
        return Ok(eyes);
    }
    let estimate = |lengths_m: &[CableVec], _: &[DirectHeight]| calibrate_heights(anchors_xy_m, lengths_m);
    let geometry = |found: &Heights| Geometry {
        anchors_m: anchors_xy_m.iter().zip(found.heights_m.iter()).map(|(a, z)| [a[0], a[1], *z]).collect(),
        points_m: in_plane(&found.points_xy_m),
        scale: 1.0,
    };
    straight::settle(lengths_m, &[], radii_m, estimate, geometry)
}
