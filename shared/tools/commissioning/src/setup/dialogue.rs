//! The dialogue of the measurements with a known weight, and their file on the disk.

use super::capture::{self, MotionWatch};
use super::stored::Stored;
use super::terminal::{Terminal, print_message};
use crate::loads;
use command::{Answer, Failure};
use config::{FileKind, file};
use serde_json::Value;
use site_calibration::loads::{LoadsFile, LoadsRobot, file_text};
use site_calibration::setup::guide::{NextStep, refused, sentence};
use site_calibration::setup::loads::LoadsGuide;
use std::path::{Path, PathBuf};

/// How the measurements with a weight ended.
pub enum LoadsEnd {
    /// Skipped, or finished before.
    Skipped,
    /// With this result, as JSON and as text.
    Done(Value, String),
}

/// The file of the measurements with a weight of the site in `measurements`.
pub fn file_name(measurements: &Path) -> PathBuf {
    let stem = measurements.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    measurements.with_file_name(format!("{stem}-loads.toml"))
}

/// Whether a dialogue about a weight was begun and is not finished.
pub fn is_open(measurements: &Path) -> bool {
    let path = file_name(measurements);
    let file = file::read_text_if_there(&path).ok().flatten();
    file.and_then(|text| config::toml_file::parse::<LoadsFile>(&text, &path).ok())
        .is_some_and(|file| file.setup.is_some())
}

/// Asks until the measurements are complete or skipped, and writes what is determined into the robot file.
///
/// # Errors
/// A file that cannot be continued or written, or input that ends early; saved answers are kept.
pub fn run(measurements: &Path, terminal: &mut Terminal<'_>) -> Answer<LoadsEnd> {
    let path = file_name(measurements);
    let mut stored = Stored::open(&path)?;
    let there: Option<LoadsFile> = stored.file(FileKind::Loads)?;
    if there.as_ref().is_some_and(|file| file.setup.is_none()) {
        print_message(&format!("`nims loads {}` reads the measurements with a known weight.", path.display()));
        return Ok(LoadsEnd::Skipped);
    }
    let wrong = |why: String| Failure::bad(format!("{}: {why}", path.display()));
    let folder = file::folder_of(&path);
    let named = there.as_ref().map(|file| &file.robot).filter(|robot| !robot.as_os_str().is_empty());
    let robot = named.map(|robot| loads::robot(&folder.join(robot))).transpose().map_err(wrong)?;
    let mut guide = LoadsGuide::new(there, robot).map_err(wrong)?;
    let left = || {
        let site = measurements.display();
        Failure::NotNow(format!("not finished: all answers are saved; `nims setup {site}` continues"))
    };
    loop {
        let Some(line) = terminal.ask(&guide.question())? else {
            return if guide.is_skipped() { Ok(LoadsEnd::Skipped) } else { Err(left()) };
        };
        let reply = if guide.takes_capture(&line) {
            match capture::place(terminal.robot) {
                Ok(position_m) => guide.capture(position_m),
                Err(failure) => {
                    print_message(&format!("{}.", failure.to_string().trim_end_matches('.')));
                    continue;
                }
            }
        } else if guide.takes_watch(&line) {
            match watch(terminal, &guide) {
                Ok(weighing) => guide.watched(&weighing),
                Err(failure) => {
                    print_message(&format!("{}.", failure.to_string().trim_end_matches('.')));
                    continue;
                }
            }
        } else if guide.takes_robot(&line) {
            match robot_of(line.trim(), folder) {
                Ok((path, robot)) => guide.take_robot(path, robot),
                Err(why) => refused(sentence(&why)),
            }
        } else {
            guide.answer(&line)
        };
        if reply.changed {
            stored.save(file_text(guide.file(), &name_of(&path)).map_err(|error| wrong(error.to_string()))?)?;
        }
        if !reply.message.is_empty() {
            print_message(&reply.message);
        }
        match reply.next_step {
            NextStep::Ask => {}
            NextStep::Leave => return Err(left()),
            NextStep::Finish if guide.is_skipped() => return Ok(LoadsEnd::Skipped),
            NextStep::Finish => {
                let done = LoadsFile { setup: None, ..guide.file().clone() };
                stored.save(file_text(&done, &name_of(&path)).map_err(|error| wrong(error.to_string()))?)?;
                let output = loads::run(&loads::Args { measurements: path, write: true })?;
                return Ok(LoadsEnd::Done(output.value, output.words));
            }
        }
    }
}

/// The robot file that was typed: a path is relative to the folder of the measurements, or to the present one.
fn robot_of(typed: &str, folder: &Path) -> Result<(PathBuf, LoadsRobot), String> {
    let typed = PathBuf::from(typed);
    let (path, kept) = if folder.join(&typed).is_file() {
        (folder.join(&typed), typed)
    } else {
        let whole =
            typed.canonicalize().map_err(|why| format!("there is no robot file {} ({why})", typed.display()))?;
        (whole.clone(), whole)
    };
    Ok((kept, loads::robot(&path)?))
}

/// Takes the currents of the running robot while it goes up and down, until a line is typed.
fn watch(terminal: &mut Terminal<'_>, guide: &LoadsGuide) -> Answer<calibration::Weighing> {
    let mut watch = MotionWatch::begin(terminal.robot)?;
    print_message("Let the node go up and down by 0.4 m at one speed, some times (nims goto). Enter ends the motion.");
    let mut failed = None;
    terminal.until_line(&mut || {
        failed = watch.poll().err();
        failed.is_some()
    })?;
    match failed {
        Some(failure) => Err(failure),
        None => watch.weighing(guide.motion_kg()).map_err(Failure::NotNow),
    }
}

/// The name of a file, without its folder.
pub(super) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
