//! Checks of the values in configuration files. Each problem is one clause: key, value, accepted values.

use super::{
    ArbiterSection, MotorIoSection, PortSection, ProcessSection, RobotFile, RobotSection, Role, SystemFile, UnitSection,
};
use crate::number::number;
use crate::{DriveFamily, Problem};
use cable_robot::anchors::RADII_M;
use cable_robot::control_bounds::{MAX_LENGTH_GAIN, MAX_PREVIEW, MAX_WINDOW};
use messages::Slot;

/// Longest name, characters: it becomes part of the path of a socket, whose length is limited.
const NAME_MAX: usize = 16;

fn count(key: &str, value: usize, low: usize, high: usize) -> Result<(), Problem> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(Problem::of(key, format!("is {value}; accepted: {low} to {high}")))
    }
}

/// Checks the name of a system or process, which becomes part of names in shared memory.
fn name(key: &str, value: &str) -> Result<(), Problem> {
    let fine = value.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-');
    if fine && (1..=NAME_MAX).contains(&value.len()) {
        Ok(())
    } else {
        Err(Problem::of(key, format!("is \"{value}\"; accepted: 1 to {NAME_MAX} of a-z, 0-9 and -")))
    }
}

/// Checks a robot file, in addition to [`cable_robot::Robot::new`].
pub(super) fn robot(file: &RobotFile) -> Result<(), Problem> {
    let robot = &file.robot;
    if let Some(limit) = robot.cable_speed_limit_m_s {
        number("robot.cable_speed_limit_m_s", limit, "a speed above 0, at most 10 m/s", |v| v > 0.0 && v <= 10.0)?;
    }
    // Such a robot moves at walking pace. A speed ten times as high is probably in another unit.
    number("robot.speed_limit_m_s", robot.speed_limit_m_s, "a speed above 0, at most 10 m/s", |v| {
        v > 0.0 && v <= 10.0
    })?;
    number("robot.acceleration_limit_m_s2", robot.acceleration_limit_m_s2, "above 0, at most 50 m/s²", |v| {
        v > 0.0 && v <= 50.0
    })?;
    number("robot.node_mass_kg", robot.node_mass_kg, "a mass above 0, at most 1000 kg", |v| v > 0.0 && v <= 1000.0)?;
    if let Some(anchor) = robot.anchors_m.iter().flatten().find(|value| value.abs() > 500.0) {
        let clause = format!("contains {anchor}; accepted: metres within 500 m of the origin (are these millimetres?)");
        return Err(Problem::of("robot.anchors_m", clause));
    }
    for radius in &robot.pulley_radius_m {
        number("robot.pulley_radius_m", *radius, "radii of 0 (an eye) to 0.5 m (are these millimetres?)", |v| {
            RADII_M.contains(&v)
        })?;
    }
    limits(robot)?;
    number("robot.drag_n_s2_m2", robot.drag_n_s2_m2, "0 to 1e4 N s²/m²", |v| (0.0..=1e4).contains(&v))?;
    for corner in robot.keep_out.iter().flatten() {
        corner
            .resolve(robot.anchors_m.is_planar())
            .map_err(|why| Problem::of("robot.keep_out", format!("is not usable: {why}")))?;
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
            return Err(Problem::of("robot.anchors_m", clause));
        }
    }
    if let Some(stiffness) = file.lines.stiffness_n {
        number("lines.stiffness_n", stiffness, "100 to 1e7 N (EA, tension per unit of strain)", |v| {
            (100.0..=1e7).contains(&v)
        })?;
    }
    motors(file)?;
    number("motor.current_limit_a", file.motor.current_limit_a, "above 0, at most 500 A", |v| v > 0.0 && v <= 500.0)?;
    if let Some(site) = file.site {
        number("site.latitude_deg", site.latitude_deg, "-90 to 90", |v| v.abs() <= 90.0)?;
        number("site.longitude_deg", site.longitude_deg, "-180 to 180", |v| v.abs() <= 180.0)?;
        number("site.azimuth_deg", site.azimuth_deg, "-360 to 360", |v| v.abs() <= 360.0)?;
    }
    Ok(())
}

/// Checks forces and sizes against generous limits for such robots: larger values are in another unit or lack a decimal
/// point.
fn limits(robot: &RobotSection) -> Result<(), Problem> {
    for tension in robot.tension_limits_n {
        number("robot.tension_limits_n", tension, "two tensions of 0 to 1e5 N", |v| (0.0..=1e5).contains(&v))?;
    }
    if let Some(weight) = robot.net_weight_n {
        number("robot.net_weight_n", weight, "0 to 1e4 N", |v| (0.0..=1e4).contains(&v))?;
    }
    number("robot.ground_m", robot.ground_m, "a height within 500 m of the origin", |v| v.abs() <= 500.0)?;
    for length in robot.length_limits_m {
        number("robot.length_limits_m", length, "two lengths above 0, at most 2000 m", |v| v > 0.0 && v <= 2000.0)?;
    }
    number("robot.clearance_m", robot.clearance_m, "0 to 10 m", |v| (0.0..=10.0).contains(&v))?;
    for coordinate in robot.keep_out.iter().flatten().flat_map(|corner| corner.position_m) {
        number("robot.keep_out", coordinate, "corners within 1e4 m of the origin", |v| v.abs() <= 1e4)?;
    }
    Ok(())
}

/// Checks motors and cables, in addition to [`cable_robot::motor::Motor::check`].
fn motors(file: &RobotFile) -> Result<(), Problem> {
    number("lines.mass_kg_m", file.lines.mass_kg_m, "0 to 1 kg/m", |v| (0.0..=1.0).contains(&v))?;
    if file.lines.counts_stretched.any() && file.lines.stiffness_n.is_none() {
        let clause = "is given for rigid cables; give `stiffness_n` too, or remove it";
        return Err(Problem::of("lines.counts_stretched", clause));
    }
    for length in &file.lines.routed_length_m {
        number("lines.routed_length_m", *length, "lengths of 0 to 1000 m", |v| (0.0..=1000.0).contains(&v))?;
    }
    let motor = &file.motor;
    number("motor.force_constant_n_a", motor.force_constant_n_a, "0.001 to 1e5 N/A", |v| (1e-3..=1e5).contains(&v))?;
    number("motor.resistance_ohm", motor.resistance_ohm, "0 to 1e4 ohm", |v| (0.0..=1e4).contains(&v))?;
    number("motor.gear_friction", motor.gear_friction, "0 to 100", |v| (0.0..=100.0).contains(&v))?;
    number("motor.coulomb_n", motor.coulomb_n, "0 to 1e5 N", |v| (0.0..=1e5).contains(&v))?;
    number("motor.viscous_n_s_m", motor.viscous_n_s_m, "0 to 1e6 N s/m", |v| (0.0..=1e6).contains(&v))?;
    number("motor.transition_m_s", motor.transition_m_s, "0 to 10 m/s", |v| (0.0..=10.0).contains(&v))
}

/// Checks a system file for this robot.
pub(super) fn system_file(file: &SystemFile, robot: &RobotFile) -> Result<(), Problem> {
    let cables = robot.robot.anchors_m.len();
    name("name", &file.name)?;
    number("rate_hz", file.rate_hz, "10 to 250 cycles per second", |v| (10.0..=250.0).contains(&v))?;
    motor_io(&file.motor_io, cables, file.rate_hz)?;
    arbiter(&file.arbiter)?;

    count("estimator.eta", file.estimator.eta, 2, MAX_WINDOW)?;
    number("estimator.ridge", file.estimator.ridge, "0 to 1", |v| (0.0..=1.0).contains(&v))?;
    for phi in file.estimator.prior {
        number("estimator.prior", phi, "two numbers of -2 to 2", |v| v.abs() <= 2.0)?;
    }
    number("estimator.sigma_length_m", file.estimator.sigma_length_m, "above 0, at most 1 m", |v| v > 0.0 && v <= 1.0)?;

    number("estimator.drive_lag_s", file.estimator.drive_lag_s, "0.001 to 1 s", |v| (0.001..=1.0).contains(&v))?;
    let sigma = file.estimator.acceleration_sigma_m_s2;
    number("estimator.acceleration_sigma_m_s2", sigma, "0.001 to 100 m/s²", |v| (0.001..=100.0).contains(&v))?;
    count("estimator.ttl_cycles", file.estimator.ttl_cycles as usize, 1, 50)?;
    number("estimator.reading_sigma_m", file.estimator.reading_sigma_m, "0.000001 to 0.1 m", |v| {
        (1e-6..=0.1).contains(&v)
    })?;

    number("controller.length_gain_per_s", file.controller.length_gain_per_s, "above 0, at most 50 per second", |v| {
        v > 0.0 && v <= MAX_LENGTH_GAIN
    })?;
    count("controller.horizon_cycles", file.controller.horizon_cycles, 1, 200)?;
    number("controller.state_weight", file.controller.state_weight, "0 to 1e9", |v| (0.0..=1e9).contains(&v))?;
    number("controller.input_weight", file.controller.input_weight, "1e-9 to 1e9", |v| (1e-9..=1e9).contains(&v))?;
    number("controller.redundant_s", file.controller.redundant_s, "0.05 to 60 s", |v| (0.05..=60.0).contains(&v))?;
    number("controller.error_limit_m", file.controller.error_limit_m, "0.01 to 5 m", |v| (0.01..=5.0).contains(&v))?;
    count("controller.preview_cycles", file.controller.preview_cycles, 2, MAX_PREVIEW)?;
    number("controller.move_penalty_s4", file.controller.move_penalty_s4, "1e-9 to 1 s⁴", |v| {
        (1e-9..=1.0).contains(&v)
    })?;
    for seconds in file.controller.drive_lag_s.unwrap_or_default() {
        number("controller.drive_lag_s", seconds, "two times of 0 to 0.5 s", |v| (0.0..=0.5).contains(&v))?;
    }
    number("controller.misfit_limit", file.controller.misfit_limit, "above 0, at most 1", |v| v > 0.0 && v <= 1.0)?;

    let (speed, acceleration) = (robot.robot.speed_limit_m_s, robot.robot.acceleration_limit_m_s2);
    let below = format!("above 0, at most the robot's `speed_limit_m_s` of {speed}");
    number("planner.speed_m_s", file.planner.speed_m_s, &below, |v| v > 0.0 && v <= speed)?;
    let below = format!("above 0, at most the robot's `acceleration_limit_m_s2` of {acceleration}");
    number("planner.acceleration_m_s2", file.planner.acceleration_m_s2, &below, |v| v > 0.0 && v <= acceleration)?;
    number("planner.swing_limit_m", file.planner.swing_limit_m, "0.0001 to 1 m", |v| (0.0001..=1.0).contains(&v))?;
    number("planner.check_step_m", file.planner.check_step_m, "0.001 to 0.5 m", |v| (0.001..=0.5).contains(&v))?;

    number("recorder.segment_s", file.recorder.segment_s, "10 to 1e6 s", |v| (10.0..=1e6).contains(&v))?;
    if !(10_000_000..=1_000_000_000_000).contains(&file.recorder.segment_bytes) {
        let given = file.recorder.segment_bytes;
        let clause = format!("is {given}; accepted: 10000000 to 1000000000000 bytes");
        return Err(Problem::of("recorder.segment_bytes", clause));
    }
    number("recorder.flush_s", file.recorder.flush_s, "0.05 to 10 s", |v| (0.05..=10.0).contains(&v))?;
    number("viewer.rate_hz", file.viewer.rate_hz, "1 to 200 samples per second", |v| (1.0..=200.0).contains(&v))?;
    super::logger::check(&file.sensor_logger)?;
    if file.realtime.priority > 90 {
        let clause = format!("is {}; accepted: 0 (ordinary) to 90", file.realtime.priority);
        return Err(Problem::of("realtime.priority", clause));
    }
    processes(&file.process)
}

fn motor_io(section: &MotorIoSection, cables: usize, rate_hz: f64) -> Result<(), Problem> {
    if section.counts_per_m.len() != cables {
        let values = section.counts_per_m.len();
        let clause = format!("has {values} values for {cables} cables; accepted: one value per cable");
        return Err(Problem::of("motor_io.counts_per_m", clause));
    }
    for value in &section.counts_per_m {
        number("motor_io.counts_per_m", *value, "100 to 1e7 counts per metre, positive or negative", |v| {
            (100.0..=1e7).contains(&v.abs())
        })?;
    }
    ports(section, cables)?;
    let period = 1.0 / rate_hz;
    for port in &section.ports {
        watchdog(section.watchdog_s, &port.protocol.family())?;
    }
    if section.watchdog_s < 3.0 * period {
        let clause = format!("is {}; accepted: at least three periods of {period} s", section.watchdog_s);
        return Err(Problem::of("motor_io.watchdog_s", clause));
    }
    count("motor_io.ttl_cycles", section.ttl_cycles as usize, 1, 50)?;
    number("motor_io.ramp_s", section.ramp_s, "0.05 to 10 s", |v| (0.05..=10.0).contains(&v))?;
    number("motor_io.jog_speed_m_s", section.jog_speed_m_s, "0.001 to 0.5 m/s", |v| (0.001..=0.5).contains(&v))?;
    number("motor_io.slack_n", section.slack_n, "0 to 100 N", |v| (0.0..=100.0).contains(&v))?;
    count("motor_io.slack_cycles", section.slack_cycles as usize, 1, 10_000)?;
    number("motor_io.stall_duty", section.stall_duty, "above 0, at most 1", |v| v > 0.0 && v <= 1.0)?;
    count("motor_io.stall_cycles", section.stall_cycles as usize, 1, 10_000)?;
    number("motor_io.supply_min_v", section.supply_min_v, "0 to 60 V", |v| (0.0..=60.0).contains(&v))?;
    node_bounds(section)
}

/// Checks that the drives of a port can be set to this watchdog time.
fn watchdog(seconds: f64, family: &DriveFamily) -> Result<(), Problem> {
    let ([shortest_s, longest_s], step_s) = (family.watchdog_s, family.watchdog_step_s);
    let accepted = format!("{shortest_s} to {longest_s} s in steps of {step_s}");
    number("motor_io.watchdog_s", seconds, &accepted, |v| {
        let steps = v / step_s;
        (shortest_s..=longest_s).contains(&v) && (steps.round() - steps).abs() < 1e-6
    })
}

/// Checks the limits that motor-io enforces on the node.
fn node_bounds(section: &MotorIoSection) -> Result<(), Problem> {
    let metres = |v: f64| (0.001..=10.0).contains(&v);
    number("motor_io.node_speed_margin", section.node_speed_margin, "0 to 1", |v| (0.0..=1.0).contains(&v))?;
    if let Some(limit) = section.node_acceleration_limit_m_s2 {
        number("motor_io.node_acceleration_limit_m_s2", limit, "0.001 to 100 m/s²", |v| (0.001..=100.0).contains(&v))?;
    }
    if let Some(limit) = section.correction_limit_m_s {
        number("motor_io.correction_limit_m_s", limit, "0.001 to 10 m/s", metres)?;
    }
    number("motor_io.start_bound_m", section.start_bound_m, "0.001 to 10 m", metres)?;
    number("motor_io.divergence_m", section.divergence_m, "0.001 to 10 m", metres)?;
    number("motor_io.divergence_s", section.divergence_s, "0.01 to 10 s", |v| (0.01..=10.0).contains(&v))
}

fn arbiter(section: &ArbiterSection) -> Result<(), Problem> {
    number("arbiter.qualify_s", section.qualify_s, "0.1 to 60 s", |v| (0.1..=60.0).contains(&v))?;
    number("arbiter.command_bound", section.command_bound, "0.001 to 1", |v| (0.001..=1.0).contains(&v))?;
    number("arbiter.bias_share", section.bias_share, "0.001 to 1", |v| (0.001..=1.0).contains(&v))?;
    number("arbiter.bias_bound_m_s", section.bias_bound_m_s, "0.001 to 10 m/s", |v| (0.001..=10.0).contains(&v))?;
    number("arbiter.estimate_bound_m", section.estimate_bound_m, "0.0001 to 1 m", |v| (1e-4..=1.0).contains(&v))?;
    number("arbiter.announce_s", section.announce_s, "0 to 10 s", |v| (0.0..=10.0).contains(&v))?;
    number("arbiter.fade_s", section.fade_s, "0 to 10 s", |v| (0.0..=10.0).contains(&v))?;
    number("arbiter.probation_s", section.probation_s, "0 to 60 s", |v| (0.0..=60.0).contains(&v))?;
    count("arbiter.quarantine_falls", section.quarantine_falls.into(), 1, 100)?;
    number("arbiter.forgive_s", section.forgive_s, "0.1 to 3600 s", |v| (0.1..=3600.0).contains(&v))
}

fn ports(section: &MotorIoSection, cables: usize) -> Result<(), Problem> {
    if section.ports.is_empty() {
        let clause = "is empty; accepted: at least one serial port with its drive units";
        return Err(Problem::of("motor_io.ports", clause));
    }
    let mut owner: Vec<Option<(usize, u8)>> = vec![None; cables];
    for (index, port) in section.ports.iter().enumerate() {
        let here =
            |problem: Problem| problem.within(&format!("motor_io.ports.{index}"), &format!("port {}", index + 1));
        if section.ports[..index].iter().any(|other| other.path == port.path) {
            let sentence = format!("two ports have the path {}; accepted: each device once", port.path);
            return Err(here(Problem::at("path", sentence)));
        }
        serial_port(port).map_err(here)?;
        for (at, unit) in port.units.iter().enumerate() {
            let of_unit =
                |problem: Problem| here(problem.within(&format!("units.{at}"), &format!("unit {}", unit.address)));
            if port.units[..at].iter().any(|other| other.address == unit.address) {
                let sentence = format!(
                    "two units on port {} have the address {}; accepted: each address once per port",
                    index + 1,
                    unit.address
                );
                return Err(of_unit(Problem::at("address", sentence)));
            }
            let family = port.protocol.family();
            drive_unit(unit, &family, index + 1, cables, &mut owner).map_err(of_unit)?;
        }
    }
    match owner.iter().position(Option::is_none) {
        Some(cable) => Err(Problem::at(
            "motor_io.ports",
            format!("no drive unit has cable {}; accepted: every cable on one motor", cable + 1),
        )),
        None => Ok(()),
    }
}

fn serial_port(port: &PortSection) -> Result<(), Problem> {
    if port.path.is_empty() {
        return Err(Problem::of("path", "is empty; accepted: a device, e.g. /dev/serial/by-id/..."));
    }
    let bauds = port.protocol.family().bauds;
    if !bauds.contains(&port.baud) {
        let accepted: Vec<String> = bauds.iter().map(u32::to_string).collect();
        return Err(Problem::of("baud", format!("is {}; accepted: {}", port.baud, accepted.join(", "))));
    }
    if port.units.is_empty() {
        return Err(Problem::of("units", "is empty; accepted: at least one drive unit"));
    }
    Ok(())
}

/// Checks a unit on the port with this `number`; `owner` contains the port and the address of the unit of each cable.
fn drive_unit(
    unit: &UnitSection,
    family: &DriveFamily,
    number: usize,
    cables: usize,
    owner: &mut [Option<(usize, u8)>],
) -> Result<(), Problem> {
    let address = unit.address;
    if !family.addresses.contains(&address) {
        let accepted = family.addresses_in_words;
        let sentence = format!("`address` on port {number} is {address}; accepted: {accepted}");
        return Err(Problem::at("address", sentence));
    }
    let at_cables = |sentence: String| Err(Problem::at("cables", sentence));
    if !(1..=2).contains(&unit.cables.len()) {
        return at_cables(format!(
            "unit {address} on port {number} has {} cables; accepted: one or two, on motor 1 and motor 2",
            unit.cables.len()
        ));
    }
    for cable in &unit.cables {
        if !(1..=cables).contains(cable) {
            return at_cables(format!("unit {address} on port {number} has cable {cable}; accepted: 1 to {cables}"));
        }
        if let Some((port, other)) = owner[cable - 1].replace((number, address)) {
            return at_cables(format!(
                "cable {cable} is on unit {other} of port {port} and on unit {address} of port {number}; accepted: one motor per cable"
            ));
        }
    }
    Ok(())
}

fn processes(list: &[ProcessSection]) -> Result<(), Problem> {
    for (index, process) in list.iter().enumerate() {
        let here =
            |problem: Problem| problem.within(&format!("process.{index}"), &format!("process \"{}\"", process.name));
        process_name(&process.name, process.role, process.slot()).map_err(here)?;
        if list[..index].iter().any(|other| other.name == process.name) {
            let sentence = format!("two processes are called \"{}\"; accepted: each name once", process.name);
            return Err(here(Problem::at("name", sentence)));
        }
        place_of_process(process, &list[..index]).map_err(here)?;
        process_keys(process).map_err(here)?;
    }
    Ok(())
}

/// Checks that a role has at most one process, or one in each slot.
fn place_of_process(process: &ProcessSection, others: &[ProcessSection]) -> Result<(), Problem> {
    let slots = process.role.has_slots();
    let same_place = |other: &&ProcessSection| {
        other.start && other.role == process.role && (!slots || other.slot() == process.slot())
    };
    if process.role == Role::Other || !process.start {
        return Ok(());
    }
    let Some(other) = others.iter().find(same_place) else { return Ok(()) };
    let place = if slots { format!(" in slot {}", process.slot().name()) } else { String::new() };
    let sentence = format!(
        "the processes \"{}\" and \"{}\" both have the `role` \"{}\"{place}; accepted: one, which replaces the standard process; give the other `start = false`{}",
        other.name,
        process.name,
        process.role.name(),
        if slots { " or `standby = true`" } else { "" }
    );
    Err(Problem::at("role", sentence))
}

/// Rejects reserved names: each standard name belongs to its role and slot.
fn process_name(given: &str, role: Role, slot: Slot) -> Result<(), Problem> {
    let refuse = |sentence: String| Err(Problem::at("name", sentence));
    name("name", given)?;
    if given == "nims" {
        return refuse("the process name \"nims\" belongs to the supervisor; choose another name".to_owned());
    }
    for (_, owner) in Role::STANDARD {
        let of_slot = |slot| owner.process_name(slot) == given;
        if owner != role && (of_slot(Slot::A) || owner.has_slots() && of_slot(Slot::B)) {
            let owner = owner.name();
            return refuse(format!("the process name \"{given}\" belongs to the role {owner}; choose another name"));
        }
        if owner == role && role.has_slots() && Slot::ALL.iter().any(|other| *other != slot && of_slot(*other)) {
            return refuse(format!("the process name \"{given}\" belongs to the other slot; choose another name"));
        }
    }
    Ok(())
}

fn process_keys(process: &ProcessSection) -> Result<(), Problem> {
    let own = &process.name;
    let (role, slots) = (process.role, process.role.has_slots());
    if process.command.first().is_some_and(String::is_empty) || process.command.is_empty() && !slots {
        return Err(Problem::of("command", "is empty; accepted: a program and its arguments"));
    }
    if !slots && (process.slot.is_some() || process.standby || process.law.is_some()) {
        return Err(Problem::at(
            "role",
            format!(
                "process \"{own}\" has `slot`, `standby` or `law`; accepted: only with the roles controller and estimator"
            ),
        ));
    }
    if process.standby && process.slot() == Slot::A {
        let sentence = format!("the standby \"{own}\" is in slot a; accepted: slot b");
        return Err(Problem::at("slot", sentence));
    }
    if process.law.is_some() && !process.command.is_empty() {
        let sentence = format!("process \"{own}\" has a `law` and a `command`; accepted: one of them");
        return Err(Problem::at("law", sentence));
    }
    if let Some(law) = process.law.filter(|law| law.role() != role) {
        let accepted = role.algorithms().join(", ");
        return Err(Problem::of("law", format!("is \"{}\"; accepted: {accepted}", law.name())));
    }
    number("restart_pause_s", process.restart_pause_s, "0.1 to 30 s", |v| (0.1..=30.0).contains(&v))?;
    count("restart_limit", process.restart_limit as usize, 1, 1000)?;
    number("restart_forgive_s", process.restart_forgive_s, "0.1 to 3600 s", |v| (0.1..=3600.0).contains(&v))?;
    if process.priority > 90 {
        return Err(Problem::of("priority", format!("is {}; accepted: 0 (ordinary) to 90", process.priority)));
    }
    if matches!(role, Role::MotorIo | Role::Estimator | Role::Controller)
        && (process.priority > 0 || process.cpu.is_some())
    {
        let sentence =
            format!("process \"{own}\" belongs to the control chain; set its `priority` and `cpu` in [realtime]");
        return Err(Problem::at(if process.priority > 0 { "priority" } else { "cpu" }, sentence));
    }
    Ok(())
}
