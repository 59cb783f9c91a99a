//! `nims check`: findings about a configuration, each with its remedy.

use crate::config_kind::config_kind;
use crate::finding::{Finding, counted, error, errors, note, to_json, to_text, verdict, warning};
use crate::robot_findings::{middle, robot};
use crate::swing;
use cable_robot::{Distribution, Vector3};
use command::{Answer, Failure, Output, points};
use config::{FileKind, PlannerSection, PortSection, RobotFile, SystemFile};
use motor_box::{GroundFile, MotorBoxSection};
use planner::mission::Mission;
use planner::plan::{Plan, PlannerConfig};
use sensor::SensorFile;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Share of a period that the bus may take; the rest is for the control chain.
const BUS_SHARE: f64 = 0.8;
/// `nims check`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Configuration file.
    pub config: PathBuf,
    /// For a mission: the robot or system file to plan it with.
    #[arg(long = "for", value_name = "CONFIG")]
    pub on: Option<PathBuf>,
    /// For a system file: the robot file to check it with, in place of its own.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["on", "accepted"])]
    pub robot: Option<PathBuf>,
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
    let found = match &args.robot {
        Some(robot) => check_with(&args.config, robot)?,
        None => check(&args.config, args.on.as_deref())?,
    };
    let errors = errors(&found);
    let failure = (errors > 0).then(|| {
        let file = args.config.display();
        Failure::BadInput(format!("{file} cannot be used: {}, listed on stdout", counted(errors, "error")))
    });
    Ok(Output::new(to_json(&found), format!("{}\n{}", to_text(&found), verdict(&found))).failing(failure))
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
            let mut findings = whole(&file)?;
            findings.extend(file_name(path, &file));
            Ok(findings)
        }
        FileKind::Sensor => Ok(vec![sensor(&SensorFile::load(path).map_err(Failure::bad)?)]),
        FileKind::Ground => Ok(vec![ground(&GroundFile::load(path).map_err(Failure::bad)?)]),
        FileKind::Measurements | FileKind::Loads => Err(Failure::BadInput(format!(
            "{} has measurements, which `nims calibrate` and `nims loads` check and evaluate: give one of them this file",
            path.display()
        ))),
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

/// Checks a system file with another robot file than its own.
///
/// # Errors
/// As [`check`]; a file that is no system file.
pub fn check_with(system: &Path, robot: &Path) -> Answer<Vec<Finding>> {
    whole(&SystemFile::load_with(system, Some(robot)).map_err(Failure::bad)?)
}

/// Checks a system with its robot.
fn whole(file: &SystemFile) -> Answer<Vec<Finding>> {
    can_be_built(file)?;
    let mut findings = robot(&file.robot_file().map_err(Failure::bad)?)?;
    findings.extend(system(file)?);
    Ok(findings)
}

/// States how a system file has to be called where a service runs it: [`SystemFile::load`] refuses another name there.
fn file_name(path: &Path, file: &SystemFile) -> Option<Finding> {
    let (stem, name) = (path.file_stem()?.to_string_lossy(), &file.name);
    (stem != name.as_str()).then(|| {
        note(format!(
            "the file is {stem}.toml and its `name` is \"{name}\"; for a service both have to be the same: {}/{name}.toml for nims@{name}",
            config::OF_SERVICES
        ))
    })
}

/// States whether delay and lag of the drives are those of the identified file, or of the system file.
fn drive_finding(file: &SystemFile, robot: &RobotFile) -> Option<Finding> {
    let [delay_s, lag_s] = robot.identified.as_ref()?.drive_lag_s()?;
    let (used, filter_s) = (file.controller.drive_lag_s?, file.estimator.drive_lag_s);
    let of = |is_identified: bool| if is_identified { "the identified file" } else { "this system file" };
    let controller = of(used == [delay_s, lag_s]);
    let estimator = of(filter_s.total_cmp(&(delay_s + lag_s)).is_eq());
    Some(note(format!(
        "drive_lag_s = {used:?} of [controller] is that of {controller}, and {filter_s} of [estimator] that of {estimator}"
    )))
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

/// Checks what a system asks of its drives and its control chain.
///
/// # Errors
/// A robot file that cannot be used.
pub fn system(file: &SystemFile) -> Answer<Vec<Finding>> {
    let robot = file.robot_file().map_err(Failure::bad)?;
    let mut findings = Vec::new();
    if let Ok(robot) = robot.robot() {
        findings.extend(swing::pause(file, &robot, &middle(&robot)).map(|(sentence, cure)| warning(sentence, &cure)));
    }
    findings.extend(drive_finding(file, &robot));
    let (period, watchdog) = (file.period_s(), file.motor_io.watchdog_s);
    let (cable, node) = (robot.cable_speed_limit_m_s(), robot.robot.speed_limit_m_s);
    findings.push(note(format!(
        "if motor-io dies, the drives stop after {watchdog} s: at most {:.0} mm of cable at the robot's {node} m/s ({:.0} mm at the cable limit of {cable} m/s)",
        1000.0 * watchdog * node,
        1000.0 * watchdog * cable
    )));
    findings.push(note(format!(
        "places for {} processes take {:.2} MB of shared memory; each process that runs takes more for its channels",
        file.bus.processes,
        bus::places_bytes(file.bus.processes) as f64 * 1e-6
    )));
    findings.extend(file.excess().map(|excess| warning(excess.to_string(), &excess.cure())));
    let fastest_hz = highest_rate_hz(file);
    for (index, port) in file.motor_io.ports.iter().enumerate() {
        let seconds = cycle_s(port);
        let sentence =
            format!("port {} needs {:.1} ms of each cycle of {:.1} ms", index + 1, 1000.0 * seconds, 1000.0 * period);
        let cure = format!(
            "lower rate_hz to at most {fastest_hz:.0}, raise baud (on the drives too), or connect each drive unit to a separate port"
        );
        findings.push(if seconds > BUS_SHARE * period { error(sentence, &cure) } else { note(sentence) });
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

/// Time of one cycle on a port, s.
fn cycle_s(port: &PortSection) -> f64 {
    let family = port.protocol.family();
    let second = port.units.iter().any(|unit| unit.second_encoder.is_some());
    let family = if second { family.with_second_encoders() } else { family };
    family.cycle_s(port.units.len(), port.baud, port.wire)
}

/// Highest whole rate that fits on every port, Hz.
#[must_use]
pub fn highest_rate_hz(file: &SystemFile) -> f64 {
    let longest_s = file.motor_io.ports.iter().map(cycle_s).fold(0.0, f64::max);
    (BUS_SHARE / longest_s).floor()
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
        format!("{}, {:.2} m, {:.1} s{energy}", counted(self.segments, "segment"), self.length_m, self.duration_s)
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
    // As if the lengths were set at the start.
    let robot = robot.robot().map_err(Failure::bad)?.with_lengths_set_at(Some(&Vector3::from(*from)));
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
