//! Configurations that replace those of the paper, whose tables are not available.

use cable_robot::motor::Motor;
use cable_robot::{Anchors, Robot, RobotParts, Vector3};

/// Gravity in these computations, m/s².
pub const GRAVITY: f64 = 9.81;
/// Mass of the node, kg.
pub const MASS_KG: f64 = 2.0;
/// Speed of the node, m/s.
pub const SPEED_M_S: f64 = 0.2;
/// Least and largest tension, N.
pub const LIMITS_N: [f64; 2] = [1.0, 150.0];

/// D1 = P1P3, D2 = P1P2, D3 = P2P3 of the three-cable configuration, m.
pub const RANGES_M: [f64; 3] = [9.1, 9.8, 9.4];
/// Heights of its anchors, m.
pub const HEIGHTS_M: [f64; 3] = [3.20, 3.45, 3.05];

/// Description of the three-cable configuration.
pub const THREE: &str = "three anchors with plumb lines 9.1, 9.8 and 9.4 m apart at heights of 3.20, 3.45 and 3.05 m";
/// Description of the four-cable configuration.
pub const FOUR: &str =
    "four anchors on a square of 10 m at a height of 6 m, a node of 2 kg at 0.2 m/s, tensions of 1 to 150 N";

/// Returns the anchors of the three-cable configuration, (1)-(2), m.
pub fn three_cable_anchors() -> [[f64; 3]; 3] {
    let [d1, d2, d3] = RANGES_M;
    let x3 = (d1 * d1 + d2 * d2 - d3 * d3) / (2.0 * d2);
    let y3 = (d1 * d1 - x3 * x3).sqrt();
    [[0.0, 0.0, HEIGHTS_M[0]], [d2, 0.0, HEIGHTS_M[1]], [x3, y3, HEIGHTS_M[2]]]
}

/// Returns x and y of these anchors, m.
pub fn three_cable_anchors_xy() -> [[f64; 2]; 3] {
    three_cable_anchors().map(|[x, y, _]| [x, y])
}

/// Anchors of the four-cable configuration, m.
pub const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 10.0, 6.0], [0.0, 10.0, 6.0]];
/// Four asymmetric anchors, as in an installation in a wood, m.
pub const UNEVEN: [[f64; 3]; 4] = [[0.0, 0.0, 6.0], [10.4, 0.3, 6.3], [9.7, 8.9, 5.8], [-0.5, 9.4, 6.1]];
/// Corners of the mapped square under the four anchors, m.
pub const SQUARE_PATH: [[f64; 3]; 4] = [[2.5, 2.5, 4.0], [7.5, 2.5, 4.0], [7.5, 7.5, 4.0], [2.5, 7.5, 4.0]];
/// Corners of the mapped triangle under the three anchors, in the upper region, m.
pub const TRIANGLE_PATH: [[f64; 3]; 3] = [[3.30, 1.60, 2.45], [6.60, 1.90, 2.35], [4.90, 4.60, 2.30]];

/// Returns an actuator whose current is proportional to tension.
pub fn ideal() -> Motor {
    Motor::ideal(40.0, 1.2)
}

/// Returns a geared actuator with friction, nearly self-locking.
pub fn geared() -> Motor {
    Motor::default()
}

/// Returns the wrench m g, N.
pub fn weight() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, MASS_KG * GRAVITY)
}

/// Converts anchors for the library; those above are valid.
pub fn anchors(points: &[[f64; 3]]) -> Result<Anchors, cable_robot::RobotError> {
    Anchors::new(points)
}

/// Returns the three-cable robot as described by a robot file.
pub fn three_cable_robot() -> Result<Robot, cable_robot::RobotError> {
    Robot::new(RobotParts {
        anchors_m: three_cable_anchors().to_vec(),
        node_mass_kg: MASS_KG,
        tension_limits_n: LIMITS_N,
        speed_limit_m_s: 0.5,
        acceleration_limit_m_s2: 0.5,
        stiffness_n: Some(6000.0),
        routed_length_m: Some(vec![6.0; 3]),
        ..RobotParts::default()
    })
}
