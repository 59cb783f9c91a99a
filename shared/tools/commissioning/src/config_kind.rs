//! Kinds of configuration files, and the robot that a robot file or a system file describes.

use cable_robot::Robot;
use command::{Answer, Failure};
use config::{FileKind, PlannerSection, RobotFile, SystemFile, toml_file};
use std::path::Path;

/// Determines the kind of a configuration file from the keys that only this kind has.
pub(crate) fn config_kind(path: &Path) -> Answer<FileKind> {
    let table: toml::Table = toml_file::load(path).map_err(Failure::bad)?;
    FileKind::from_table(&table).ok_or_else(|| {
        Failure::BadInput(format!(
            "{} is not a configuration file of a known kind: a robot file has [robot], a system file [motor_io], a mission file [[leg]], a sensor file `port`, a ground file [[cylinder]] or [[prism]]",
            path.display()
        ))
    })
}

/// Loads the robot of a robot file, or of a system file, which also states the voltage of its drives.
///
/// # Errors
/// A file that cannot be used.
pub(crate) fn robot(path: &Path) -> Answer<Robot> {
    let file = match config_kind(path)? {
        FileKind::System => SystemFile::load(path).and_then(|file| file.robot_file()),
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
        FileKind::System => Ok(SystemFile::load(path).map_err(Failure::bad)?.planner.swing_limit_m),
        _ => Ok(PlannerSection::default().swing_limit_m),
    }
}
