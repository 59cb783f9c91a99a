//! Kinds of configuration files, and the robot that a robot file or a system file describes.

use cable_robot::Robot;
use command::{Answer, Failure};
use config::{PlannerSection, RobotFile, SystemFile, toml_file};
use std::path::Path;

/// Kind of a configuration file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ConfigKind {
    /// A robot file.
    Robot,
    /// A system file.
    System,
    /// A mission file.
    Mission,
    /// A sensor file.
    Sensor,
    /// A ground file.
    Ground,
}

/// Determines the kind of a configuration file from the keys that only this kind has.
pub(crate) fn config_kind(path: &Path) -> Answer<ConfigKind> {
    let table: toml::Table = toml_file::load(path).map_err(Failure::bad)?;
    if table.contains_key("leg") {
        Ok(ConfigKind::Mission)
    } else if table.contains_key("motor_io") || table.get("robot").is_some_and(toml::Value::is_str) {
        Ok(ConfigKind::System)
    } else if table.contains_key("robot") {
        Ok(ConfigKind::Robot)
    } else if table.contains_key("port") {
        Ok(ConfigKind::Sensor)
    } else if ["ground_m", "cylinder", "prism"].iter().any(|key| table.contains_key(*key)) {
        Ok(ConfigKind::Ground)
    } else {
        Err(Failure::BadInput(format!(
            "{} is not a configuration file of a known kind: a robot file has [robot], a system file [motor_io], a mission file [[leg]], a sensor file `port`, a ground file [[cylinder]] or [[prism]]",
            path.display()
        )))
    }
}

/// Loads the robot of a robot file, or of a system file, which also states the voltage of its drives.
///
/// # Errors
/// A file that cannot be used.
pub(crate) fn robot(path: &Path) -> Answer<Robot> {
    let file = match config_kind(path)? {
        ConfigKind::System => SystemFile::load(path).and_then(|file| file.robot_file()),
        _ => RobotFile::load(path),
    };
    file.map_err(Failure::bad)?.robot().map_err(Failure::bad)
}

/// Returns the swing above which the planner shapes a move, m: that of a system file, or the default.
///
/// # Errors
/// A file that cannot be used.
pub(crate) fn swing_limit_m(path: &Path) -> Answer<f64> {
    match config_kind(path)? {
        ConfigKind::System => Ok(SystemFile::load(path).map_err(Failure::bad)?.planner.swing_limit_m),
        _ => Ok(PlannerSection::default().swing_limit_m),
    }
}
