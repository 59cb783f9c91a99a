//! Recorded runs: `info` and `recover`.

use command::{Answer, Failure, Output};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Runs `nims info`.
///
/// # Errors
/// The run does not exist or cannot be read.
pub fn info(run: &Path) -> Answer<Output> {
    require_run(run)?;
    let report = runlog::info_with(run, &mut progress("reading"))?;
    let mut value = serde_json::to_value(&report).map_err(Failure::not_now)?;
    let mut words = report.to_string();
    if let Some(manifest) = manifest_of(run) {
        words = format!("{}{words}", manifest_text(&manifest, &report));
        let unrecorded_s = unrecorded_ends_s(run, &report);
        for (seconds, which) in unrecorded_s.iter().zip(ENDS).filter(|(seconds, _)| **seconds > 0.0) {
            words.push_str(&format!("the {which} {seconds:.1} s of the run were not recorded\n"));
        }
        value["unrecorded_ends_s"] = json!(unrecorded_s);
        value["manifest"] = manifest;
    }
    Ok(Output::new(value, words))
}

/// Reads the manifest of a run folder; a single run file has none.
fn manifest_of(run: &Path) -> Option<Value> {
    serde_json::from_str(&std::fs::read_to_string(run.join("manifest.json")).ok()?).ok()
}

/// Returns the reason for the end of a run from its manifest.
#[must_use]
pub fn end_reason(run: &Path) -> Option<String> {
    manifest_of(run)?["ended_because"].as_str().map(str::to_owned)
}

/// Returns when the processes of a run were asked to end, from its manifest, UNIX time, ns.
#[must_use]
pub fn stopping_unix_ns(run: &Path) -> Option<u64> {
    manifest_of(run)?["stopping_unix_ns"].as_u64()
}

/// Minimum duration of a reported unrecorded end, s. The recorder writes to the disk twice a second, so a shorter one
/// is normal.
const END_S: f64 = 2.0;
/// Names of the two ends in [`unrecorded_ends_s`].
pub const ENDS: [&str; 2] = ["first", "last"];

/// Returns the unrecorded time at both ends of a run, s: from the time when the recorder was ready to the first sample,
/// and from the last sample to the end of the run, both according to the supervisor; 0 if negligible. The recorder was
/// not running then, or its files were removed.
#[must_use]
pub fn unrecorded_ends_s(run: &Path, report: &runlog::RunReport) -> [f64; 2] {
    let (Some(manifest), Some(first_ns)) = (manifest_of(run), report.started_unix_ns) else { return [0.0; 2] };
    let since_first_s = |key: &str| {
        let at_ns = manifest[key].as_u64()?;
        Some((i128::from(at_ns) - i128::from(first_ns)) as f64 * 1e-9)
    };
    let left = [
        since_first_s("recording_unix_ns").map(|ready_s| -ready_s),
        since_first_s("stopping_unix_ns").map(|end_s| end_s - report.duration_s),
    ];
    left.map(|left_s| left_s.filter(|left_s| *left_s > END_S).unwrap_or(0.0))
}

/// Summarises the manifest of a run.
fn manifest_text(manifest: &Value, report: &runlog::RunReport) -> String {
    let closed = report.files.iter().all(|file| file.finished && !file.recovered);
    let text = |key: &str| manifest[key].as_str().unwrap_or("?");
    let ended = match manifest["ended_because"].as_str() {
        Some(because) => format!("ended: {because}"),
        None if report.silent_s > 0 => {
            format!("it is open, but nothing has been written for {} s", report.silent_s)
        }
        None if report.recording => "it is being recorded".to_owned(),
        None if closed => "no end: its supervisor ended without recording one".to_owned(),
        None => "no end: the recording was cut off".to_owned(),
    };
    let mut words = format!("run       {} with nims {}; {ended}\n", text("name"), text("nims_version"));
    for process in manifest["processes"].as_array().into_iter().flatten() {
        let restarts = process["restarts"].as_u64().unwrap_or(0);
        if restarts > 0 {
            let name = process["name"].as_str().unwrap_or("?");
            let times = if restarts == 1 { "once".to_owned() } else { format!("{restarts} times") };
            words.push_str(&format!("process   {name} was restarted {times}\n"));
        }
    }
    words
}

/// Runs `nims recover` on one file, or on every unfinished or damaged file of a folder. One that fails keeps no other
/// from being recovered, and is a failure beside the output.
///
/// # Errors
/// The run does not exist, or nothing in it can be read or recovered.
pub fn recover(run: &Path) -> Answer<Output> {
    require_run(run)?;
    let files = if run.is_dir() { unfinished_files(run)? } else { vec![run.to_path_buf()] };
    let (mut recovered, mut failed) = (Vec::new(), Vec::new());
    let mut words = Vec::new();
    for file in &files {
        match runlog::recover(file, &mut progress("recovering")) {
            Ok(recovery) => {
                words.push(recovery.to_string());
                recovered.push(serde_json::to_value(&recovery).map_err(Failure::not_now)?);
            }
            Err(error) => failed.push((file, Failure::from(error))),
        }
    }
    let all = failed.iter().map(|(_, failure)| failure.to_string()).collect::<Vec<_>>().join("; ");
    let failure = failed.first().map(|(_, first)| first.with_sentence(all));
    if recovered.is_empty()
        && let Some(failure) = failure
    {
        return Err(failure);
    }
    if files.is_empty() {
        words.push(format!("every run file in {} is finished and undamaged: nothing to recover", run.display()));
    }
    let why = |(file, failure): &(&PathBuf, Failure)| json!({ "file": file, "why": failure.to_string() });
    let failed: Vec<Value> = failed.iter().map(why).collect();
    Ok(Output::new(json!({ "recovered": recovered, "failed": failed }), words.join("\n")).failing(failure))
}

/// Returns the files of a run that are unfinished or damaged.
fn unfinished_files(folder: &Path) -> Answer<Vec<PathBuf>> {
    let report = runlog::info_with(folder, &mut progress("checking")).map_err(Failure::bad)?;
    let needs = |file: &runlog::FileReport| !file.finished || !file.damage.is_empty();
    Ok(report.files.into_iter().filter(needs).map(|file| file.path).collect())
}

/// Returns a callback that shows the progress of long work on a terminal; it shows nothing for short work.
pub fn progress(what: &'static str) -> impl FnMut(u64, u64) {
    /// Minimum size for a progress bar; smaller runs are processed in an instant.
    const LONG_BYTES: u64 = 32 << 20;
    let style = ProgressStyle::with_template("{msg} {bar:40} {bytes}/{total_bytes}, {eta} left");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    // Without a terminal, the bar draws nothing.
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr()).with_style(style).with_message(what);
    move |done, all| {
        if all < LONG_BYTES {
            return;
        }
        bar.set_length(all);
        bar.set_position(done);
        if done >= all {
            bar.finish_and_clear();
        }
    }
}

/// Checks that a run exists.
pub fn require_run(run: &Path) -> Answer {
    if run.exists() {
        Ok(())
    } else {
        Err(Failure::BadInput(format!("{} does not exist; give a run folder or a run file", run.display())))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use runlog::{FileReport, RunReport};

    /// A properly closed file.
    pub(crate) fn whole_file(name: &str) -> FileReport {
        FileReport {
            path: PathBuf::from(name),
            bytes: 1,
            finished: true,
            recording: false,
            silent_s: 0,
            recovered: false,
            damage: Vec::new(),
        }
    }

    /// Descriptions of runs without an end, with their names in the file of sentences.
    pub(crate) fn without_end() -> Vec<(String, String)> {
        let manifest = json!({ "name": "demo3", "nims_version": "1" });
        let file = whole_file("run.mcap");
        let open = FileReport { finished: false, recording: true, ..file.clone() };
        let files = [
            ("whole", file.clone()),
            ("recovered", FileReport { recovered: true, ..file }),
            ("open", open.clone()),
            ("silent", FileReport { silent_s: 12, ..open }),
        ];
        let described = files.map(|(name, file)| {
            let (recording, silent_s) = (file.recording, file.silent_s);
            let report = RunReport { recording, silent_s, files: vec![file], ..RunReport::default() };
            (format!("run without an end, {name}"), manifest_text(&manifest, &report))
        });
        described.to_vec()
    }
}
