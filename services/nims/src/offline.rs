//! Mathematics without a running robot: `ik`, `fk`, `tension`.

use crate::cli::{Numbers, Tension};
use crate::failure::{Answer, Failure};
use crate::{plan, points};
use cable_robot::{Robot, Vector3, kinematics, tension};
use config::{Point, RobotFile};
use serde_json::{Value, json};
use std::path::Path;

/// The robot of a file. [`RobotFile::load`] refuses anchors that determine no position.
fn robot(path: &Path) -> Answer<Robot> {
    RobotFile::load(path).map_err(Failure::bad)?.robot().map_err(Failure::bad)
}

/// `nims ik`: straight lengths from the anchors, (6).
///
/// # Errors
/// A robot file or a point that cannot be used.
pub fn ik(config: &Path, at: &Point) -> Answer<Value> {
    let robot = robot(config)?;
    let lengths = kinematics::inverse_kinematics(robot.anchors(), &points::position(&robot, at)?.into());
    Ok(json!({ "lengths_m": lengths.to_vec() }))
}

/// `nims fk`: the position with these straight lengths; of two mirrored ones the lower.
///
/// # Errors
/// A robot file that cannot be used, or lengths that no position has.
pub fn fk(config: &Path, lengths: &Numbers) -> Answer<Value> {
    let robot = robot(config)?;
    let found = kinematics::forward_kinematics(robot.anchors(), &lengths.0, None).map_err(Failure::bad)?;
    let position = points::written(&robot, &found.position);
    Ok(json!({ "position_m": position, "residual_m": found.residual_rms_m }))
}

/// `nims tension`: tensions within the limits, or why there are none.
///
/// # Errors
/// A robot file, pose or method that cannot be used.
pub fn tensions(asked: &Tension) -> Answer<Value> {
    let robot = robot(&asked.config)?;
    let distribution = plan::distribution(asked.method, &robot);
    let at = Vector3::from(points::position(&robot, &asked.at)?);
    let acceleration = match &asked.accel {
        Some(acceleration) => points::position(&robot, acceleration)?.into(),
        None => Vector3::zeros(),
    };
    match tension::at(&robot, &at, &acceleration, distribution) {
        Ok(found) => Ok(json!({
            "feasible": true,
            "tensions_n": found.tensions_n.to_vec(),
            "sum_n": found.tensions_n.iter().sum::<f64>(),
            "norm_sq_n2": found.tensions_n.iter().map(|value| value * value).sum::<f64>(),
        })),
        Err(why @ (tension::TensionError::Infeasible(_) | tension::TensionError::Singular)) => {
            Ok(json!({ "feasible": false, "why": why.to_string() }))
        }
        Err(error) => Err(Failure::bad(error)),
    }
}
