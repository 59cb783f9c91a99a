//! The robot of a run, from the run folder or from the attachments of the run file.

use cable_robot::Robot;
use command::{Answer, Failure};
use config::RobotFile;
use runlog::{Attachment, system_file_text};
use std::path::Path;

/// Name of the robot file's copy in a run.
const NAME: &str = "robot.toml";

/// Returns the robot of a run; `None` if its file is missing or not accepted by this version.
///
/// # Errors
/// There is no folder for temporary files.
pub fn robot_of(run: &Path, inside: &[Attachment]) -> Answer<Option<Robot>> {
    Ok(load_robot_file(run, inside)?.and_then(|file| file.robot().ok()))
}

/// Returns the robot file of a run; `None` if it is missing or not accepted by this version.
///
/// # Errors
/// There is no folder for temporary files.
pub fn load_robot_file(run: &Path, inside: &[Attachment]) -> Answer<Option<RobotFile>> {
    let folder = if run.is_dir() { Some(run) } else { run.parent() };
    match folder.and_then(|folder| RobotFile::load(&folder.join(NAME)).ok()) {
        Some(beside) => Ok(Some(beside)),
        None => unpacked(inside),
    }
}

/// Returns the name of the world in which the truth of a virtual run lies; `None` for real hardware, or without the
/// system file of the run.
pub fn world_of(run: &Path, inside: &[Attachment]) -> Option<String> {
    let system: toml::Table = system_file_text(run, inside)?.parse().ok()?;
    let world = match system.get("motor_box")?.as_table()?.get("truth") {
        None => "the robot's own model",
        Some(truth) => truth.get("name").and_then(toml::Value::as_str).unwrap_or("a world without a name"),
    };
    Some(world.to_owned())
}

/// Extracts all attachments to a temporary folder, because the robot file refers to other files.
fn unpacked(inside: &[Attachment]) -> Answer<Option<RobotFile>> {
    if inside.is_empty() {
        return Ok(None);
    }
    let folder = command::temporary_folder()?;
    for one in inside {
        // A name with a slash could lead out of the folder.
        let Some(name) = Path::new(&one.name).file_name() else { return Ok(None) };
        std::fs::write(folder.path().join(name), &one.data).map_err(Failure::not_now)?;
    }
    Ok(RobotFile::load(&folder.path().join(NAME)).ok())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_world_of_a_run_is_named() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(world_of(folder.path(), &[]), None);
        for (text, world) in [
            ("name = \"real\"", None),
            ("[motor_box]", Some("the robot's own model")),
            ("[motor_box.truth]\nslip = 0.1", Some("a world without a name")),
            ("[motor_box.truth]\nname = \"seed 3, spread 1\"", Some("seed 3, spread 1")),
        ] {
            std::fs::write(folder.path().join(runlog::SYSTEM_FILE), text).unwrap();
            assert_eq!(world_of(folder.path(), &[]).as_deref(), world, "{text}");
        }
    }
}
