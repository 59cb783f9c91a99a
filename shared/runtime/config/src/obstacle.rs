//! `[[obstacle]]`: bodies that neither the node nor a cable may touch.

use cable_robot::{Obstacle, RobotError};
use serde::Deserialize;

/// `[[obstacle]]`: an upright cylinder, with `center_m` and `radius_m`, or an upright prism, with `corners_m`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObstacleSection {
    /// x and y of the axis of a cylinder, m.
    #[serde(default, deserialize_with = "crate::exactly_if_given")]
    pub center_m: Option<[f64; 2]>,
    /// Radius of a cylinder, m.
    pub radius_m: Option<f64>,
    /// x and y of the corners of a prism in their order around it, 3 to 6, m; two are opposite corners of a rectangle
    /// along the axes.
    #[serde(default, deserialize_with = "crate::each_exactly")]
    pub corners_m: Vec<[f64; 2]>,
    /// Height of its bottom and of its top, m.
    #[serde(deserialize_with = "crate::exactly")]
    pub height_m: [f64; 2],
}

impl ObstacleSection {
    /// Creates the section of a cylinder.
    #[must_use]
    pub fn cylinder(center_m: [f64; 2], radius_m: f64, height_m: [f64; 2]) -> Self {
        Self { center_m: Some(center_m), radius_m: Some(radius_m), corners_m: Vec::new(), height_m }
    }

    /// Creates the obstacle.
    ///
    /// # Errors
    /// Keys of both shapes or of none, or values that make no body.
    pub fn obstacle(&self) -> Result<Obstacle, RobotError> {
        match (self.center_m, self.radius_m, &self.corners_m[..]) {
            (Some(center_m), Some(radius_m), []) => Obstacle::cylinder(center_m, radius_m, self.height_m),
            (None, None, [[x0, y0], [x1, y1]]) => {
                Obstacle::prism(&[[*x0, *y0], [*x1, *y0], [*x1, *y1], [*x0, *y1]], self.height_m)
            }
            (None, None, [_, ..]) => Obstacle::prism(&self.corners_m, self.height_m),
            _ => Err(RobotError {
                key: "obstacle",
                problem: "has not the keys of one shape".to_owned(),
                accepted: "center_m and radius_m for a cylinder, or corners_m for a prism",
            }),
        }
    }
}
