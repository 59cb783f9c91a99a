//! Exports a run as tables for other tools: one file per channel of any type, with all files of the run as one.
//!
//! The columns come from the channel's own definition, so types that this build does not know are exported too:
//! * `t_s`, seconds since the start of the run; `log_time_ns`, when the sample was published; `publish_time_ns`, when
//!   its content was valid; both in UNIX time.
//! * One column per number, named by its path: `length_m_1` is the first element of `length_m`. Header fields have
//!   their bare names; padding is left out.
//! * A byte array of 16 bytes or more is one text column: the text before the first zero, or hexadecimal digits after
//!   `0x` if the bytes are not text.
//!
//! `.npy` contains the samples as they are in memory: a structured array with the names of the definition; arrays stay
//! arrays, texts stay bytes.

mod csv;
mod npy;
mod parquet;
mod sink;
mod table;

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use messages::blob::BlobType;
use serde::Serialize;

use crate::{NotARunReason, RecordedChannel, RunError, RunReader, seconds_since};
use sink::Sink;
use table::{Table, Times};

/// File format of the tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Text, one row per sample. Numbers are written so that they parse back exactly.
    Csv,
    /// One structured array, for `numpy.load(.., mmap_mode="r")`.
    Npy,
    /// Compressed columns for pandas, polars, DuckDB and others.
    Parquet,
}

impl Format {
    /// File name extension.
    #[must_use]
    pub fn ending(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Npy => "npy",
            Self::Parquet => "parquet",
        }
    }
}

/// What to export, and how.
#[derive(Debug, Clone)]
pub struct ExportRequest {
    /// Format of the tables.
    pub format: Format,
    /// Folder for the tables; created if missing.
    pub folder: PathBuf,
    /// Channel names; a trailing `*` matches any ending. Empty: all channels.
    pub channels: Vec<String>,
    /// Start of the exported time, s since the start of the run.
    pub from_s: f64,
    /// End of the exported time (exclusive), s since the start of the run.
    pub to_s: f64,
}

/// One written table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ExportedTable {
    /// e.g. `motor/state`.
    pub channel: String,
    /// e.g. `nims_msgs/msg/MotorState`.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Complete definition; it also names the values of enumerating fields.
    pub definition: String,
    /// Path of the table.
    pub file: PathBuf,
    /// Number of rows.
    pub samples: u64,
    /// Column names.
    pub columns: Vec<String>,
}

/// Result of an export.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct ExportResult {
    /// Written tables.
    pub tables: Vec<ExportedTable>,
    /// Channels without a table, each with the reason.
    pub left_out: Vec<(String, String)>,
    /// Samples that occurred in more than one file of the run.
    pub repeated: u64,
    /// Unreadable places in the run files.
    pub damaged: usize,
}

struct Open {
    sink: Box<dyn Sink>,
    size: usize,
    exported: ExportedTable,
}

enum Channel {
    Open(Box<Open>),
    LeftOut,
}

/// Most bytes of rows that wait in memory, of all tables together: then the table with most of them writes its own.
const WAITING_BYTES: usize = 10 << 20;

/// Samples between two progress reports.
const PROGRESS_SAMPLES: u64 = 1 << 14;

/// Exports a run file or a run folder. `progress` receives the bytes read and the bytes in total.
///
/// # Errors
/// There is no run, it lacks a requested channel, or a table cannot be written. An existing table is not overwritten,
/// and no part of an export that failed is left.
pub fn export(
    run: &Path,
    wanted: &ExportRequest,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<ExportResult, RunError> {
    let mut made = Vec::new();
    let exported = write_tables(run, wanted, &mut made, progress);
    if exported.is_err() {
        // A part of a table looks like a whole one. The error says more than one about the removal.
        made.iter().for_each(|file| drop(fs::remove_file(file)));
    }
    exported
}

/// Writes the tables; adds the files that it creates to `made`.
fn write_tables(
    run: &Path,
    wanted: &ExportRequest,
    made: &mut Vec<PathBuf>,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<ExportResult, RunError> {
    let mut reader = RunReader::open(run)?;
    fs::create_dir_all(&wanted.folder).map_err(RunError::io(&wanted.folder, "create the folder"))?;
    let mut channels: HashMap<usize, Channel> = HashMap::new();
    let mut result = ExportResult::default();
    let (mut read, mut waiting) = (0_u64, 0);
    loop {
        read += 1;
        if read.is_multiple_of(PROGRESS_SAMPLES) {
            progress(reader.position(), reader.bytes());
        }
        let begin_ns = reader.begin_ns();
        let Some(recorded) = reader.next_sample()? else { break };
        let t_s = seconds_since(recorded.log_time_ns, begin_ns.unwrap_or(recorded.log_time_ns));
        if !(wanted.from_s..wanted.to_s).contains(&t_s) || !is_wanted(&wanted.channels, &recorded.channel.name) {
            continue;
        }
        let channel = match channels.get_mut(&recorded.index) {
            Some(channel) => channel,
            None => {
                let begun = begin_table(recorded.channel, recorded.sample.len(), wanted, made)?;
                channels.entry(recorded.index).or_insert(begun.unwrap_or_else(|why| {
                    result.left_out.push((recorded.channel.name.clone(), why));
                    Channel::LeftOut
                }))
            }
        };
        let Channel::Open(open) = channel else { continue };
        if open.size != recorded.sample.len() {
            return Err(RunError::Size {
                channel: recorded.channel.name.clone(),
                got: recorded.sample.len(),
                expected: open.size,
            });
        }
        let times = Times { t_s, log_time_ns: recorded.log_time_ns, publish_time_ns: recorded.publish_time_ns };
        let before = open.sink.waiting_bytes();
        open.sink.row(times, recorded.sample).map_err(RunError::io(&open.exported.file, "write the table"))?;
        waiting = waiting + open.sink.waiting_bytes() - before;
        open.exported.samples += 1;
        if waiting > WAITING_BYTES {
            waiting -= write_most(&mut channels)?;
        }
    }
    progress(reader.bytes(), reader.bytes());
    if let Some(why) = not_found(&reader, wanted, channels.is_empty()) {
        return Err(RunError::not_a_run(run, why));
    }
    for channel in channels.into_values() {
        let Channel::Open(open) = channel else { continue };
        let Open { sink, exported, .. } = *open;
        sink.finish().map_err(RunError::io(&exported.file, "write the end of the table"))?;
        result.tables.push(exported);
    }
    result.tables.sort_by(|a, b| a.channel.cmp(&b.channel).then_with(|| a.file.cmp(&b.file)));
    result.repeated = reader.repeated();
    result.damaged = reader.damage().iter().filter(|(_, damage)| !damage.torn_end).count();
    Ok(result)
}

/// Writes the waiting rows of the table that has most; returns how many bytes waited.
fn write_most(channels: &mut HashMap<usize, Channel>) -> Result<usize, RunError> {
    let open = channels.values_mut().filter_map(|channel| match channel {
        Channel::Open(open) => Some(open),
        Channel::LeftOut => None,
    });
    let Some(most) = open.max_by_key(|open| open.sink.waiting_bytes()) else { return Ok(0) };
    let waited = most.sink.waiting_bytes();
    most.sink.write_waiting().map_err(RunError::io(&most.exported.file, "write the table"))?;
    Ok(waited)
}

/// Starts the table of a channel and adds its file to `made`; the inner error is why the channel is left out.
fn begin_table(
    channel: &RecordedChannel,
    size: usize,
    wanted: &ExportRequest,
    made: &mut Vec<PathBuf>,
) -> Result<Result<Channel, String>, RunError> {
    if BlobType::of_name(&channel.type_name).is_some() {
        return Ok(Err(
            "its samples have different lengths; Foxglove and other readers of the file show them".to_owned()
        ));
    }
    let table = match Table::from_definition(&channel.schema, size) {
        Ok(table) => table,
        Err(why) => return Ok(Err(why)),
    };
    let name = file_name(channel, |name| made.contains(&file_of(wanted, name)), made.len());
    let file = file_of(wanted, &name);
    let table_file = fs::OpenOptions::new().write(true).create_new(true).open(&file);
    let table_file = table_file.map_err(RunError::io(&file, "create the table"))?;
    made.push(file.clone());
    let columns = match wanted.format {
        Format::Npy => npy::names(&table),
        Format::Csv | Format::Parquet => table.names(),
    };
    let exported = ExportedTable {
        channel: channel.name.clone(),
        type_name: channel.schema_name.clone(),
        definition: channel.schema.clone(),
        file: file.clone(),
        samples: 0,
        columns,
    };
    let sink: std::io::Result<Box<dyn Sink>> = match wanted.format {
        Format::Csv => csv::Csv::begin(table_file, table).map(|sink| Box::new(sink) as _),
        Format::Npy => npy::Npy::begin(table_file, &table).map(|sink| Box::new(sink) as _),
        Format::Parquet => parquet::Parquet::begin(table_file, table, channel).map(|sink| Box::new(sink) as _),
    };
    let sink = sink.map_err(RunError::io(&file, "write the header of the table"))?;
    Ok(Ok(Channel::Open(Box::new(Open { sink, size, exported }))))
}

fn file_of(wanted: &ExportRequest, name: &str) -> PathBuf {
    wanted.folder.join(format!("{name}.{}", wanted.format.ending()))
}

/// `motor.state` for `motor/state`; followed by the hash of the type if the channel had another one before. `number`:
/// that of the table, for names that are taken even so.
fn file_name(channel: &RecordedChannel, is_taken: impl Fn(&str) -> bool, number: usize) -> String {
    let plain = channel.name.replace('/', ".");
    if !is_taken(&plain) {
        return plain;
    }
    let hash = channel.type_name.rsplit('/').next().filter(|hash| !hash.is_empty()).unwrap_or("other");
    let with_hash = format!("{plain}@{hash}");
    if is_taken(&with_hash) { format!("{with_hash}-{number}") } else { with_hash }
}

fn is_wanted(patterns: &[String], name: &str) -> bool {
    patterns.is_empty() || patterns.iter().any(|pattern| fits(pattern, name))
}

fn fits(pattern: &str, name: &str) -> bool {
    match pattern.strip_suffix('*') {
        Some(beginning) => name.starts_with(beginning),
        None => name == pattern,
    }
}

/// Why the export is not the requested one, once `reader` has reached the end of the run.
fn not_found(reader: &RunReader, wanted: &ExportRequest, is_empty: bool) -> Option<NotARunReason> {
    let mut names: Vec<&str> = reader.channels().iter().map(|channel| channel.name.as_str()).collect();
    names.sort_unstable();
    let is_absent = |pattern: &&String| !names.iter().any(|name| fits(pattern, name));
    let absent: Vec<String> = wanted.channels.iter().filter(is_absent).cloned().collect();
    if names.is_empty() {
        Some(NotARunReason::NoSamples)
    } else if !absent.is_empty() {
        Some(NotARunReason::NoChannel { wanted: absent, there: names.into_iter().map(str::to_owned).collect() })
    } else {
        is_empty.then_some(NotARunReason::NoSampleThen)
    }
}
