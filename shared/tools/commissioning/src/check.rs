//! `nims check`: findings about a configuration, each with its remedy.

use crate::bow::Bow;
use crate::config_kind::config_kind;
use crate::swing;
use cable_robot::energy::MotorTable;
use cable_robot::kinematics::inverse_kinematics;
use cable_robot::motor::DriveLoad;
use cable_robot::{Distribution, NodeJacobian, Robot, Vector3, sag, tension};
use command::{Answer, Failure, Output, points};
use config::{CalibrationFile, FileKind, PlannerSection, RobotFile, SystemFile};
use motor_box::{GroundFile, MotorBoxSection};
use planner::mission::Mission;
use planner::plan::{Plan, PlannerConfig};
use sensor::SensorFile;
use serde::Serialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Share of a period that the bus may take; the rest is for the control chain.
const BUS_SHARE: f64 = 0.8;
/// Minimum width of the anchors' layout as a share of its length: below it, lengths that are 5 mm off move the node by
/// more than
/// 100 times as much.
const MIN_WIDTH_SHARE: f64 = 0.01;

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Information.
    Note,
    /// Usable, with less margin than it should have.
    Warning,
    /// Not usable.
    Error,
}

/// A fact about a configuration or a machine that the operator should know.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Severity.
    pub level: Level,
    /// The fact.
    pub finding: String,
    /// Remedy; empty for a note.
    pub cure: String,
}

/// Returns a finding that needs no action.
#[must_use]
pub fn note(finding: String) -> Finding {
    Finding { level: Level::Note, finding, cure: String::new() }
}

/// Returns a finding about insufficient margin.
#[must_use]
pub fn warning(finding: String, cure: &str) -> Finding {
    Finding { level: Level::Warning, finding, cure: cure.to_owned() }
}

/// Returns a finding about something that cannot work.
#[must_use]
pub fn error(finding: String, cure: &str) -> Finding {
    Finding { level: Level::Error, finding, cure: cure.to_owned() }
}

/// `nims check`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Configuration file.
    pub config: PathBuf,
    /// For a mission: the robot or system file to plan it with.
    #[arg(long = "for", value_name = "CONFIG")]
    pub on: Option<PathBuf>,
    /// Only check whether the processes of a system accept its file; used by the supervisor before it starts them.
    #[arg(long, hide = true, conflicts_with = "on")]
    pub accepted: bool,
}

/// Runs `nims check`; fails if a finding is an error.
///
/// # Errors
/// A file that cannot be read or holds values that are not accepted.
pub fn run(args: &Args) -> Answer<Output> {
    if args.accepted {
        can_be_built(&SystemFile::load(&args.config).map_err(Failure::bad)?)?;
        return Ok(Output::new(json!({ "accepted": true }), String::new()));
    }
    let found = check(&args.config, args.on.as_deref())?;
    let errors = errors(&found);
    let failure = (errors > 0).then(|| {
        let file = args.config.display();
        Failure::BadInput(format!("{file} cannot be used: {errors} error(s), listed on stdout"))
    });
    Ok(Output::new(to_json(&found), format!("{}\n{}", to_text(&found), verdict(&found))).failing(failure))
}

/// Returns the number of findings that are errors.
#[must_use]
pub fn errors(findings: &[Finding]) -> usize {
    findings.iter().filter(|finding| finding.level == Level::Error).count()
}

/// Checks a configuration file of any kind; `on` is the robot or system file to plan a mission with.
///
/// # Errors
/// A file that cannot be read or holds values that are not accepted.
pub fn check(path: &Path, on: Option<&Path>) -> Answer<Vec<Finding>> {
    match config_kind(path)? {
        FileKind::Robot => robot(&RobotFile::load(path).map_err(Failure::bad)?),
        FileKind::System => {
            let file = SystemFile::load(path).map_err(Failure::bad)?;
            can_be_built(&file)?;
            let mut findings = robot(&file.robot_file().map_err(Failure::bad)?)?;
            findings.extend(system_file(&file)?);
            Ok(findings)
        }
        FileKind::Sensor => Ok(vec![sensor(&SensorFile::load(path).map_err(Failure::bad)?)]),
        FileKind::Ground => Ok(vec![ground(&GroundFile::load(path).map_err(Failure::bad)?)]),
        FileKind::Mission => {
            let mission = Mission::read(path).map_err(Failure::bad)?;
            let Some(on) = on else {
                let legs = mission.leg.len();
                return Ok(vec![note(format!(
                    "mission \"{}\" has {legs} legs; with --for SYSTEM.toml its feasibility is checked too",
                    mission.name
                ))]);
            };
            Ok(vec![match config_kind(on)? {
                FileKind::System => {
                    let file = SystemFile::load(on).map_err(Failure::bad)?;
                    let robot = file.robot_file().map_err(Failure::bad)?;
                    let start = virtual_start_m(&file, &robot)?;
                    let distribution = file.controller.distribution_for(&robot.robot().map_err(Failure::bad)?);
                    mission_finding(&mission, &robot, &file.planner, distribution, start)
                }
                _ => {
                    let robot = RobotFile::load(on).map_err(Failure::bad)?;
                    let distribution = robot.robot().map_err(Failure::bad)?.default_distribution();
                    mission_finding(&mission, &robot, &PlannerSection::default(), distribution, None)
                }
            }?])
        }
    }
}

/// Builds the configuration of each process from the files of a system, so that their own checks run before anything is
/// started.
///
/// # Errors
/// The first error of a process.
pub fn can_be_built(file: &SystemFile) -> Answer {
    let robot = file.robot_file().map_err(Failure::bad)?;
    motor_io::CoreConfig::from_files(file, &robot).map_err(Failure::bad)?;
    MotorBoxSection::from_file(file, &robot).map_err(Failure::bad)?;
    chain_can_be_built(file, &robot)
}

/// Builds the configurations of controller and estimator only.
///
/// # Errors
/// Which key is wrong and what is accepted.
pub fn chain_can_be_built(file: &SystemFile, robot: &RobotFile) -> Answer {
    controller::ControllerConfig::from_files(file, robot, 1)
        .map_err(|error| Failure::BadInput(format!("[controller] {error}")))?;
    let parts = robot.robot().map_err(Failure::bad)?;
    estimator::EstimatorConfig::from_section(&file.estimator, parts, 1)
        .map_err(|error| Failure::BadInput(format!("[estimator] {error}")))?;
    Ok(())
}

/// Returns the findings as JSON.
#[must_use]
pub fn to_json(findings: &[Finding]) -> Value {
    json!({ "usable": usable(findings), "findings": findings })
}

/// Returns the findings as text, one line each.
#[must_use]
pub fn to_text(findings: &[Finding]) -> String {
    let lines: Vec<String> = findings
        .iter()
        .map(|finding| match (finding.level, finding.cure.as_str()) {
            (Level::Note, _) => format!("note: {}", finding.finding),
            (Level::Warning, cure) => format!("warning: {}; {cure}", finding.finding),
            (Level::Error, cure) => format!("error: {}; {cure}", finding.finding),
        })
        .collect();
    lines.join("\n")
}

/// Returns the last sentence of a check.
fn verdict(findings: &[Finding]) -> String {
    let warnings = findings.iter().filter(|finding| finding.level == Level::Warning).count();
    match (errors(findings), warnings) {
        (0, 0) => "fine: no errors, no warnings".to_owned(),
        (0, warnings) => format!("usable: no errors, {warnings} warning(s)"),
        (errors, warnings) => format!("not usable: {errors} error(s), {warnings} warning(s)"),
    }
}

/// Returns whether none of the findings is an error.
#[must_use]
pub fn usable(findings: &[Finding]) -> bool {
    findings.iter().all(|finding| finding.level != Level::Error)
}

/// Describes the values that a sensor file defines.
fn sensor(file: &SensorFile) -> Finding {
    let (quantities, units) = file.quantities_and_units();
    let values: Vec<String> =
        quantities.iter().zip(&units).map(|(quantity, unit)| format!("{quantity} in {unit}")).collect();
    note(format!(
        "a sensor at {}, {} baud, which measures {}; plugged in as NAME, it publishes sensor/NAME",
        file.port,
        file.baud,
        values.join(", ")
    ))
}

/// Describes a ground file.
fn ground(file: &GroundFile) -> Finding {
    let (cylinders, prisms) = (file.cylinder.len(), file.prism.len());
    note(format!("a ground with {cylinders} cylinders and {prisms} prisms on a plane at {} m", file.ground_m))
}

/// Returns the default position of the node: below the centre of the anchors, at a quarter of the height of the lowest
/// anchor above the ground; for a node without net weight, the centre of the anchors.
fn middle(robot: &Robot) -> Vector3<f64> {
    let anchors = robot.anchors();
    let mut centre = anchors.iter().sum::<Vector3<f64>>() / anchors.len() as f64;
    let lowest = anchors.iter().map(|anchor| anchor.z).fold(f64::INFINITY, f64::min);
    if robot.net_weight_n() == 0.0 {
        return centre;
    }
    centre.z = robot.ground_m() + 0.25 * (lowest - robot.ground_m());
    centre
}

/// Warns of nearly collinear anchors, which leave one coordinate of the node poorly determined.
fn collinear_anchors(robot: &Robot) -> Option<Finding> {
    let [first, rest @ ..] = &robot.anchors()[..] else { return None };
    let along = rest.iter().map(|p| p - first).max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?;
    let beside = rest.iter().map(|p| along.cross(&(p - first)).norm() / along.norm_squared()).fold(0.0, f64::max);
    (!robot.is_planar() && beside < MIN_WIDTH_SHARE).then(|| {
        let (off_m, long_m) = (beside * along.norm(), along.norm());
        warning(
            format!("the anchors lie within {off_m:.3} m of one straight line of {long_m:.1} m, so the position of the node across it is poorly determined"),
            "check anchors_m, or put one anchor farther from that line",
        )
    })
}

/// The stretch of the cable that stretches most while the node hangs in the middle.
fn stretch_finding(robot: &Robot, at: &Vector3<f64>, distribution: Distribution, stiffness_n: f64) -> Finding {
    let lengths_m = inverse_kinematics(robot.anchors(), at);
    let tensions_n = tension::at(robot, at, &Vector3::zeros(), distribution).map(|found| found.tensions_n);
    let most = tensions_n.iter().flat_map(|tensions| tensions.iter()).enumerate().map(|(i, tension_n)| {
        let cable_m = lengths_m[i] + robot.routed_length_m().get(i).copied().unwrap_or(0.0);
        (tension_n * cable_m / stiffness_n, cable_m, i + 1)
    });
    note(match most.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((stretch_m, cable_m, cable)) => {
            let stretch_mm = 1000.0 * stretch_m;
            format!(
                "in the middle cable {cable}, {cable_m:.0} m with its routed part, stretches by {stretch_mm:.0} mm; this is compensated"
            )
        }
        None => "the stretch of the cables is compensated".to_owned(),
    })
}

/// States what the weight of the cables does, and warns where the first order is not enough.
fn weight_finding(robot: &Robot, middle: &Vector3<f64>, distribution: Distribution) -> Option<Finding> {
    let bow = Bow::deepest(robot, middle, distribution)?;
    let text = bow.in_words(robot);
    if bow.sag_share <= sag::SHALLOW {
        return Some(note(text));
    }
    let most = 1.0 / sag::SHALLOW;
    Some(warning(
        format!("{text}, and the first order is enough up to a sag of 1/{most:.0}"),
        "raise the least tension in tension_limits_n, or use lighter cables",
    ))
}

fn robot(file: &RobotFile) -> Answer<Vec<Finding>> {
    let robot = file.robot().map_err(Failure::bad)?;
    let distribution = robot.default_distribution();
    let at = middle(&robot);
    let place = points::in_words(&robot, &at);
    let mut findings = Vec::new();
    match tension::at(&robot, &at, &Vector3::zeros(), distribution) {
        Ok(found) => {
            let list: Vec<String> = found.tensions_n.iter().map(|value| format!("{value:.1}")).collect();
            findings.push(note(format!("at rest in the middle, {place}, the cables carry {} N", list.join(", "))));
            findings.push(sinking_finding(&robot, &at, &found.tensions_n));
            findings.push(ceiling_finding(&robot, &at, distribution));
        }
        Err(why) => findings.push(error(
            format!("the cables cannot hold the node in the middle of the anchors, {place}: {why}"),
            "check the units of anchors_m (metres), node_mass_kg (kilograms) and tension_limits_n (newtons)",
        )),
    }
    findings.extend(swing::modes(&robot, &at, distribution).map(note));
    findings.push(match robot.stiffness_n() {
        Some(stiffness_n) => stretch_finding(&robot, &at, distribution, stiffness_n),
        None => warning(
            "the cables are treated as rigid: their stretch, some centimetres, becomes a position error".to_owned(),
            "give stiffness_n in [lines]; braided polyethylene of 0.33 mm has about 6000 N",
        ),
    });
    findings.extend(weight_finding(&robot, &at, distribution));
    findings.extend(collinear_anchors(&robot));
    findings.extend(file.calibration.as_ref().map(calibration_finding));
    let tables = file.motor_tables.len();
    for cable in 0..tables {
        let whose =
            if tables > 1 { format!("the motor table of cable {}", cable + 1) } else { "the motor table".to_owned() };
        findings.extend(robot.motor_table(cable).map(|table| motor_table_finding(&robot, table, &whose)));
    }
    findings.extend(motor_finding(&robot));
    Ok(findings)
}

/// Warns of a node speed that the motors do not reach at the highest tension.
fn motor_finding(robot: &Robot) -> Option<Finding> {
    let limits = robot.drive_limits();
    let loads = (0..robot.cable_count())
        .map(|cable| robot.drive_load(cable, robot.tension_limits_n()[1], robot.speed_limit_m_s()));
    let load = loads.max_by(|a, b| a.current_a.total_cmp(&b.current_a))?;
    let excess = match load {
        DriveLoad { current_a, .. } if !limits.allow_current(&load) => {
            format!("takes {current_a:.1} A, above current_limit_a = {} A", limits.current_a)
        }
        DriveLoad { voltage_v, .. } if !limits.allow_voltage(&load) => {
            format!(
                "takes {voltage_v:.1} V, and supply_min_v less the reserve of the drive is {:.1} V",
                limits.voltage_v
            )
        }
        _ => return None,
    };
    Some(warning(
        format!("reeling in at {} m/s under {} N {excess}", load.reel_in_m_s, load.tension_n),
        "lower tension_limits_n or speed_limit_m_s, or fit larger motors; slower and lighter moves are not affected",
    ))
}

/// Describes the calibration of the anchors and its accuracy.
fn calibration_finding(file: &CalibrationFile) -> Finding {
    let (anchor, axis, std_m) = file.worst();
    let mut sentence = format!(
        "the anchors come from the calibration of {} ({}); the least certain coordinate is {axis} of anchor {anchor}, ±{std_m:.3} m",
        file.date, file.method
    );
    if file.scale_std > 0.0 {
        let then = match file.true_counts_per_m() {
            Some(counts) => format!("measured by the robot, so it uses {counts:.1?} counts per metre instead"),
            None => "not measured by the robot (no counts_per_m), so the encoder scale is unchanged".to_owned(),
        };
        sentence.push_str(&format!(
            "; the measured lengths are {:.4} ±{:.4} times the true ones and were {then}",
            file.scale, file.scale_std
        ));
    }
    if file.verdict.starts_with("poor") {
        return warning(sentence, "add points near the corners below the anchors and calibrate again before a mission");
    }
    note(sentence)
}

/// Compares the range of the motor table with the limits of the robot.
fn motor_table_finding(robot: &Robot, table: &MotorTable, whose: &str) -> Finding {
    let ends = |axis: &[f64]| [axis[0], axis[axis.len() - 1]];
    let ([slowest, fastest], [loosest, tightest]) = (ends(table.speeds_m_s()), ends(table.tensions_n()));
    let sentence = format!(
        "{whose} covers {slowest} to {fastest} m/s and {loosest} to {tightest} N; the energy of a move beyond this range is unknown"
    );
    let limit = robot.speed_limit_m_s();
    if slowest > -limit || fastest < limit {
        let cure = "record runs that raise and lower loads at speed_limit_m_s; slower moves are not affected";
        return warning(sentence, cure);
    }
    note(sentence)
}

/// Computes how fast the node sinks when the drives stop powering the motors: their leads are shorted, so only gear
/// friction and
/// the motors' own braking hold the load.
fn sinking_finding(robot: &Robot, at: &Vector3<f64>, tensions_n: &[f64]) -> Finding {
    let pays_out: Vec<f64> = tensions_n.iter().map(|tension| unpowered_m_s(robot, *tension)).collect();
    let fastest = pays_out.iter().fold(0.0_f64, |most, speed| most.max(*speed));
    if fastest == 0.0 {
        let motor = robot.motor();
        let most = robot.tension_limits_n()[1];
        let beyond = match unpowered_m_s(robot, most) {
            0.0 => "at any load".to_owned(),
            speed => {
                let holds = motor.coulomb_n / (1.0 - motor.gear_friction);
                format!("up to {holds:.1} N per cable; at {most} N a cable would unwind at {:.1} mm/s", 1000.0 * speed)
            }
        };
        return note(format!("unpowered, the gears hold the node: sinking speed 0 mm/s ({beyond})"));
    }
    if robot.net_weight_n() == 0.0 {
        return note(format!(
            "unpowered, a cable unwinds at {:.1} mm/s until it is slack; the node does not sink",
            1000.0 * fastest
        ));
    }
    let node =
        NodeJacobian::at(robot.anchors(), at).map_or(fastest, |jacobian| jacobian.node_velocity(&pays_out).norm());
    warning(
        format!(
            "unpowered, a cable unwinds at {:.1} mm/s and the node sinks at {:.1} mm/s",
            1000.0 * fastest,
            1000.0 * node
        ),
        "support the node before `disarm`, before switching off and after a watchdog stop",
    )
}

/// Returns the speed at which a cable unwinds from a motor with shorted leads, m/s: the load less friction, divided by
/// the motor's braking.
fn unpowered_m_s(robot: &Robot, tension_n: f64) -> f64 {
    let motor = robot.motor();
    let drives = tension_n - (motor.gear_friction * tension_n + motor.coulomb_n);
    let braking = motor.viscous_n_s_m + motor.force_constant_n_a.powi(2) / motor.resistance_ohm;
    drives.max(0.0) / braking
}

/// Finds the greatest feasible height of the node above `from`.
fn ceiling_finding(robot: &Robot, from: &Vector3<f64>, distribution: Distribution) -> Finding {
    let mut at = *from;
    while tension::at(robot, &at, &Vector3::zeros(), distribution).is_ok() {
        at.z += 0.01;
    }
    note(format!("in the middle the node can rise to {:.2} m within tension_limits_n", at.z - 0.01))
}

fn system_file(file: &SystemFile) -> Answer<Vec<Finding>> {
    let robot = file.robot_file().map_err(Failure::bad)?;
    let mut findings = Vec::new();
    if let Ok(robot) = robot.robot() {
        findings.extend(swing::pause(file, &robot, &middle(&robot)).map(|(sentence, cure)| warning(sentence, &cure)));
    }
    let (period, watchdog) = (file.period_s(), file.motor_io.watchdog_s);
    let (cable, node) = (robot.cable_speed_limit_m_s(), robot.robot.speed_limit_m_s);
    findings.push(note(format!(
        "if motor-io dies, the drives stop after {watchdog} s: at most {:.0} mm of cable at the robot's {node} m/s ({:.0} mm at the cable limit of {cable} m/s)",
        1000.0 * watchdog * node,
        1000.0 * watchdog * cable
    )));
    for (index, port) in file.motor_io.ports.iter().enumerate() {
        let seconds = port.protocol.family().cycle_s(port.units.len(), port.baud);
        let sentence =
            format!("port {} needs {:.1} ms of each cycle of {:.1} ms", index + 1, 1000.0 * seconds, 1000.0 * period);
        let cure = "lower rate_hz, raise baud (on the drives too), or connect each drive unit to a separate port";
        findings.push(if seconds > BUS_SHARE * period { error(sentence, cure) } else { note(sentence) });
        if port.path.contains("{domain}") {
            if file.motor_box.is_none() {
                findings.push(error(
                    format!("port {} is on the virtual motor box, but the file has no [motor_box]", index + 1),
                    "give the path of the real device, or add [motor_box]",
                ));
            }
        } else if !Path::new(&port.path).exists() {
            findings.push(error(
                format!("port {}: {} does not exist", index + 1, port.path),
                "plug the drives in; stable names are in /dev/serial/by-id",
            ));
        }
    }
    findings.extend(
        MotorBoxSection::from_file(file, &robot).map_err(Failure::bad)?.and_then(|drives| horizon(file, &drives)),
    );
    if file.estimator.stretch != file.controller.stretch {
        findings.push(warning(
            "`stretch` differs between [estimator] and [controller]".to_owned(),
            "set both to the same value, otherwise one compensates a stretch that the other ignores",
        ));
    }
    Ok(findings)
}

/// Returns the position at which a virtual node starts, m; `None`: the drives are real.
///
/// # Errors
/// `[motor_box]` is not accepted.
pub fn virtual_start_m(file: &SystemFile, robot: &RobotFile) -> Answer<Option<[f64; 3]>> {
    let section = MotorBoxSection::from_file(file, robot).map_err(Failure::bad)?;
    Ok(section.map(|section| section.start_m.position_m))
}

/// Warns of a horizon of the paper's law that does not suit the drives, whose delay and lag are known if they are
/// virtual.
pub fn horizon(file: &SystemFile, drives: &MotorBoxSection) -> Option<Finding> {
    let best = (2.0 * (drives.delay_s + drives.lag_s) / file.period_s() + 3.0).round() as usize;
    let horizon = file.controller.horizon_cycles;
    (horizon < best / 2 || horizon > 2 * best).then(|| {
        warning(
            format!("controller.horizon_cycles = {horizon} is far from 2 (delay + lag) / period + 3 = {best}"),
            "a short horizon oscillates, a long one lags: set it near that number",
        )
    })
}

/// Size of a planned mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flight {
    /// Number of segments.
    pub segments: usize,
    /// Length of the path, m.
    pub length_m: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// Energy lost in the motors by their model, J; `None` if a measured motor table does not cover the mission.
    pub energy_j: Option<f64>,
}

impl Flight {
    /// Returns one line of text.
    #[must_use]
    pub fn line(&self) -> String {
        let energy = self.energy_j.map_or(String::new(), |joules| format!(", about {joules:.0} J in the motors"));
        format!("{} segments, {:.2} m, {:.1} s{energy}", self.segments, self.length_m, self.duration_s)
    }
}

/// Plans a whole mission from a starting point with the planner's own checks.
///
/// # Errors
/// Where the mission exceeds which limit, and by how much.
pub fn fly(mission: &Mission, file: &SystemFile, from: &[f64; 3]) -> Answer<Flight> {
    let robot = file.robot_file().map_err(Failure::bad)?;
    let distribution = file.controller.distribution_for(&robot.robot().map_err(Failure::bad)?);
    plan(mission, &robot, &file.planner, distribution, from)
}

fn plan(
    mission: &Mission,
    robot: &RobotFile,
    section: &PlannerSection,
    distribution: Distribution,
    from: &[f64; 3],
) -> Answer<Flight> {
    let robot = robot.robot().map_err(Failure::bad)?;
    let config = PlannerConfig {
        robot,
        distribution,
        speed_m_s: section.speed_m_s,
        acceleration_m_s2: section.acceleration_m_s2,
        check_step_m: section.check_step_m,
        swing_limit_m: section.swing_limit_m,
    };
    let plan = Plan::new(mission, &config, Vector3::from(*from), 0.0, 1).map_err(Failure::bad)?;
    Ok(Flight {
        segments: plan.segments.len(),
        length_m: plan.length_m(),
        duration_s: plan.end_s() - plan.start_s(),
        energy_j: plan.energy_j(&config),
    })
}

fn mission_finding(
    mission: &Mission,
    robot: &RobotFile,
    section: &PlannerSection,
    distribution: Distribution,
    start: Option<[f64; 3]>,
) -> Answer<Finding> {
    let checked = robot.robot().map_err(Failure::bad)?;
    let from = match start {
        Some(start) => start,
        None => middle(&checked).into(),
    };
    Ok(match plan(mission, robot, section, distribution, &from) {
        Ok(flight) => note(format!(
            "mission \"{}\" can be flown from {}: {}",
            mission.name,
            points::in_words(&checked, &from.into()),
            flight.line()
        )),
        Err(why) => error(
            format!("mission \"{}\" cannot be flown: {why}", mission.name),
            "move the points that it names, or reduce the speed",
        ),
    })
}
