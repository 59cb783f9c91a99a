//! Checks of whole files: of values that depend on each other. The sections state what else each key accepts.

use super::{DrumEncoder, RobotFile, SystemFile, TablePaths, gateway, logger, motor_io, names, plugin, process};
use crate::Problem;
use crate::number::number;

/// Fastest cable that motor-io takes for credible, as a multiple of the speed limit, and a part of a cycle by which an
/// answer may be later than the one before.
const FASTEST: f64 = 1.5 * 1.2;

/// Checks a robot file, in addition to [`cable_robot::Robot::new`].
pub(super) fn robot(file: &RobotFile) -> Result<(), Problem> {
    let robot = &file.robot;
    robot.check_ranges("robot")?;
    if let Some(anchor) = robot.anchors_m.iter().flatten().find(|value| value.abs() > 500.0) {
        let clause = format!("contains {anchor}; accepted: metres within 500 m of the origin (are these millimetres?)");
        return Err(Problem::with_clause("robot.anchors_m", clause));
    }
    for corner in robot.keep_out.iter().flatten() {
        corner
            .resolve(robot.anchors_m.is_planar())
            .map_err(|why| Problem::with_clause("robot.keep_out", format!("is not usable: {why}")))?;
    }
    // A floating node is pulled down by cables from below, so its anchors may be below the ground level.
    let hangs = robot.net_weight_n.is_none_or(|weight| weight > 0.0);
    for (index, anchor) in robot.anchors_m.iter().enumerate() {
        if hangs && anchor[2] <= robot.ground_m {
            let clause = format!(
                "number {} is at height {} m; accepted: above `ground_m` = {} m, because the node hangs below its anchors",
                index + 1,
                anchor[2],
                robot.ground_m
            );
            return Err(Problem::with_clause("robot.anchors_m", clause));
        }
    }
    file.lines.check_ranges("lines")?;
    if file.lines.counts_stretched.any() && file.lines.stiffness_n.is_none() {
        let clause = "is given for rigid cables; give `stiffness_n` too, or remove it";
        return Err(Problem::with_clause("lines.counts_stretched", clause));
    }
    file.drum.as_ref().map_or(Ok(()), |drum| drum.check_ranges("drum"))?;
    file.motor.check_ranges("motor")?;
    if let TablePaths::Each(paths) = &file.motor.table
        && !(paths.is_empty() || paths.len() == robot.anchors_m.len())
    {
        let (paths, cables) = (paths.len(), robot.anchors_m.len());
        let clause = format!(
            "lists {paths} files for {cables} cables; accepted: one file per cable in a list, or one path without a list \
             for all"
        );
        return Err(Problem::with_clause("motor.table", clause));
    }
    file.uncertainty.check_ranges("uncertainty")?;
    file.site.map_or(Ok(()), |site| site.check_ranges("site"))
}

/// One encoder of each cable counts turns of a drum that the robot file describes, where there are two.
fn second_encoders(file: &SystemFile, robot: &RobotFile) -> Result<(), Problem> {
    const KEY: &str = "motor_io.second_counts_per_m";
    let second = !file.motor_io.second_counts_per_m.is_empty();
    match &robot.drum {
        None if second => {
            let clause = "needs `[drum]` in the robot file: a turn of the drum winds the more cable the fuller it is";
            Err(Problem::with_clause(KEY, clause))
        }
        Some(drum) if drum.encoder == DrumEncoder::Second && !second => {
            let clause = "is missing, and `drum.encoder` in the robot file is \"second\"; give the counts of the encoders on \
                          the drums, or `encoder = \"first\"`";
            Err(Problem::with_clause(KEY, clause))
        }
        _ => unambiguous(file, robot),
    }
}

/// No second encoder whose reading repeats turns so far between two cycles that its direction is unknown.
fn unambiguous(file: &SystemFile, robot: &RobotFile) -> Result<(), Problem> {
    let motion_m = FASTEST * robot.cable_speed_limit_m_s() / file.rate_hz;
    for port in &file.motor_io.ports {
        let Some(turn) = port.protocol.family().second_turn else { continue };
        for unit in port.units.iter().filter(|unit| unit.second_encoder.is_some()) {
            let counts = unit.cables.first().and_then(|cable| file.motor_io.second_counts_per_m.get(cable - 1));
            let Some(counts) = counts.filter(|counts| counts.abs() * motion_m >= 0.5 * turn) else { continue };
            let clause = format!(
                "contains {counts}, and an encoder of a {} has to turn less than half a turn in a cycle; accepted: up to {:.0} at \
                 {} Hz, or exchange the two encoders, because the first one may turn as fast as it likes",
                port.protocol.name(),
                0.5 * turn / motion_m,
                file.rate_hz
            );
            return Err(Problem::with_clause("motor_io.second_counts_per_m", clause));
        }
    }
    Ok(())
}

/// Checks a system file for this robot.
pub(super) fn system_file(file: &SystemFile, robot: &RobotFile) -> Result<(), Problem> {
    names::check("name", &file.name)?;
    number("rate_hz", file.rate_hz, "10 to 500 cycles per second", |v| (10.0..=500.0).contains(&v))?;
    motor_io::check(&file.motor_io, robot.robot.anchors_m.len(), file.rate_hz)?;
    second_encoders(file, robot)?;
    file.arbiter.check_ranges("arbiter")?;
    file.estimator.check_ranges("estimator")?;
    file.controller.check_ranges("controller")?;
    file.planner.check(&robot.robot)?;
    file.recorder.check_ranges("recorder")?;
    file.viewer.check_ranges("viewer")?;
    gateway::check_names("viewer.look", &file.viewer.look)?;
    gateway::check(&file.gateway)?;
    logger::check(&file.sensor_logger)?;
    file.realtime.check_ranges("realtime")?;
    file.bus.check_ranges("bus")?;
    process::check(&file.process)?;
    plugin::check(file)
}
