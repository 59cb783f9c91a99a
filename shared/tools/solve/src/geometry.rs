//! Cable lengths, positions and velocities.

use super::args::{Args, Points, invalid_value};
use super::error::{OperationResult, SolveError};
use cable_robot::anchors::on_a_line;
use cable_robot::pulley::Pulley;
use cable_robot::tension::general::GeneralStructure;
use cable_robot::{Anchors, KinematicsError, Vector3, kinematics, planar};
use serde_json::{Value, json};

/// Minimum distance of two anchors, m, as in the robot file.
const COINCIDENT_M: f64 = 1e-3;

/// Formats a point in its dimension.
pub fn point_json(point: &Vector3<f64>, planar: bool) -> Value {
    if planar { json!([point.x, point.z]) } else { json!([point.x, point.y, point.z]) }
}

fn singular(at: &Vector3<f64>) -> SolveError {
    KinematicsError::Singular { x: at.x, y: at.y, z: at.z }.into()
}

/// Returns the unit vectors of the free cables toward a position: the rows of J.
pub fn directions(anchors: &Points, at: &Vector3<f64>) -> Result<Vec<Vector3<f64>>, SolveError> {
    let row = |(cable, pulley): (usize, Pulley)| {
        pulley.direction(at).map_err(|why| KinematicsError::without_direction(why, cable, &pulley, at).into())
    };
    anchors.pulleys().enumerate().map(row).collect()
}

/// Returns the structure matrix -Jᵀ from the rows of J.
pub fn structure(rows: &[Vector3<f64>], planar: bool) -> Result<GeneralStructure, SolveError> {
    let axis = |k: usize| rows.iter().map(|row| -row[k]).collect();
    Ok(GeneralStructure::new(&if planar { vec![axis(0), axis(2)] } else { vec![axis(0), axis(1), axis(2)] })?)
}

/// Returns the rows of B, one per dimension.
fn node_jacobian(rows: &[Vector3<f64>], planar: bool, at: &Vector3<f64>) -> Result<Vec<Vec<f64>>, SolveError> {
    // Λ = -Jᵀ, so the pseudo-inverse of J is the negative transpose of that of Λ.
    let structure = structure(rows, planar)?;
    let inverse = structure.pseudo_inverse().map_err(|_| singular(at))?;
    Ok((0..structure.rows()).map(|r| inverse[..rows.len()].iter().map(|row| -row[r]).collect()).collect())
}

/// Cable lengths of a position, (6).
pub fn inverse_kinematics(args: &Args) -> OperationResult {
    let anchors = args.anchors()?;
    let at = args.vector("position_m", anchors.planar)?;
    if !anchors.planar && on_a_line(&anchors.points) {
        return Err(KinematicsError::DegenerateGeometry.into());
    }
    if anchors.have_pulleys() {
        directions(&anchors, &at)?;
    }
    let lengths: Vec<f64> = anchors.pulleys().map(|pulley| pulley.length_m(&at)).collect();
    Ok(json!({ "lengths_m": lengths }))
}

/// Position from cable lengths, (7)-(12), in any frame.
pub fn forward_kinematics(args: &Args) -> OperationResult {
    let anchors = args.anchors()?;
    let lengths = args.per_cable("lengths_m", anchors.points.len())?;
    if let Some(length) = lengths.iter().find(|l| !(0.0..=kinematics::LONGEST_M).contains(*l)) {
        return Err(invalid_value("lengths_m", &length.to_string(), "lengths of 0 m to 1e5 m"));
    }
    let near = args.get("near_m").map(|_| args.vector("near_m", anchors.planar)).transpose()?;
    for (i, a) in anchors.points.iter().enumerate() {
        if anchors.points[..i].iter().any(|b| (a - b).norm() < COINCIDENT_M) {
            return Err(KinematicsError::DegenerateGeometry.into());
        }
    }
    let found = if anchors.have_pulleys() {
        let checked = anchors.checked()?;
        let found = kinematics::forward_kinematics(&checked, &lengths, near.as_ref())?;
        let mirror = found.mirror.or_else(|| kinematics::mirror_position(&checked, &lengths, &found.position));
        kinematics::Forward { mirror, ..found }
    } else if anchors.planar {
        planar::forward_kinematics(&anchors.points, &lengths, near.as_ref())?
    } else {
        let points: Vec<[f64; 3]> = anchors.points.iter().map(|p| (*p).into()).collect();
        let anchors = Anchors::new(&points).map_err(|error| SolveError::invalid(error.to_string()))?;
        kinematics::forward_kinematics(&anchors, &lengths, near.as_ref())?
    };
    let mut result = json!({ "position_m": point_json(&found.position, anchors.planar) });
    match found.mirror {
        Some(mirror) => result["mirror_m"] = point_json(&mirror, anchors.planar),
        // Only with pulleys the other position may not exist.
        None if anchors.are_minimal() => result["mirror_m"] = Value::Null,
        None => result["residual_rms_m"] = json!(found.residual_rms_m),
    }
    Ok(result)
}

/// Jacobian, (13)-(14), and its (pseudo-)inverse.
pub fn jacobian(args: &Args) -> OperationResult {
    let anchors = args.anchors()?;
    let at = args.vector("position_m", anchors.planar)?;
    let rows = directions(&anchors, &at)?;
    let jacobian: Vec<Value> = rows.iter().map(|row| point_json(row, anchors.planar)).collect();
    Ok(json!({ "cable_jacobian": jacobian, "node_jacobian": node_jacobian(&rows, anchors.planar, &at)? }))
}

/// Cable velocities of a node velocity, (14).
pub fn cable_velocity(args: &Args) -> OperationResult {
    let anchors = args.anchors()?;
    let at = args.vector("position_m", anchors.planar)?;
    let velocity = args.vector("velocity_m_s", anchors.planar)?;
    let rows = directions(&anchors, &at)?;
    let cables: Vec<f64> = rows.iter().map(|row| row.dot(&velocity)).collect();
    Ok(json!({ "cable_velocity_m_s": cables }))
}

/// Node velocity of cable velocities, the inverse of (14).
pub fn node_velocity(args: &Args) -> OperationResult {
    let anchors = args.anchors()?;
    let at = args.vector("position_m", anchors.planar)?;
    let cables = args.per_cable("cable_velocity_m_s", anchors.points.len())?;
    let inverse = node_jacobian(&directions(&anchors, &at)?, anchors.planar, &at)?;
    let velocity: Vec<f64> = inverse.iter().map(|row| row.iter().zip(&cables).map(|(b, v)| b * v).sum()).collect();
    Ok(json!({ "velocity_m_s": velocity }))
}
