//! The robot of a run: from the run folder, or from what was kept inside the run file.

use cable_robot::Robot;
use config::RobotFile;
use runlog::Attachment;
use std::path::Path;

/// The robot file of a run, as the supervisor names its copy.
const NAME: &str = "robot.toml";

/// The robot that was flown; `None` where its file is not there, or is of a version that this program does not accept.
pub fn robot_of(run: &Path, inside: &[Attachment]) -> Option<Robot> {
    robot_file_of(run, inside)?.robot().ok()
}

/// The file of the robot that was flown.
pub fn robot_file_of(run: &Path, inside: &[Attachment]) -> Option<RobotFile> {
    let folder = if run.is_dir() { run } else { run.parent()? };
    let beside = RobotFile::load(&folder.join(NAME)).ok();
    beside.or_else(|| unpacked(inside))
}

/// The robot file names others, so all of them are laid out in a folder of their own for as long as they are read.
fn unpacked(inside: &[Attachment]) -> Option<RobotFile> {
    let folder = tempfile::tempdir().ok()?;
    for one in inside {
        // a name with a slash would lead elsewhere
        let name = Path::new(&one.name).file_name()?;
        std::fs::write(folder.path().join(name), &one.data).ok()?;
    }
    RobotFile::load(&folder.path().join(NAME)).ok()
}
