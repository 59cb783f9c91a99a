//! Readings are drawn where they were taken, and only those.
#![allow(clippy::unwrap_used)]

use cable_robot::{Robot, RobotParts};
use messages::ros::{CLOUD_POINT_BYTES, CLOUD_POINTS};
use messages::{Message, NodeEstimate, Reading};
use visualization::Visualization;

/// Values of the points of a cloud.
fn values(body: &[u8]) -> Vec<f32> {
    // The points end before the last byte; those that are not used are not numbers.
    let begin = body.len() - 1 - CLOUD_POINTS * CLOUD_POINT_BYTES;
    let points = body[begin..body.len() - 1].chunks_exact(CLOUD_POINT_BYTES);
    let value = |point: &[u8]| f32::from_le_bytes(point[12..16].try_into().unwrap());
    points.map(value).filter(|value| value.is_finite()).collect()
}

#[test]
fn a_value_that_is_stale_or_invalid_is_no_point() {
    let robot = Robot::new(RobotParts {
        anchors_m: vec![[0.0, 0.0, 4.0], [8.0, 0.0, 4.0], [4.0, 7.0, 4.0]],
        node_mass_kg: 1.0,
        tension_limits_n: [2.0, 200.0],
        speed_limit_m_s: 0.5,
        acceleration_limit_m_s2: 0.5,
        ..RobotParts::default()
    });
    let mut visualization = Visualization::new(&robot.unwrap(), 0);
    let estimate = NodeEstimate { position_m: [4.0, 2.0, 1.0], valid: 1, ..NodeEstimate::default() };
    visualization.record("node/estimate/a", NodeEstimate::type_name(), bytemuck::bytes_of(&estimate));
    let qualities = [
        Reading::QUALITY_GOOD,
        Reading::QUALITY_STALE,
        Reading::QUALITY_INVALID,
        Reading::QUALITY_DOUBTFUL,
        Reading::QUALITY_STALE,
    ];
    for (at, quality) in qualities.into_iter().enumerate() {
        let mut reading = Reading { count: 1, quality, ..Reading::default() };
        reading.value[0] = at as f64;
        visualization.record("sensor/probe", Reading::type_name(), bytemuck::bytes_of(&reading));
    }
    // A device without a value of this quantity may have others.
    let mut reading = Reading { count: 2, ..Reading::default() };
    reading.value[..2].copy_from_slice(&[f64::NAN, 1.0]);
    visualization.record("sensor/probe", Reading::type_name(), bytemuck::bytes_of(&reading));
    let drawings = visualization.slow_frame();
    let cloud = drawings.iter().find(|drawing| drawing.channel == "visualization/samples/sensor-probe").unwrap();
    assert_eq!(values(&cloud.body), [0.0, 3.0]);
}
