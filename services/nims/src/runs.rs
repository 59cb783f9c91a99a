//! Recorded runs: `info`, `recover`.

use crate::failure::{Answer, Failure};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// `nims info`: JSON and words.
///
/// # Errors
/// There is no run, or it cannot be read.
pub fn info(run: &Path) -> Answer<(Value, String)> {
    there(run)?;
    let report = runlog::info(run).map_err(Failure::not_now)?;
    Ok((serde_json::to_value(&report).map_err(Failure::not_now)?, report.to_string()))
}

/// `nims recover`: one file, or every unfinished file of a folder; JSON and words.
///
/// # Errors
/// There is no run, or nothing in it can be read.
pub fn recover(run: &Path) -> Answer<(Value, String)> {
    there(run)?;
    let files = if run.is_dir() { unfinished(run)? } else { vec![run.to_path_buf()] };
    let mut recovered = Vec::new();
    let mut words = Vec::new();
    for file in &files {
        let recovery = runlog::recover(file, &mut |_, _| {}).map_err(Failure::not_now)?;
        words.push(recovery.to_string());
        recovered.push(serde_json::to_value(&recovery).map_err(Failure::not_now)?);
    }
    if files.is_empty() {
        words.push(format!("every run file in {} is finished: nothing to recover", run.display()));
    }
    Ok((json!({ "recovered": recovered }), words.join("\n")))
}

fn unfinished(folder: &Path) -> Answer<Vec<PathBuf>> {
    let files = runlog::segments(folder).map_err(Failure::bad)?;
    Ok(files.into_iter().filter(|file| file.to_string_lossy().ends_with(runlog::PART_ENDING)).collect())
}

fn there(run: &Path) -> Answer {
    if run.exists() {
        Ok(())
    } else {
        Err(Failure::BadInput(format!("there is no run {}: give a run folder or a run file", run.display())))
    }
}
