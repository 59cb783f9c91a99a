//! What the values of the configuration files may be. Each problem is one clause: key, what it is, what is accepted.

use super::{
    ArbiterSection, MotorBoxSection, MotorIoSection, ProcessSection, RobotFile, RobotSection, Role, SystemFile,
};
use crate::Slot;

/// The control laws that the program `controller` has.
pub const LAWS: [&str; 3] = ["lq-endpoint", "preview", "p-feedforward"];
/// The methods that the program `estimator` has.
pub const METHODS: [&str; 2] = ["phi", "kalman"];

/// Baud rates that the drives' set-up program offers.
const BAUDS: [u32; 8] = [2400, 9600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800];
/// Inputs of a serial port beside its data.
const STOP_PINS: [&str; 3] = ["cts", "dsr", "cd"];
/// Longest watchdog of a drive, s: a byte of tenths.
const WATCHDOG_MAX_S: f64 = 25.5;
/// A name becomes part of a socket's path, which is short.
const NAME_MAX: usize = 16;

/// A number as it is quoted in a sentence: not with a hundred digits.
pub struct Given(pub f64);

impl std::fmt::Display for Given {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self(value) = self;
        if value.is_finite() && *value != 0.0 && !(1e-6..1e9).contains(&value.abs()) {
            write!(f, "{value:e}")
        } else {
            write!(f, "{value}")
        }
    }
}

/// Says what is wrong unless `value` is finite and accepted.
pub(super) fn number(key: &str, value: f64, accepted: &str, ok: impl Fn(f64) -> bool) -> Result<(), String> {
    if value.is_finite() && ok(value) {
        Ok(())
    } else {
        Err(format!("`{key}` is {}; accepted: {accepted}", Given(value)))
    }
}

fn count(key: &str, value: usize, low: usize, high: usize) -> Result<(), String> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(format!("`{key}` is {value}; accepted: {low} to {high}")) }
}

fn choice(key: &str, value: &str, accepted: &[&str]) -> Result<(), String> {
    if accepted.contains(&value) {
        Ok(())
    } else {
        Err(format!("`{key}` is \"{value}\"; accepted: {}", accepted.join(", ")))
    }
}

/// Names of boxes and processes are parts of names in shared memory.
fn name(key: &str, value: &str) -> Result<(), String> {
    let fine = value.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-');
    if fine && (1..=NAME_MAX).contains(&value.len()) {
        Ok(())
    } else {
        Err(format!("`{key}` is \"{value}\"; accepted: 1 to {NAME_MAX} of a-z, 0-9 and -"))
    }
}

/// A robot file beyond what [`cable_robot::Robot::new`] checks.
pub(super) fn robot(file: &RobotFile) -> Result<(), String> {
    let robot = &file.robot;
    if let Some(limit) = robot.cable_speed_limit_m_s {
        number("cable_speed_limit_m_s", limit, "a speed above 0, at most 10 m/s", |v| v > 0.0 && v <= 10.0)?;
    }
    // a robot of this kind moves at walking pace; ten times that is millimetres taken for metres
    number("speed_limit_m_s", robot.speed_limit_m_s, "a speed above 0, at most 10 m/s", |v| v > 0.0 && v <= 10.0)?;
    number("acceleration_limit_m_s2", robot.acceleration_limit_m_s2, "above 0, at most 50 m/s²", |v| {
        v > 0.0 && v <= 50.0
    })?;
    number("node_mass_kg", robot.node_mass_kg, "a mass above 0, at most 1000 kg", |v| v > 0.0 && v <= 1000.0)?;
    if let Some(anchor) = robot.anchors_m.iter().flatten().find(|value| value.abs() > 500.0) {
        return Err(format!(
            "`anchors_m` holds {anchor}; accepted: metres within 500 m of the origin (are these millimetres?)"
        ));
    }
    limits(robot)?;
    number("drag_n_s2_m2", robot.drag_n_s2_m2, "0 to 1e4 N s²/m²", |v| (0.0..=1e4).contains(&v))?;
    for corner in robot.keep_out.iter().flatten() {
        corner.on(robot.anchors_m.is_planar()).map_err(|why| format!("`keep_out`: {why}"))?;
    }
    // A node that floats is pulled down by lines from below.
    let hangs = robot.net_weight_n.is_none_or(|weight| weight > 0.0);
    for (index, anchor) in robot.anchors_m.iter().enumerate() {
        if hangs && anchor[2] <= robot.ground_m {
            return Err(format!(
                "`anchors_m` number {} is at height {} m, not above `ground_m` = {} m; a node hangs below its anchors",
                index + 1,
                anchor[2],
                robot.ground_m
            ));
        }
    }
    if let Some(stiffness) = file.lines.stiffness_n {
        number("stiffness_n", stiffness, "100 to 1e7 N (EA, tension per unit of strain)", |v| {
            (100.0..=1e7).contains(&v)
        })?;
    }
    motors(file)?;
    number("current_limit_a", file.motor.current_limit_a, "above 0, at most 500 A", |v| v > 0.0 && v <= 500.0)?;
    if let Some(site) = file.site {
        number("latitude_deg", site.latitude_deg, "-90 to 90", |v| v.abs() <= 90.0)?;
        number("longitude_deg", site.longitude_deg, "-180 to 180", |v| v.abs() <= 180.0)?;
        number("azimuth_deg", site.azimuth_deg, "-360 to 360", |v| v.abs() <= 360.0)?;
    }
    Ok(())
}

/// What a robot of this kind has in forces and sizes, with room above: what is beyond has another unit, or lost its decimal point.
fn limits(robot: &RobotSection) -> Result<(), String> {
    for tension in robot.tension_limits_n {
        number("tension_limits_n", tension, "two tensions of 0 to 1e5 N", |v| (0.0..=1e5).contains(&v))?;
    }
    if let Some(weight) = robot.net_weight_n {
        number("net_weight_n", weight, "0 to 1e4 N", |v| (0.0..=1e4).contains(&v))?;
    }
    number("ground_m", robot.ground_m, "a height within 500 m of the origin", |v| v.abs() <= 500.0)?;
    for length in robot.length_limits_m {
        number("length_limits_m", length, "two lengths above 0, at most 2000 m", |v| v > 0.0 && v <= 2000.0)?;
    }
    for coordinate in robot.keep_out.iter().flatten().flat_map(|corner| corner.position_m) {
        number("keep_out", coordinate, "corners within 1e4 m of the origin", |v| v.abs() <= 1e4)?;
    }
    Ok(())
}

/// Motors and lines beyond what [`cable_robot::motor::Motor::check`] checks.
fn motors(file: &RobotFile) -> Result<(), String> {
    for length in &file.lines.routed_length_m {
        number("routed_length_m", *length, "lengths of 0 to 1000 m", |v| (0.0..=1000.0).contains(&v))?;
    }
    let motor = &file.motor;
    number("force_constant_n_a", motor.force_constant_n_a, "0.001 to 1e5 N/A", |v| (1e-3..=1e5).contains(&v))?;
    number("resistance_ohm", motor.resistance_ohm, "0 to 1e4 ohm", |v| (0.0..=1e4).contains(&v))?;
    number("gear_friction", motor.gear_friction, "0 to 100", |v| (0.0..=100.0).contains(&v))?;
    number("coulomb_n", motor.coulomb_n, "0 to 1e5 N", |v| (0.0..=1e5).contains(&v))?;
    number("viscous_n_s_m", motor.viscous_n_s_m, "0 to 1e6 N s/m", |v| (0.0..=1e6).contains(&v))?;
    number("transition_m_s", motor.transition_m_s, "0 to 10 m/s", |v| (0.0..=10.0).contains(&v))
}

/// A system file for a robot of `cables` cables, whose node may do at most the given speed and acceleration.
pub(super) fn system_file(file: &SystemFile, robot: &RobotFile) -> Result<(), String> {
    let cables = robot.robot.anchors_m.len();
    name("name", &file.name)?;
    number("rate_hz", file.rate_hz, "10 to 250 cycles per second", |v| (10.0..=250.0).contains(&v))?;
    motor_io(&file.motor_io, cables, file.rate_hz)?;
    arbiter(&file.arbiter)?;

    choice("estimator.method", &file.estimator.method, &METHODS)?;
    count("estimator.eta", file.estimator.eta, 2, cable_control::motor_model::MAX_WINDOW)?;
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

    choice("controller.law", &file.controller.law, &LAWS)?;
    number("controller.length_gain_per_s", file.controller.length_gain_per_s, "above 0, at most 50 per second", |v| {
        v > 0.0 && v <= cable_control::law::MAX_LENGTH_GAIN
    })?;
    count("controller.horizon_cycles", file.controller.horizon_cycles, 1, 200)?;
    number("controller.state_weight", file.controller.state_weight, "0 to 1e9", |v| (0.0..=1e9).contains(&v))?;
    number("controller.input_weight", file.controller.input_weight, "1e-9 to 1e9", |v| (1e-9..=1e9).contains(&v))?;
    choice("controller.distribution", &file.controller.distribution, &["least-norm", "min-sum", "safest"])?;
    number("controller.redundant_s", file.controller.redundant_s, "0.05 to 60 s", |v| (0.05..=60.0).contains(&v))?;
    number("controller.error_limit_m", file.controller.error_limit_m, "0.01 to 5 m", |v| (0.01..=5.0).contains(&v))?;
    count("controller.preview_cycles", file.controller.preview_cycles, 2, cable_control::preview::MAX_PREVIEW)?;
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
    number("planner.check_step_m", file.planner.check_step_m, "0.001 to 0.5 m", |v| (0.001..=0.5).contains(&v))?;

    number("recorder.segment_s", file.recorder.segment_s, "10 to 1e6 s", |v| (10.0..=1e6).contains(&v))?;
    if !(10_000_000..=1_000_000_000_000).contains(&file.recorder.segment_bytes) {
        let given = file.recorder.segment_bytes;
        return Err(format!("`recorder.segment_bytes` is {given}; accepted: 10000000 to 1000000000000 bytes"));
    }
    number("recorder.flush_s", file.recorder.flush_s, "0.05 to 10 s", |v| (0.05..=10.0).contains(&v))?;
    number("viewer.rate_hz", file.viewer.rate_hz, "1 to 200 samples per second", |v| (1.0..=200.0).contains(&v))?;
    super::logger::check(&file.sensor_logger)?;
    if let Some(section) = &file.motor_box {
        motor_box(section, robot)?;
    }
    if file.realtime.priority > 90 {
        return Err(format!("`realtime.priority` is {}; accepted: 0 (ordinary) to 90", file.realtime.priority));
    }
    processes(&file.process)
}

fn motor_io(section: &MotorIoSection, cables: usize, rate_hz: f64) -> Result<(), String> {
    if section.counts_per_m.len() != cables {
        return Err(format!(
            "`motor_io.counts_per_m` has {} values and the robot has {cables} cables; accepted: one value per cable",
            section.counts_per_m.len()
        ));
    }
    for value in &section.counts_per_m {
        number("motor_io.counts_per_m", *value, "100 to 1e7 counts per metre, or the same below 0", |v| {
            (100.0..=1e7).contains(&v.abs())
        })?;
    }
    ports(section, cables)?;
    let period = 1.0 / rate_hz;
    number("motor_io.watchdog_s", section.watchdog_s, "0.1 to 25.5 s in steps of 0.1", |v| {
        (0.1..=WATCHDOG_MAX_S).contains(&v) && ((v * 10.0).round() - v * 10.0).abs() < 1e-6
    })?;
    if section.watchdog_s < 3.0 * period {
        return Err(format!(
            "`motor_io.watchdog_s` is {}; accepted: at least three periods of {period} s",
            section.watchdog_s
        ));
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

/// What motor-io holds the node to by itself.
fn node_bounds(section: &MotorIoSection) -> Result<(), String> {
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

fn arbiter(section: &ArbiterSection) -> Result<(), String> {
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

fn ports(section: &MotorIoSection, cables: usize) -> Result<(), String> {
    if section.ports.is_empty() {
        return Err("`motor_io.ports` is empty; accepted: at least one serial port with its drive units".to_owned());
    }
    let mut owner: Vec<Option<(usize, u8)>> = vec![None; cables];
    for (index, port) in section.ports.iter().enumerate() {
        let number = index + 1;
        if port.path.is_empty() {
            return Err(format!("`path` of port {number} is empty; accepted: a device, e.g. /dev/serial/by-id/..."));
        }
        if section.ports[..index].iter().any(|other| other.path == port.path) {
            return Err(format!("the path {} stands at two ports; accepted: each device once", port.path));
        }
        if !BAUDS.contains(&port.baud) {
            let accepted: Vec<String> = BAUDS.iter().map(u32::to_string).collect();
            return Err(format!("`baud` of port {number} is {}; accepted: {}", port.baud, accepted.join(", ")));
        }
        if let Some(pin) = &port.stop_pin {
            choice(&format!("stop_pin` of port `{number}"), pin, &STOP_PINS)?;
        }
        if port.units.is_empty() {
            return Err(format!("`units` of port {number} is empty; accepted: at least one drive unit"));
        }
        for (at, unit) in port.units.iter().enumerate() {
            if !(0x80..=0x87).contains(&unit.address) {
                return Err(format!(
                    "`address` {} on port {number} is outside 128 to 135 (0x80 to 0x87)",
                    unit.address
                ));
            }
            if port.units[..at].iter().any(|other| other.address == unit.address) {
                return Err(format!(
                    "two units on port {number} have the address {}; accepted: each address once per port",
                    unit.address
                ));
            }
            if !(1..=2).contains(&unit.cables.len()) {
                return Err(format!(
                    "unit {} on port {number} has {} cables; accepted: one or two, on motor 1 and motor 2",
                    unit.address,
                    unit.cables.len()
                ));
            }
            for cable in &unit.cables {
                if !(1..=cables).contains(cable) {
                    return Err(format!(
                        "unit {} on port {number} names cable {cable}; accepted: 1 to {cables}",
                        unit.address
                    ));
                }
                if let Some((other, address)) = owner[cable - 1].replace((number, unit.address)) {
                    return Err(format!(
                        "cable {cable} is on unit {address} of port {other} and on unit {} of port {number}; accepted: one motor per cable",
                        unit.address
                    ));
                }
            }
        }
    }
    match owner.iter().position(Option::is_none) {
        Some(cable) => Err(format!("no drive unit names cable {}; accepted: every cable on one motor", cable + 1)),
        None => Ok(()),
    }
}

fn motor_box(section: &MotorBoxSection, robot: &RobotFile) -> Result<(), String> {
    let start_m =
        section.start_m.on(robot.robot.anchors_m.is_planar()).map_err(|why| format!("`motor_box.start_m`: {why}"))?;
    for value in start_m {
        number("motor_box.start_m", value, "[x, y, z] in metres", |v| v.abs() <= 1000.0)?;
    }
    if start_m[2] < robot.robot.ground_m {
        return Err(format!(
            "`motor_box.start_m` is at height {} m, below the robot's `ground_m` of {} m",
            start_m[2], robot.robot.ground_m
        ));
    }
    number("motor_box.delay_s", section.delay_s, "0 to 2 s", |v| (0.0..=2.0).contains(&v))?;
    number("motor_box.lag_s", section.lag_s, "0 to 2 s", |v| (0.0..=2.0).contains(&v))?;
    number("motor_box.stiffness_n", section.stiffness_n, "100 to 1e7 N", |v| (100.0..=1e7).contains(&v))?;
    number("motor_box.drag_n_s2_m2", section.drag_n_s2_m2, "0 to 1e4 N s²/m²", |v| (0.0..=1e4).contains(&v))?;
    number("motor_box.drum_radius_m", section.drum_radius_m, "0.001 to 1 m", |v| (0.001..=1.0).contains(&v))?;
    number("motor_box.line_diameter_m", section.line_diameter_m, "0.00001 to 0.05 m", |v| (1e-5..=0.05).contains(&v))?;
    number("motor_box.turnaround_s", section.turnaround_s, "0 to 0.1 s", |v| (0.0..=0.1).contains(&v))?;
    number("motor_box.supply_v", section.supply_v, "1 to 60 V", |v| (1.0..=60.0).contains(&v))
}

fn processes(list: &[ProcessSection]) -> Result<(), String> {
    for (index, process) in list.iter().enumerate() {
        process_name(&process.name, process.role, process.slot())?;
        if list[..index].iter().any(|other| other.name == process.name) {
            return Err(format!("two processes are called \"{}\"; accepted: each name once", process.name));
        }
        let takes = |other: &&ProcessSection| {
            other.start && other.role == process.role && (!process.role.has_slots() || other.slot() == process.slot())
        };
        if process.role != Role::Other
            && process.start
            && let Some(other) = list[..index].iter().find(takes)
        {
            let place =
                if process.role.has_slots() { format!(" in slot {}", process.slot().name()) } else { String::new() };
            return Err(format!(
                "the processes \"{}\" and \"{}\" both have the `role` \"{}\"{place}; accepted: one, which takes the place of the standard one; give the other `start = false`{}",
                other.name,
                process.name,
                process.role.name(),
                if process.role.has_slots() { " or `standby = true`" } else { "" }
            ));
        }
        process_keys(process)?;
    }
    Ok(())
}

/// Whether a process may have that name: the standard ones belong to their roles.
fn process_name(given: &str, role: Role, slot: Slot) -> Result<(), String> {
    name("process.name", given)?;
    if given == "nims" {
        return Err("a process cannot be called \"nims\": that is the supervisor".to_owned());
    }
    for (_, owner) in Role::STANDARD {
        let of_slot = |slot| owner.process_name(slot) == given;
        if owner != role && (of_slot(Slot::A) || owner.has_slots() && of_slot(Slot::B)) {
            return Err(format!(
                "the process name \"{given}\" belongs to the role {}; choose another name",
                owner.name()
            ));
        }
        if owner == role
            && role.has_slots()
            && [Slot::A, Slot::B].into_iter().any(|other| other != slot && of_slot(other))
        {
            return Err(format!("the process name \"{given}\" belongs to the other slot; choose another name"));
        }
    }
    Ok(())
}

fn process_keys(process: &ProcessSection) -> Result<(), String> {
    let own = &process.name;
    let (role, slots) = (process.role, process.role.has_slots());
    if process.command.first().is_some_and(String::is_empty) || process.command.is_empty() && !slots {
        return Err(format!("`command` of process \"{own}\" is empty; accepted: a program and its arguments"));
    }
    if !slots && (process.slot.is_some() || process.standby || process.law.is_some()) {
        return Err(format!(
            "process \"{own}\" has `slot`, `standby` or `law`, which only the roles controller and estimator know"
        ));
    }
    if process.standby && process.slot() == Slot::A {
        return Err(format!("the standby \"{own}\" is in slot a, where the first one is; accepted: slot b"));
    }
    if process.law.is_some() && !process.command.is_empty() {
        return Err(format!("process \"{own}\" has a `law` and a `command`; accepted: one of them"));
    }
    number("process.restart_pause_s", process.restart_pause_s, "0.1 to 30 s", |v| (0.1..=30.0).contains(&v))?;
    count("process.restart_limit", process.restart_limit as usize, 1, 1000)?;
    number("process.restart_forgive_s", process.restart_forgive_s, "0.1 to 3600 s", |v| (0.1..=3600.0).contains(&v))?;
    if process.priority > 90 {
        return Err(format!("`priority` of process \"{own}\" is {}; accepted: 0 (ordinary) to 90", process.priority));
    }
    if matches!(role, Role::MotorIo | Role::Estimator | Role::Controller)
        && (process.priority > 0 || process.cpu.is_some())
    {
        return Err(format!(
            "process \"{own}\" is of the control chain, whose `priority` and `cpu` stand in [realtime]"
        ));
    }
    Ok(())
}
