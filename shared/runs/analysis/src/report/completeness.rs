//! Completeness of a recording as a part of the assessment's sentence.

use super::gather::RunData;
use crate::runs::ENDS;
use runlog::{FileReport, RunReport};

/// Describes the completeness of the recording; returns also whether nothing deserves attention.
pub fn recording(run: &RunData) -> (String, bool) {
    let report = &run.recording;
    let mut lacks = Vec::new();
    if report.unrecorded_s >= RunReport::LEAST_S {
        lacks.push(format!("{:.1} s were not recorded", report.unrecorded_s));
    }
    for (seconds, which) in run.unrecorded_ends_s.iter().zip(ENDS).filter(|(seconds, _)| **seconds > 0.0) {
        lacks.push(format!("the {which} {seconds:.1} s were not recorded"));
    }
    let lost: u64 = report.channels.iter().map(|channel| channel.lost).sum();
    if lost > 0 {
        let channels = report.channels.iter().filter(|channel| channel.lost > 0).count();
        lacks.push(format!("{lost} samples of {channels} channels are missing"));
    }
    let short = !lacks.is_empty();
    lacks.extend(report.files.iter().filter_map(|file| file_defect(file, short)));
    // No samples are known to be missing, but these files were closed by a recovery.
    let last = report.files.len().saturating_sub(1);
    let recovered = report.files.iter().enumerate().filter(|(_, file)| !short && is_recovered_intact(file));
    let recovered: Vec<String> = recovered.map(|(at, file)| recovery_text(file, at == last)).collect();
    if report.silent_s > 0 {
        lacks.insert(
            0,
            format!("nothing has been written for {} s, although a recorder has the file open", report.silent_s),
        );
        lacks.extend(recovered);
        return (format!("the run is not being recorded ({})", lacks.join("; ")), false);
    }
    let sentence = match (lacks.is_empty(), recovered.is_empty(), report.recording) {
        (true, true, true) => return ("the run is still being recorded".to_owned(), true),
        (true, true, false) if report.healthy => return ("the recording is complete".to_owned(), true),
        (true, true, false) => format!("the recording is incomplete ({})", report.verdict.join("; ")),
        (true, false, true) => format!("the run is still being recorded ({})", recovered.join("; ")),
        (true, false, false) => format!("the recording has no known gap ({})", recovered.join("; ")),
        (false, _, live) => {
            lacks.extend(recovered);
            let lacks = lacks.join("; ");
            if live {
                format!("the run is still being recorded, but {lacks}")
            } else {
                format!("the recording is incomplete ({lacks})")
            }
        }
    };
    (sentence, false)
}

fn file_name(file: &FileReport) -> String {
    file.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns whether the file was closed by a recovery and has no damage inside.
fn is_recovered_intact(file: &FileReport) -> bool {
    file.recovered && file.finished && file.damage.iter().all(|damage| damage.torn_end)
}

/// Describes the end of a recovered file without missing sample numbers.
fn recovery_text(file: &FileReport, last: bool) -> String {
    // After the last file, no sample number shows what is missing.
    let missing = if last {
        "at most the last half second before the end of its recorder is missing (two seconds after a power cut)"
    } else {
        "the sample numbers show no loss after it"
    };
    format!("{} was recovered, and {missing}", file_name(file))
}

/// Describes the defect of a file, if any; `short`: samples are known to be missing.
fn file_defect(file: &FileReport, short: bool) -> Option<String> {
    let name = file_name(file);
    let holes = file.damage.iter().filter(|damage| !damage.torn_end).count();
    match file {
        FileReport { recording: true, .. } => None,
        _ if holes > 0 => Some(format!("{name} is damaged in {holes} places: run `nims recover`")),
        FileReport { finished: false, .. } => Some(format!("{name} was not closed: run `nims recover`")),
        FileReport { recovered: true, .. } if short => {
            Some(format!("{name} was recovered without the last buffer of its recorder"))
        }
        _ => None,
    }
}
