//! `nims export`: writes the channels of a run as tables for other tools.

use crate::runs::{progress, require_run};
use clap::ValueEnum;
use command::values::finite;
use command::{Answer, Failure, Output};
use runlog::export::{ExportRequest, ExportResult};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// `nims export`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Run folder or file.
    pub run: PathBuf,
    /// Folder for the tables; default: `export` in the run folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// File format.
    #[arg(long, value_enum, default_value = "csv")]
    pub format: TableFormat,
    /// Only this channel; a trailing * matches any ending. Repeatable.
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// Start time, s since the start of the run.
    #[arg(long, value_name = "SECONDS", value_parser = finite, allow_negative_numbers = true)]
    pub from: Option<f64>,
    /// End time (exclusive), s since the start of the run.
    #[arg(long, value_name = "SECONDS", value_parser = finite, allow_negative_numbers = true)]
    pub to: Option<f64>,
}

/// File format of tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TableFormat {
    /// Text, one row per sample.
    Csv,
    /// One structured NumPy array per channel with the memory layout of the samples.
    Npy,
    /// Compressed columns for pandas, polars, DuckDB.
    Parquet,
}

impl From<TableFormat> for runlog::export::Format {
    fn from(format: TableFormat) -> Self {
        match format {
            TableFormat::Csv => Self::Csv,
            TableFormat::Npy => Self::Npy,
            TableFormat::Parquet => Self::Parquet,
        }
    }
}

/// Index of the tables with their definitions.
const CONTENTS: &str = "tables.json";

/// Writes the tables.
///
/// # Errors
/// The run does not exist or lacks what was requested, or a table cannot be written.
pub fn run(args: &Args) -> Answer<Output> {
    require_run(&args.run)?;
    let request = ExportRequest {
        format: args.format.into(),
        folder: args.out.clone().unwrap_or_else(|| default_folder(&args.run)),
        channels: args.channel.clone(),
        from_s: args.from.unwrap_or(f64::NEG_INFINITY),
        to_s: args.to.unwrap_or(f64::INFINITY),
    };
    if request.from_s >= request.to_s {
        return Err(Failure::BadInput(format!("--from {} is not before --to {}", request.from_s, request.to_s)));
    }
    let export = runlog::export::export(&args.run, &request, &mut progress("exporting"))?;
    let value = json!({ "run": args.run, "folder": request.folder, "tables": export.tables, "left_out": export.left_out,
        "repeated": export.repeated, "damaged": export.damaged });
    let contents = request.folder.join(CONTENTS);
    let text = serde_json::to_string_pretty(&with_earlier(&contents, value.clone())).map_err(Failure::not_now)?;
    std::fs::write(&contents, text + "\n")
        .map_err(|error| Failure::NotNow(format!("{} cannot be written: {error}", contents.display())))?;
    Ok(Output::new(value, words(&export, &request.folder)))
}

/// Adds the tables that an earlier export into the same folder left, as far as they are there.
fn with_earlier(contents: &Path, mut value: Value) -> Value {
    let earlier = std::fs::read_to_string(contents).ok().and_then(|text| serde_json::from_str::<Value>(&text).ok());
    let files: Vec<String> = rows(&value, "tables").iter().map(file_of).collect();
    let is_kept = |table: &Value| {
        let file = file_of(table);
        !files.contains(&file) && contents.with_file_name(&file).is_file()
    };
    let kept = earlier.map(|earlier| rows(&earlier, "tables")).unwrap_or_default();
    let mut tables = rows(&value, "tables");
    tables.extend(kept.into_iter().filter(is_kept));
    tables.sort_by_key(|table| (table["channel"].to_string(), file_of(table)));
    value["tables"] = Value::Array(tables);
    value
}

fn rows(value: &Value, key: &str) -> Vec<Value> {
    value[key].as_array().cloned().unwrap_or_default()
}

/// Returns the name of a table's file: the folder may have been moved since.
fn file_of(table: &Value) -> String {
    let path = Path::new(table["file"].as_str().unwrap_or_default());
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns `export` in the run folder, or in the folder of a run file.
fn default_folder(run: &Path) -> PathBuf {
    if run.is_dir() { run.join("export") } else { run.parent().unwrap_or(Path::new("")).join("export") }
}

fn words(export: &ExportResult, folder: &Path) -> String {
    let mut words = format!("{} tables in {}; {CONTENTS} describes them", export.tables.len(), folder.display());
    let width = export.tables.iter().map(|table| table.channel.len()).max().unwrap_or(0);
    for table in &export.tables {
        let name = table.file.file_name().unwrap_or_default().to_string_lossy();
        let _ = write!(words, "\n{:width$}  {:>9} samples  {name}", table.channel, table.samples);
    }
    for (channel, why) in &export.left_out {
        let _ = write!(words, "\n{channel} is not exported: {why}");
    }
    if export.damaged > 0 {
        let _ = write!(words, "\n{} damaged sections of the run could not be read; see `nims info`", export.damaged);
    }
    words
}
