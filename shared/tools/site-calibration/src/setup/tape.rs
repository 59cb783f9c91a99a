//! The check of each cable over five metres of tape, after the points of a running robot.

use super::numbers::{self, Bounds};
use super::text::metres;
use crate::calibrate::{MeasurementsFile, TapeEntry};

/// What the robot runs out, m.
const COUNTED_M: f64 = 5.0;

/// Difference between robot and tape that is asked about, as a share: counts of the bare wheel of 30 mm are 3 % off
/// with a cable of 1 mm, and those of another wheel more.
const ASKED_SHARE: f64 = 0.03;

/// Accepted readings of the tape: shorter ones are too inexact.
const TAPE: Bounds = Bounds { least_m: 1.0, most_m: 100.0 };

/// Returns the first cable, from 1, without an answer. Only lengths that the robot counted have its scale.
pub fn open_cable(file: &MeasurementsFile, cables: usize) -> Option<usize> {
    file.counts_per_m.as_ref()?;
    (1..=cables).find(|cable| !file.tape.iter().any(|entry| entry.cable == *cable))
}

/// Returns the answer that waits for a confirmation.
pub fn doubted(file: &MeasurementsFile) -> Option<TapeEntry> {
    file.setup.as_ref()?.tape_so_far.clone()
}

/// Returns the question.
pub fn text(cable: usize) -> String {
    say!(
        "Check cable {cable}: mark it where it leaves the pulley, run out {COUNTED_M:.0} m as the robot counts them \
         (a jog is at most 2 m), and measure how far the mark has moved (two lengths: what the robot counted, then the \
         tape; Enter: not checked)?"
    )
}

/// Returns the question about a reading that is far from what the robot counted.
pub fn doubt_text(entry: &TapeEntry) -> String {
    let m = entry.m.unwrap_or_default();
    say!(
        "The robot counted {}, and {} was typed ({} {}). Press Enter if the tape shows that, or type the lengths of cable {} again:",
        metres(entry.counted_m),
        metres(m),
        metres((m - entry.counted_m).abs()),
        if m > entry.counted_m { say!("more") } else { say!("less") },
        entry.cable
    )
}

/// Applies an answer.
///
/// # Errors
/// One sentence: why it is not accepted.
pub fn answer(file: &mut MeasurementsFile, cables: usize, cable: usize, line: &str) -> Result<String, String> {
    let after = Some(file.point.len());
    if line.is_empty() {
        file.tape.push(TapeEntry { cable, counted_m: COUNTED_M, m: None, sigma_m: None, after });
        return Ok(String::new());
    }
    let (counted_m, m) = match numbers::lengths(line, TAPE)?.as_slice() {
        [m] => (COUNTED_M, *m),
        [counted_m, m] => (*counted_m, *m),
        more => return Err(say!("these are {} numbers; type what the robot counted and the tape", more.len())),
    };
    let entry = TapeEntry { cable, counted_m, m: Some(m), sigma_m: None, after };
    let tried: Vec<TapeEntry> = file.tape.iter().chain([&entry]).cloned().collect();
    // What differs too much for any wheel is refused here.
    crate::calibrate::tape_scales(&tried, file.counts_per_m.as_deref(), cables)?;
    if (m / counted_m - 1.0).abs() > ASKED_SHARE {
        file.setup.get_or_insert_default().tape_so_far = Some(entry);
    } else {
        file.tape.push(entry);
    }
    Ok(String::new())
}

/// Applies an answer about a doubted reading.
///
/// # Errors
/// As for [`answer`].
pub fn confirm(file: &mut MeasurementsFile, cables: usize, entry: &TapeEntry, line: &str) -> Result<String, String> {
    file.setup.get_or_insert_default().tape_so_far = None;
    if line.is_empty() {
        file.tape.push(entry.clone());
        return Ok(String::new());
    }
    answer(file, cables, entry.cable, line)
}

/// Takes back the last answer about a tape, if no later answer exists. `wanted`: points of the plan.
pub fn undo(file: &mut MeasurementsFile, wanted: Option<usize>) -> Option<String> {
    if let Some(entry) = file.setup.as_mut().and_then(|setup| setup.tape_so_far.take()) {
        return Some(say!("the tape of cable {} was {}", entry.cable, metres(entry.m.unwrap_or_default())));
    }
    let points = file.point.len();
    // A number of further points was answered after the tapes.
    if wanted.is_some_and(|wanted| wanted > file.used(file.usual_method()).len()) {
        return None;
    }
    let entry = file.tape.pop_if(|entry| entry.after == Some(points))?;
    Some(match entry.m {
        Some(m) => say!("the tape of cable {} was {}", entry.cable, metres(m)),
        None => say!("cable {} was not checked", entry.cable),
    })
}
