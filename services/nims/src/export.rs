//! `nims export`: the channels of a run as tables for other tools.

use crate::cli;
use crate::failure::{Answer, Failure};
use crate::runs::{progress, there};
use runlog::export::{Export, Wanted};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Beside the tables: what each is, with its definition.
const CONTENTS: &str = "tables.json";

/// Writes the tables; JSON and words.
///
/// # Errors
/// There is no run, it has not what is wanted, or a table cannot be written.
pub fn export(asked: &cli::Export) -> Answer<(Value, String)> {
    there(&asked.run)?;
    let wanted = Wanted {
        format: asked.format.into(),
        folder: asked.out.clone().unwrap_or_else(|| beside(&asked.run)),
        channels: asked.channel.clone(),
        from_s: asked.from.unwrap_or(f64::NEG_INFINITY),
        to_s: asked.to.unwrap_or(f64::INFINITY),
    };
    if wanted.from_s >= wanted.to_s {
        return Err(Failure::BadInput(format!("--from {} is not before --to {}", wanted.from_s, wanted.to_s)));
    }
    let export = runlog::export::export(&asked.run, &wanted, &mut progress("exporting"))?;
    let value = json!({ "run": asked.run, "folder": wanted.folder, "tables": export.tables, "left_out": export.left_out,
        "repeated": export.repeated, "damaged": export.damaged });
    let contents = wanted.folder.join(CONTENTS);
    let text = serde_json::to_string_pretty(&value).map_err(Failure::not_now)?;
    std::fs::write(&contents, text + "\n")
        .map_err(|error| Failure::NotNow(format!("{} cannot be written: {error}", contents.display())))?;
    Ok((value, words(&export, &wanted.folder)))
}

/// `export` in the run folder, or beside a run file.
fn beside(run: &Path) -> PathBuf {
    if run.is_dir() { run.join("export") } else { run.parent().unwrap_or(Path::new("")).join("export") }
}

fn words(export: &Export, folder: &Path) -> String {
    let mut words = format!("{} tables in {}; {CONTENTS} says what each is", export.tables.len(), folder.display());
    let width = export.tables.iter().map(|table| table.channel.len()).max().unwrap_or(0);
    for table in &export.tables {
        let name = table.file.file_name().unwrap_or_default().to_string_lossy();
        let _ = write!(words, "\n{:width$}  {:>9} samples  {name}", table.channel, table.samples);
    }
    for (channel, why) in &export.left_out {
        let _ = write!(words, "\n{channel} is left out: {why}");
    }
    if export.damaged > 0 {
        let _ = write!(words, "\n{} damaged places of the run could not be read; see `nims info`", export.damaged);
    }
    words
}
