//! The robot of a run, from the run folder or from the attachments of the run file.

use cable_robot::Robot;
use config::RobotFile;
use runlog::Attachment;
use std::path::Path;

/// Name of the robot file's copy in a run.
const NAME: &str = "robot.toml";

/// Returns the robot of a run; `None` if its file is missing or not accepted by this version.
pub fn robot_of(run: &Path, inside: &[Attachment]) -> Option<Robot> {
    load_robot_file(run, inside)?.robot().ok()
}

/// Returns the robot file of a run.
pub fn load_robot_file(run: &Path, inside: &[Attachment]) -> Option<RobotFile> {
    let folder = if run.is_dir() { run } else { run.parent()? };
    let beside = RobotFile::load(&folder.join(NAME)).ok();
    beside.or_else(|| unpacked(inside))
}

/// Extracts all attachments to a temporary folder, because the robot file refers to other files.
fn unpacked(inside: &[Attachment]) -> Option<RobotFile> {
    let folder = tempfile::tempdir().ok()?;
    for one in inside {
        // A name with a slash could lead out of the folder.
        let name = Path::new(&one.name).file_name()?;
        std::fs::write(folder.path().join(name), &one.data).ok()?;
    }
    RobotFile::load(&folder.path().join(NAME)).ok()
}
