//! Mathematics without a running robot: `ik`, `fk`, `tension`.

use crate::cli::{Method, Numbers, Point, Tension};
use crate::failure::{Answer, Failure};
use cable_robot::{Distribution, Robot, Vector3, kinematics, tension};
use serde_json::{Value, json};
use service::config::RobotFile;
use std::path::Path;

fn robot(path: &Path) -> Answer<Robot> {
    RobotFile::load(path).map_err(Failure::bad)?.robot().map_err(Failure::bad)
}

/// `nims ik`: straight lengths from the anchors, (6).
///
/// # Errors
/// A robot file that cannot be used.
pub fn ik(config: &Path, at: Point) -> Answer<Value> {
    let robot = robot(config)?;
    let lengths = kinematics::inverse_kinematics(robot.anchors(), &Vector3::from(at.0));
    Ok(json!({ "lengths_m": lengths.to_vec() }))
}

/// `nims fk`: the position with these straight lengths; of two mirrored ones the lower.
///
/// # Errors
/// A robot file that cannot be used, or lengths that no position has.
pub fn fk(config: &Path, lengths: &Numbers) -> Answer<Value> {
    let robot = robot(config)?;
    let found = kinematics::forward_kinematics(robot.anchors(), &lengths.0, None).map_err(Failure::bad)?;
    let position: [f64; 3] = found.position.into();
    Ok(json!({ "position_m": position, "residual_m": found.residual_rms_m }))
}

/// `nims tension`: tensions within the limits, or why there are none.
///
/// # Errors
/// A robot file, pose or method that cannot be used.
pub fn tensions(asked: &Tension) -> Answer<Value> {
    let robot = robot(&asked.config)?;
    let method = match (asked.method, robot.cable_count()) {
        (None, 3) => Method::Unique,
        (None, _) => Method::LeastNorm,
        (Some(method), _) => method,
    };
    let distribution = match method {
        Method::Unique => Distribution::Unique,
        Method::LeastNorm => Distribution::LeastNorm,
        Method::MinSum => Distribution::MinSum,
        Method::Safest => Distribution::Safest,
    };
    let (at, acceleration) = (Vector3::from(asked.at.0), Vector3::from(asked.accel.0));
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
