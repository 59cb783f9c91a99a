//! Conversion of points between the user's form (two coordinates for a planar robot) and [x, y, z].

use crate::{Answer, Failure};
use cable_robot::{Robot, Vector3};
use config::Point;
use serde_json::{Value, json};

/// Returns the position [x, y, z] of a given point, m.
///
/// # Errors
/// The point has another number of coordinates than the robot needs.
pub fn position(robot: &Robot, point: &Point) -> Answer<[f64; 3]> {
    point.resolve(robot.is_planar()).map_err(Failure::BadInput)
}

/// Returns a position as JSON: [x, y, z], or [x, z] for a planar robot.
#[must_use]
pub fn written(robot: &Robot, at: &Vector3<f64>) -> Value {
    if robot.is_planar() { json!([at.x, at.z]) } else { json!([at.x, at.y, at.z]) }
}

/// Returns a position for a sentence: [x, y, z] m, or [x, z] m for a planar robot.
#[must_use]
pub fn in_words(robot: &Robot, at: &Vector3<f64>) -> String {
    let [x, y, z]: [f64; 3] = (*at).into();
    if robot.is_planar() { format!("[{x:.2}, {z:.2}] m") } else { format!("[{x:.2}, {y:.2}, {z:.2}] m") }
}
