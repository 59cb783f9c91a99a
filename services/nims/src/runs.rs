//! Recorded runs: `info`, `recover`.

use crate::failure::{Answer, Failure};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// `nims info`: JSON and words.
///
/// # Errors
/// There is no run, or it cannot be read.
pub fn info(run: &Path) -> Answer<(Value, String)> {
    there(run)?;
    let report = runlog::info_with(run, &mut progress("reading")).map_err(Failure::not_now)?;
    let mut value = serde_json::to_value(&report).map_err(Failure::not_now)?;
    let mut words = report.to_string();
    // a run file alone has no manifest
    let manifest = std::fs::read_to_string(run.join("manifest.json")).ok();
    if let Some(manifest) = manifest.and_then(|text| serde_json::from_str::<Value>(&text).ok()) {
        words = format!("{}{words}", of_manifest(&manifest));
        value["manifest"] = manifest;
    }
    Ok((value, words))
}

/// What a run's manifest says, in words.
fn of_manifest(manifest: &Value) -> String {
    let text = |key: &str| manifest[key].as_str().unwrap_or("?");
    let ended = manifest["ended_because"].as_str().unwrap_or("no end: it runs, or was cut off");
    let mut words = format!("run       {} with nims {}; ended: {ended}\n", text("name"), text("nims_version"));
    for process in manifest["processes"].as_array().into_iter().flatten() {
        let restarts = process["restarts"].as_u64().unwrap_or(0);
        if restarts > 0 {
            let name = process["name"].as_str().unwrap_or("?");
            words.push_str(&format!("process   {name} died and was started again {restarts} times\n"));
        }
    }
    words
}

/// `nims recover`: one file, or every unfinished or damaged file of a folder; JSON and words.
///
/// # Errors
/// There is no run, or nothing in it can be read.
pub fn recover(run: &Path) -> Answer<(Value, String)> {
    there(run)?;
    let files = if run.is_dir() { in_need(run)? } else { vec![run.to_path_buf()] };
    let mut recovered = Vec::new();
    let mut words = Vec::new();
    for file in &files {
        let recovery = runlog::recover(file, &mut progress("recovering")).map_err(Failure::not_now)?;
        words.push(recovery.to_string());
        recovered.push(serde_json::to_value(&recovery).map_err(Failure::not_now)?);
    }
    if files.is_empty() {
        words.push(format!("every run file in {} is finished and whole: nothing to recover", run.display()));
    }
    Ok((json!({ "recovered": recovered }), words.join("\n")))
}

/// The files of a run that were not closed, or hold damage.
fn in_need(folder: &Path) -> Answer<Vec<PathBuf>> {
    let report = runlog::info_with(folder, &mut progress("looking")).map_err(Failure::bad)?;
    let needs = |file: &runlog::FileReport| !file.finished || !file.damage.is_empty();
    Ok(report.files.into_iter().filter(needs).map(|file| file.path).collect())
}

/// Shows on a terminal how far a long piece of work on bytes of a run is; nothing for a short one.
pub(crate) fn progress(what: &'static str) -> impl FnMut(u64, u64) {
    /// Below this, the work is done before anyone wonders.
    const LONG_BYTES: u64 = 32 << 20;
    let style = ProgressStyle::with_template("{msg} {bar:40} {bytes}/{total_bytes}, {eta} left");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    // without a terminal it draws nothing
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

/// Whether there is anything at that path.
pub fn there(run: &Path) -> Answer {
    if run.exists() {
        Ok(())
    } else {
        Err(Failure::BadInput(format!("there is no run {}: give a run folder or a run file", run.display())))
    }
}
