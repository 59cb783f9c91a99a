//! Kinematics and statics without a running robot: `ik`, `fk`, `tension`.

use crate::plan::Method;
use crate::{config_kind, plan, readable};
use cable_robot::{Vector3, kinematics, tension};
use command::values::{Numbers, numbers, point};
use command::{Answer, Failure, Output, points};
use config::Point;
use serde_json::json;
use std::path::PathBuf;

/// `nims ik`.
#[derive(Debug, clap::Args)]
pub struct IkArgs {
    /// Robot file or system file.
    #[arg(long, visible_aliases = ["robot", "system"])]
    pub config: PathBuf,
    /// Position of the node, m.
    #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub at: Point,
}

/// `nims fk`.
#[derive(Debug, clap::Args)]
pub struct FkArgs {
    /// Robot file or system file.
    #[arg(long, visible_aliases = ["robot", "system"])]
    pub config: PathBuf,
    /// One length per cable, m.
    #[arg(long, value_name = "A,B,..", value_parser = numbers, allow_hyphen_values = true)]
    pub lengths: Numbers,
}

/// `nims tension`.
#[derive(Debug, clap::Args)]
pub struct TensionArgs {
    /// Robot file or system file.
    #[arg(long, visible_aliases = ["robot", "system"])]
    pub config: PathBuf,
    /// Position of the node, m.
    #[arg(long, value_name = "X,Y,Z|X,Z", value_parser = point, allow_hyphen_values = true)]
    pub at: Point,
    /// Acceleration of the node, m/s²; default: zero.
    #[arg(long, value_name = "AX,AY,AZ|AX,AZ", value_parser = point, allow_hyphen_values = true)]
    pub accel: Option<Point>,
    /// Tension distribution; default: unique for as many cables as degrees of freedom, least-norm for more.
    #[arg(long, value_enum)]
    pub method: Option<Method>,
}

/// `nims ik`: lengths from the anchors, (6), with the part on the pulleys if there are any.
///
/// # Errors
/// A robot file or a point that cannot be used.
pub fn ik(args: &IkArgs) -> Answer<Output> {
    let robot = config_kind::robot(&args.config)?;
    let at = points::position(&robot, &args.at)?.into();
    let lengths = kinematics::lengths_at(robot.anchors(), &at).map_err(Failure::bad)?;
    let found = json!({ "lengths_m": lengths.to_vec() });
    let words = readable::lengths(&found);
    Ok(Output::new(found, words))
}

/// `nims fk`: the position that matches these lengths; of two mirrored solutions, the lower one.
///
/// # Errors
/// A robot file that cannot be used, or lengths that match no position.
pub fn fk(args: &FkArgs) -> Answer<Output> {
    let robot = config_kind::robot(&args.config)?;
    let found = kinematics::forward_kinematics(robot.anchors(), &args.lengths.0, None).map_err(Failure::bad)?;
    let position = points::written(&robot, &found.position);
    let found = json!({ "position_m": position, "residual_m": found.residual_rms_m });
    let words = readable::position(&found);
    Ok(Output::new(found, words))
}

/// `nims tension`: tensions within the limits, or why they do not exist.
///
/// # Errors
/// A robot file, pose or method that cannot be used.
pub fn tension(args: &TensionArgs) -> Answer<Output> {
    let robot = config_kind::robot(&args.config)?;
    let distribution = plan::distribution(args.method, &robot);
    let at = Vector3::from(points::position(&robot, &args.at)?);
    let acceleration = match &args.accel {
        Some(acceleration) => points::position(&robot, acceleration)?.into(),
        None => Vector3::zeros(),
    };
    let found = match tension::at(&robot, &at, &acceleration, distribution) {
        Ok(found) => json!({
            "feasible": true,
            "tensions_n": found.tensions_n.to_vec(),
            "sum_n": found.tensions_n.iter().sum::<f64>(),
            "norm_sq_n2": found.tensions_n.iter().map(|value| value * value).sum::<f64>(),
        }),
        Err(why @ (tension::TensionError::Infeasible(_) | tension::TensionError::Singular)) => {
            json!({ "feasible": false, "why": why.to_string() })
        }
        Err(error) => return Err(Failure::bad(error)),
    };
    let words = readable::tensions(&found, robot.tension_limits_n());
    Ok(Output::new(found, words))
}
