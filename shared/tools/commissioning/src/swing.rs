//! Whether the node would swing on its cables: sentences of `nims check`.

use cable_robot::{Distribution, Modes, Robot, Vector3, tension};
use config::SystemFile;

/// Describes the modes of a node that hangs at a position. None for rigid cables, or if it cannot hang there.
pub(crate) fn modes(robot: &Robot, at: &Vector3<f64>, distribution: Distribution) -> Option<String> {
    let modes = modes_at(robot, at, distribution)?;
    let periods: Vec<String> = modes.iter().map(|mode| format!("{:.2}", mode.period_s())).collect();
    Some(format!("in the middle the node swings on its cables with periods of {} s", periods.join(", ")))
}

/// Returns a sentence and a cure if a pause at the robot's speed leaves the node swinging by more than the limit of the
/// planner.
pub(crate) fn pause(file: &SystemFile, robot: &Robot, at: &Vector3<f64>) -> Option<(String, String)> {
    let modes = modes_at(robot, at, file.controller.distribution_for(robot))?;
    let (ramp_s, speed_m_s) = (file.motor_io.ramp_s, robot.speed_limit_m_s());
    let swing_m = modes.iter().map(|mode| {
        // A constant deceleration of this length leaves |2 sin(omega ramp / 2)| of its displacement a / omega².
        let left = 2.0 * libm::sin(0.5 * mode.angular_rad_s * ramp_s).abs();
        (left * speed_m_s / ramp_s / (mode.angular_rad_s * mode.angular_rad_s), mode.period_s())
    });
    let (largest_m, period_s) = swing_m.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (largest_m > file.planner.swing_limit_m).then(|| {
        (
            format!(
                "a pause at {speed_m_s} m/s with ramp_s = {ramp_s} leaves the node swinging by up to {:.0} mm with a period of {period_s:.2} s",
                1000.0 * largest_m
            ),
            format!("set ramp_s = {period_s:.2} in [motor_io]: a ramp as long as the period leaves no swing"),
        )
    })
}

fn modes_at(robot: &Robot, at: &Vector3<f64>, distribution: Distribution) -> Option<Modes> {
    let held = tension::at(robot, at, &Vector3::zeros(), distribution).ok()?;
    Modes::at(robot, at, &held.tensions_n)
}
