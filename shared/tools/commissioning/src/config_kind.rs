//! Kinds of configuration files, and the robot that a robot file or a system file describes.

use cable_robot::{Distribution, Robot};
use command::{Answer, Failure};
use config::toml_file::Source;
use config::{FileKind, PlannerSection, RobotFile, SystemFile, toml_file};
use std::path::Path;

/// Determines the kind of a configuration file from the keys that only this kind has.
pub(crate) fn config_kind(path: &Path) -> Answer<FileKind> {
    let table: toml::Table = toml_file::load(path).map_err(Failure::bad)?;
    FileKind::from_table(&table).ok_or_else(|| {
        Failure::BadInput(format!(
            "{} is not a configuration file of a known kind: a robot file has [robot], a system file [motor_io], a mission file [[leg]], a sensor file `port`, a ground file [[cylinder]] or [[prism]], measurements [[side]], [[range]] or [[sinking]]",
            path.display()
        ))
    })
}

/// Loads a file of measurements of this kind.
///
/// # Errors
/// A file that cannot be used, or one of another kind.
pub(crate) fn measurements<T: serde::de::DeserializeOwned>(kind: FileKind, path: &Path) -> Answer<T> {
    let source = Source::read(path).map_err(Failure::bad)?;
    kind.expect(&source).and_then(|()| source.parse()).map_err(Failure::bad)
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

/// What decides which moves the planner accepts: the robot, `[planner]`, and how the tensions are distributed.
pub(crate) struct Planned {
    pub robot: Robot,
    pub section: PlannerSection,
    pub distribution: Distribution,
}

/// Loads what decides which moves the planner accepts from a system file; for a robot file, with the default values of
/// a system file.
///
/// # Errors
/// A file that cannot be used.
pub(crate) fn planned(path: &Path) -> Answer<Planned> {
    let robot = robot(path)?;
    if config_kind(path)? != FileKind::System {
        return Ok(Planned { robot, section: PlannerSection::default(), distribution: robot.default_distribution() });
    }
    let file = SystemFile::load(path).map_err(Failure::bad)?;
    let distribution = file.controller.distribution_for(&robot);
    Ok(Planned { robot, section: file.planner, distribution })
}
