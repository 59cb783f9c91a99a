//! Points between people and a robot: three coordinates in space, two in a plane.

use crate::{Answer, Failure};
use cable_robot::{Robot, Vector3};
use config::Point;
use serde_json::{Value, json};

/// The position that was given, m.
///
/// # Errors
/// It is of the other kind than the robot.
pub fn position(robot: &Robot, point: &Point) -> Answer<[f64; 3]> {
    point.on(robot.is_planar()).map_err(Failure::BadInput)
}

/// A position as this robot's users write it: [x, y, z], or [x, z].
#[must_use]
pub fn written(robot: &Robot, at: &Vector3<f64>) -> Value {
    if robot.is_planar() { json!([at.x, at.z]) } else { json!([at.x, at.y, at.z]) }
}

/// The same in a sentence.
#[must_use]
pub fn in_words(robot: &Robot, at: &Vector3<f64>) -> String {
    let [x, y, z]: [f64; 3] = (*at).into();
    if robot.is_planar() { format!("[{x:.2}, {z:.2}] m") } else { format!("[{x:.2}, {y:.2}, {z:.2}] m") }
}
