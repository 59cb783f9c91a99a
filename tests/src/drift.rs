//! How far a node drifts while it swings on its cables.

use anyhow::{Result, ensure};
use cable_robot::{CableVec, Robot, Vector3, elastic};

/// Samples in a second of the virtual motor box.
const SECOND: usize = 100;

/// Distance of the node from its mean position over the first second to that over the last one, m, by its true lengths,
/// m, a hundred samples a second. The positions are those of rest: after a stop the node swings about them by some
/// millimetres at 2 to 4 Hz, and a mean over a second keeps half a millimetre of that, by where in the swing it begins.
///
/// # Errors
/// Less than two seconds, or lengths that fit no position.
pub fn drift_m(robot: &Robot, lengths: &[CableVec]) -> Result<f64> {
    ensure!(lengths.len() >= 2 * SECOND, "{} samples are less than two seconds", lengths.len());
    let mean = |some: &[CableVec]| -> Result<Vector3<f64>> {
        let mut sum = Vector3::zeros();
        for lengths_m in some {
            sum += elastic::equilibrium(robot, lengths_m, &Vector3::zeros(), None)?.position;
        }
        Ok(sum / some.len() as f64)
    };
    Ok((mean(&lengths[lengths.len() - SECOND..])? - mean(&lengths[..SECOND])?).norm())
}
