//! The flights on which the accuracy of the robot is judged.

use anyhow::Result;
use cable_robot::Robot;
use config::{ControllerSection, EstimatorSection, RobotFile, SystemFile};
use controller::Law;
use estimator::Method;
use motor_box::BoxConfig;
use planner::Mission;
use plant::PlantConfig;

use crate::lockstep::{Flight, Scenario};

/// Where the node hangs at the start, m.
pub const START_M: [f64; 3] = [4.8, 3.0, 0.3];

/// Encoder counts per metre of cable: 1024 counts per turn on an idler where the cable's middle runs at 15 mm.
pub const COUNTS_PER_M: f64 = 10_865.0;

/// One flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// Robot file in `configs/robots`, without its extension.
    pub robot: &'static str,
    /// Mission file in `configs/missions`, without its extension.
    pub mission: &'static str,
    /// Delay and lag of the drives, s.
    pub motor_s: [f64; 2],
}

/// Three and four cables, spiral and polyline, quick and slow motors.
pub fn all() -> Vec<Case> {
    let mut cases = Vec::new();
    for robot in ["lab3", "lab4"] {
        for mission in ["spiral", "polyline"] {
            for motor_s in [[0.030, 0.040], [0.060, 0.100]] {
                cases.push(Case { robot, mission, motor_s });
            }
        }
    }
    cases
}

/// The robot of a robot file in `configs/robots`.
///
/// # Errors
/// If the file is wrong.
pub fn robot(name: &str) -> Result<Robot> {
    let path = format!("{}/../configs/robots/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    Ok(RobotFile::load(std::path::Path::new(&path))?.robot()?)
}

/// A mission of `configs/missions`.
///
/// # Errors
/// If the file is wrong.
pub fn mission(name: &str) -> Result<Mission> {
    let path = format!("{}/../configs/missions/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    Ok(Mission::read(std::path::Path::new(&path))?)
}

impl Case {
    /// The flight, with or without correction for stretch.
    ///
    /// # Errors
    /// If the files are wrong.
    pub fn scenario(&self, stretch: bool) -> Result<Scenario> {
        let robot = robot(self.robot)?;
        let anchors = robot.anchors().iter().map(|a| (*a).into()).collect();
        let mut plant = PlantConfig::new(anchors, START_M);
        plant.start_limits_n = robot.tension_limits_n();
        plant.drive.delay_s = self.motor_s[0];
        plant.drive.lag_s = self.motor_s[1];
        plant.idlers.iter_mut().for_each(|idler| idler.counts_per_m = COUNTS_PER_M);
        let period_s = 0.01;
        let sluggish_s = self.motor_s[0] + self.motor_s[1];
        Ok(Scenario {
            robot,
            plant,
            mission: mission(self.mission)?,
            period_s,
            law: Law::from_section(&ControllerSection::default())?,
            method: Method::from_section(&EstimatorSection::default())?,
            horizon: (2.0 * sluggish_s / period_s).round() as u32 + 3,
            stretch,
            distribution: robot.default_distribution(),
            longest_s: 300.0,
        })
    }
}

/// NIMS-AQ: system file and mission as distributed with the project.
///
/// # Errors
/// If the files are wrong.
pub fn planar() -> Result<Scenario> {
    let configs = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
    let file = SystemFile::load(&configs.join("systems/aq4.toml"))?;
    let robot_file = file.robot_file()?;
    let plant = BoxConfig::from_files(&file, &robot_file, std::path::Path::new("/"))?.plant;
    let mission = Mission::read(&file.planner.missions.join(&file.planner.demo).with_extension("toml"))?;
    Scenario::from_files(&file, robot_file.robot()?, plant, mission)
}

/// Headings of the rows of [`row`].
pub const HEADING: &str = "\
|       |          | motor, ms |            | estimate - setpoint, mm | truth - setpoint, mm | truth - chosen tension, N |           |       |        |
| robot | mission  | delay/lag | correction | rms / max               | rms / max            | rms / max                 | tension N | slack | unsteered |
|-------|----------|-----------|------------|-------------------------|----------------------|---------------------------|-----------|-------|--------|";

/// One flight as a text line.
pub fn row(case: &Case, stretch: bool, flight: &Flight) -> String {
    let mm = |d: crate::lockstep::Deviation| format!("{:5.2} / {:5.2}", d.rms_m * 1e3, d.max_m * 1e3);
    format!(
        "| {:5} | {:8} | {:>4.0}/{:<4.0} | {:10} | {:23} | {:20} | {:25} | {:4.1}-{:4.1} | {:5} | {:6} |",
        case.robot,
        case.mission,
        case.motor_s[0] * 1e3,
        case.motor_s[1] * 1e3,
        if stretch { "stretch" } else { "none" },
        mm(flight.estimate),
        mm(flight.truth),
        format!("{:4.2} / {:4.2}", flight.tension_rms_n, flight.tension_max_n),
        flight.tension_range_n[0],
        flight.tension_range_n[1],
        flight.slack_cycles,
        flight.unsteered,
    )
}
