//! `nims setup`: a guided field calibration for beginners, one question at a time, and after it the measurements with a
//! known weight.
//!
//! Invariants:
//! * The files of measurements are the whole state: an answer is on the disk before the next question, and the same
//!   command continues from it.
//! * It causes no motion, and needs a running robot only for `capture`, which takes the lengths that it shows, for
//!   `touch`, which takes those of a touch-down and stops the motion there, and for `watch`, which takes currents.

mod capture;
mod dialogue;
mod input;
mod stored;
mod terminal;

#[cfg(test)]
mod tests;

use crate::calibrate;
use client::Place;
use command::{Answer, Failure, Output};
use config::FileKind;

use capture::{Seen, TouchDownWatch};
use dialogue::LoadsEnd;
use input::LineReader;
use serde_json::json;
use site_calibration::setup::captured::CapturedLengths;
use site_calibration::setup::file_text;
use site_calibration::setup::guide::{Guide, NextStep};
use std::io::{self, IsTerminal};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use stored::Stored;
use terminal::{Terminal, print_message};

/// `nims setup`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Measurements file to create or continue.
    pub measurements: PathBuf,
    /// New file for the calibration; default: SITE-calibration.toml in the folder of the measurements.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Number of default names that are tried for the calibrations of a site.
const NAMES: usize = 1000;

/// Asks until the measurements are complete, then writes the calibration, and then the same with a known weight.
/// Returns the JSON of `nims calibrate`, with that of `nims loads`, and the next steps as text. `robot`: the one whose
/// lengths are captured.
///
/// # Errors
/// A file that cannot be continued or written, or input that ends early; saved answers are kept.
pub fn run(args: &Args, robot: Place<'_>) -> Answer<Output> {
    let path = args.measurements.as_path();
    if let Some(out) = args.out.as_deref().filter(|out| out.exists()) {
        return Err(Failure::BadInput(format!("{} already exists; name a new file or move this one", out.display())));
    }
    let stop = command::stop_flag()?;
    let stdin = io::stdin();
    let mut terminal = Terminal {
        lines: LineReader::new(stdin.as_fd()),
        echoes: stdin.is_terminal(),
        stopped: &|| stop.load(Ordering::Relaxed),
        robot,
    };
    let mut output = if dialogue::is_open(path) {
        print_message(&format!("Continuing with {}.", dialogue::file_name(path).display()));
        Output::new(json!({}), String::new())
    } else {
        ask(args, &mut terminal)?
    };
    match dialogue::run(path, &mut terminal) {
        Ok(LoadsEnd::Skipped) => Ok(output),
        Ok(LoadsEnd::Done(value, words)) => {
            output.value["loads"] = value;
            output.words = format!("{words}\n{}", output.words).trim_end().to_owned();
            Ok(output)
        }
        // The calibration is written already.
        Err(failure) => Ok(output.failing(Some(failure))),
    }
}

/// Asks until the measurements of the calibration are complete, and writes it.
fn ask(args: &Args, terminal: &mut Terminal<'_>) -> Answer<Output> {
    let path = args.measurements.as_path();
    let mut stored = Stored::open(path)?;
    let mut guide = match stored.file(FileKind::Measurements)? {
        None => Guide::default(),
        Some(file) => Guide::resume(file).map_err(|why| Failure::bad(format!("{}: {why}", path.display())))?,
    };
    print_message(&welcome(path, stored.text.is_some()));
    let left = || Failure::NotNow(continue_hint(path));
    loop {
        let line = terminal.ask(&guide.question())?.ok_or_else(left)?;
        let captured = if guide.takes_capture(&line) {
            Some(capture::capture(terminal.robot).map(Some))
        } else if guide.takes_touch_down(&line) {
            Some(touch_down(terminal))
        } else {
            None
        };
        let reply = match captured {
            None => guide.answer(&line),
            Some(Ok(Some(captured))) => guide.capture(&captured),
            Some(Ok(None)) => continue,
            Some(Err(failure)) => {
                print_message(&format!("{}.", failure.to_string().trim_end_matches('.')));
                continue;
            }
        };
        if reply.changed {
            stored.save(
                file_text(guide.file(), &dialogue::name_of(path))
                    .map_err(|error| Failure::NotNow(error.to_string()))?,
            )?;
        }
        if !reply.message.is_empty() {
            print_message(&reply.message);
        }
        match reply.next_step {
            NextStep::Ask => {}
            NextStep::Leave => return Err(left()),
            NextStep::Finish => return finish(path, args.out.as_deref()),
        }
    }
}

/// Waits until the running robot has set the node down on the floor; `None` if a line was typed, or at the end of the
/// input.
fn touch_down(terminal: &mut Terminal<'_>) -> Answer<Option<CapturedLengths>> {
    let mut watch = TouchDownWatch::begin(terminal.robot)?;
    print_message(
        "Lower the node slowly, straight down onto the floor and on (nims goto to a place below the floor, at 0.05 m/s); the lengths are \
         taken when all cables are slack, and the motion is stopped. Enter ends the wait.",
    );
    let mut seen = Ok(Seen::Nothing);
    terminal.until_line(&mut || {
        seen = watch.poll();
        !matches!(seen, Ok(Seen::Nothing))
    })?;
    match seen? {
        Seen::Touched(captured) => Ok(Some(captured)),
        Seen::Nothing => {
            print_message("No touch-down was seen.");
            Ok(None)
        }
    }
}

fn welcome(path: &Path, again: bool) -> String {
    let file = path.display();
    if again {
        return format!("Continuing with {file}. undo takes back the last answer, help lists the other commands.");
    }
    format!(
        "Number the pulleys from 1, hang a plumb line from each, and have a tape measure or a laser meter ready. Lengths are in metres (12.43, 12,43) or \
         written like 1243 cm. undo takes back the last answer, quit stops. All answers are saved in {file}; the same command continues."
    )
}

fn continue_hint(path: &Path) -> String {
    let file = path.display();
    if path.exists() {
        return format!("not finished: all answers are saved in {file}; `nims setup {file}` continues");
    }
    format!("no question was answered; `nims setup {file}` starts again")
}

/// Writes the calibration and returns the result with the next steps.
fn finish(measurements: &Path, out: Option<&Path>) -> Answer<Output> {
    let out = out.map_or_else(|| free_name(measurements), |out| Ok(out.to_owned()))?;
    let args = calibrate::Args {
        measurements: measurements.to_owned(),
        method: None,
        out: Some(out.clone()),
        plan: None,
        height: None,
    };
    let value = calibrate::run(&args)?.value;
    let words = format!(
        "The calibration is in {}. Next: in [robot] of the robot file write calibration = \"{}\" in place of anchors_m (the path from that \
         file to this one), then run `nims check ROBOT.toml`.",
        out.display(),
        out.file_name().unwrap_or_default().to_string_lossy()
    );
    print_message(&format!("The calibration is written to {}.", out.display()));
    Ok(Output::new(value, words))
}

/// Returns `site-calibration.toml` in the folder of `site.toml`, with a number if it already exists.
fn free_name(measurements: &Path) -> Answer<PathBuf> {
    let stem = measurements.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = |k: usize| match k {
        1 => measurements.with_file_name(format!("{stem}-calibration.toml")),
        k => measurements.with_file_name(format!("{stem}-calibration-{k}.toml")),
    };
    (1..NAMES)
        .map(name)
        .find(|path| !path.exists())
        .ok_or_else(|| Failure::NotNow(format!("{stem} already has {NAMES} calibrations; name a new file with --out")))
}
