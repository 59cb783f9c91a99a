//! Contents and health of a run.

use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use messages::schema::Schema;
use messages::{RecorderGap, text_of};
use serde::Serialize;

use crate::folder::{is_held, silent_s};
use crate::read::{RecordedChannel, RecordedSample, RunReader};
use crate::{Damage, Finding, MissingData, RunError, Sequence, seconds_since, utc};

/// One file of the run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FileReport {
    /// Path of the file.
    pub path: PathBuf,
    /// Size of the file.
    pub bytes: u64,
    /// Closed properly, by its recorder or by a recovery.
    pub finished: bool,
    /// A recorder has locked the file.
    pub recording: bool,
    /// Time since the last write of the recorder that has locked the file, whole seconds; 0 while it writes.
    pub silent_s: u64,
    /// Made by a recovery from an unfinished or damaged file.
    pub recovered: bool,
    /// Unreadable places.
    pub damage: Vec<Damage>,
}

/// One channel of the run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChannelReport {
    /// e.g. `motor/state`.
    pub name: String,
    /// e.g. `nims_msgs/msg/MotorState`.
    pub schema: String,
    /// Number of samples.
    pub messages: u64,
    /// Bytes of all samples.
    pub bytes: u64,
    /// Mean rate between the first and the last sample.
    pub rate_hz: Option<f64>,
    /// First sample, s since the start of the run.
    pub first_s: f64,
    /// Last sample, s since the start of the run.
    pub last_s: f64,
    /// Longest time between two samples, s.
    pub longest_silence_s: f64,
    /// Samples missing according to their sequence numbers.
    pub lost: u64,
    /// Number of gaps.
    pub gaps: u64,
    /// Total time of the gaps, from the sample before to the sample after, s.
    pub unrecorded_s: f64,
    /// Why the channel was recorded as plain bytes; `None` if it was not.
    pub refused: Option<String>,
}

/// Samples missing between two others, as the recorder reported it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapReport {
    /// e.g. `motor/state`.
    pub channel: String,
    /// Number of missing samples.
    pub missing: u64,
    /// The sample before the gap, s since the start of the run.
    pub at_s: f64,
    /// Time to the sample after the gap, s.
    pub lasted_s: f64,
    /// A clause for use in a sentence; see [`cause_phrase`].
    pub cause: &'static str,
}

/// Report on a run file or a run folder.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RunReport {
    /// True if nothing is missing or damaged, and every file was closed properly.
    pub healthy: bool,
    /// One sentence per problem, or one that states that there is none.
    pub verdict: Vec<String>,
    /// The same for programs; empty without problems.
    #[serde(skip)]
    pub findings: Vec<Finding>,
    /// When the first sample was published.
    pub started: Option<String>,
    /// The same as UNIX time, ns.
    pub started_unix_ns: Option<u64>,
    /// UNIX time from which the seconds of the run count, ns; see [`RunReader::begin_ns`].
    pub begin_unix_ns: Option<u64>,
    /// First sample, s since the start of the run: in a later file that is read alone many minutes.
    pub first_s: f64,
    /// Time from the first to the last sample, s.
    pub duration_s: f64,
    /// Largest total time of gaps among the fast channels, s.
    pub unrecorded_s: f64,
    /// A recorder has locked the run.
    pub recording: bool,
    /// Time since the last write of the recorder that has locked the run, whole seconds; 0 while it writes.
    pub silent_s: u64,
    /// Number of samples.
    pub messages: u64,
    /// Bytes of all samples.
    pub sample_bytes: u64,
    /// Files of the run.
    pub files: Vec<FileReport>,
    /// Channels by name.
    pub channels: Vec<ChannelReport>,
    /// The gaps that the recorder reported, limited to the first `GAPS`.
    pub gaps: Vec<GapReport>,
    /// Names of the attached files.
    pub attachments: Vec<String>,
    /// Metadata of the run: origin, content, versions.
    pub about: BTreeMap<String, String>,
    /// Why the recording ended, as the recorder stored it.
    pub ended: Option<String>,
}

/// Samples between two progress reports.
const PROGRESS_SAMPLES: u64 = 1 << 16;
/// Gaps that are listed individually.
const LISTED_GAPS: usize = 10;

/// Unrecorded time is measured on channels of at least this rate, Hz: slower ones do not resolve it.
const FAST_HZ: f64 = 20.0;

/// Limit of the gaps that are kept for the report.
pub const GAPS: usize = 1000;

impl RunReport {
    /// Shorter unrecorded times get no sentence, because sentences state tenths of a second, s.
    pub const LEAST_S: f64 = 0.05;
}

/// True if samples are known to be missing.
fn is_short(channels: &[ChannelReport], unrecorded_s: f64) -> bool {
    unrecorded_s >= RunReport::LEAST_S || channels.iter().any(|channel| channel.lost > 0)
}

#[derive(Default)]
struct Count {
    messages: u64,
    bytes: u64,
    first_ns: u64,
    last_ns: u64,
    silence_ns: u64,
    unrecorded_ns: u64,
    sequence: Sequence,
    seq_at: Option<usize>,
}

/// Gathers the statistics of a run from samples that are read for another purpose too; [`info`] does only this.
#[derive(Default)]
pub struct RunInspection {
    counts: HashMap<*const RecordedChannel, (Arc<RecordedChannel>, Count)>,
    bounds: Option<(u64, u64)>,
    gaps: Vec<RecorderGap>,
}

impl RunInspection {
    /// Counts one sample.
    pub fn observe(&mut self, recorded: &RecordedSample<'_>) {
        let (_, count) = self.counts.entry(Arc::as_ptr(recorded.channel)).or_insert_with(|| {
            let schema = Schema::parse(&recorded.channel.schema).ok();
            let seq_at = schema.and_then(|schema| Some(schema.field("header.seq")?.offset));
            (Arc::clone(recorded.channel), Count { seq_at, first_ns: recorded.log_time_ns, ..Count::default() })
        });
        let now = recorded.log_time_ns;
        let silence_ns = if count.messages > 0 { now.saturating_sub(count.last_ns) } else { 0 };
        count.silence_ns = count.silence_ns.max(silence_ns);
        count.messages += 1;
        count.bytes += recorded.sample.len() as u64;
        count.first_ns = count.first_ns.min(now);
        count.last_ns = count.last_ns.max(now);
        let seq = count.seq_at.and_then(|at| recorded.sample.get(at..at + 8)?.try_into().ok());
        if let Some(seq) = seq {
            let missing = count.sequence.observe(u64::from_le_bytes(seq));
            count.unrecorded_ns += if missing > 0 { silence_ns } else { 0 };
        }
        self.bounds = Some(self.bounds.map_or((now, now), |(first, last)| (first.min(now), last.max(now))));
        if let Some(gap) = recorded.decode::<RecorderGap>().filter(|_| self.gaps.len() < GAPS) {
            self.gaps.push(gap);
        }
    }

    /// The report, once `reader` has reached the end of the run.
    #[must_use]
    pub fn report(self, reader: &RunReader) -> RunReport {
        let counts: Vec<_> = self.counts.into_values().collect();
        report(reader, &counts, self.bounds, &self.gaps)
    }
}

/// Reads a whole run, finished or not, and reports on it.
///
/// # Errors
/// There is no run file, or it cannot be read.
pub fn info(path: &Path) -> Result<RunReport, RunError> {
    info_with(path, &mut |_, _| {})
}

/// [`info`] with progress: `progress` receives the bytes read and the bytes in total.
///
/// # Errors
/// As [`info`].
pub fn info_with(path: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<RunReport, RunError> {
    let mut reader = RunReader::open(path)?;
    let mut inspection = RunInspection::default();
    let mut noted = 0_u64;
    while let Some(recorded) = reader.next_sample()? {
        inspection.observe(&recorded);
        noted += 1;
        if noted.is_multiple_of(PROGRESS_SAMPLES) {
            progress(reader.position(), reader.bytes());
        }
    }
    progress(reader.bytes(), reader.bytes());
    Ok(inspection.report(&reader))
}

fn gap_report(gap: &RecorderGap, reader: &RunReader, [begin_ns, first_ns]: [u64; 2]) -> GapReport {
    let unix = |mono: u64| reader.clock().map_or(mono, |clock| clock.unix_of(mono));
    GapReport {
        channel: text_of(&gap.channel),
        missing: gap.missing,
        // Samples missing from before the file began count as missing from its beginning.
        at_s: seconds_since(unix(gap.last_ns).max(first_ns), begin_ns),
        lasted_s: gap.next_ns.saturating_sub(gap.last_ns) as f64 * 1e-9,
        cause: cause_phrase(gap.cause),
    }
}

/// A clause for the cause of a gap, one of the `CAUSE_` values of [`RecorderGap`].
#[must_use]
pub fn cause_phrase(cause: u8) -> &'static str {
    match cause {
        RecorderGap::CAUSE_DISK_FULL => "the disk was full",
        RecorderGap::CAUSE_FAILED => "the file was removed or could not be written",
        _ => "the recorder did not receive them in time",
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

fn channel_report(channel: &RecordedChannel, count: &Count, begin_ns: u64) -> ChannelReport {
    let span = seconds(count.last_ns - count.first_ns);
    let regular = count.messages > 1 && span > 0.0;
    ChannelReport {
        name: channel.name.clone(),
        schema: channel.schema_name.clone(),
        messages: count.messages,
        bytes: count.bytes,
        rate_hz: regular.then(|| (count.messages - 1) as f64 / span),
        first_s: seconds_since(count.first_ns, begin_ns),
        last_s: seconds_since(count.last_ns, begin_ns),
        longest_silence_s: seconds(count.silence_ns),
        lost: count.sequence.lost,
        gaps: count.sequence.gaps,
        unrecorded_s: seconds(count.unrecorded_ns),
        refused: channel.refused.clone(),
    }
}

fn file_report(reader: &RunReader, path: &Path, finished: bool, bytes: u64) -> FileReport {
    let damage = reader.damage().iter().filter(|(file, _)| file == path).map(|(_, one)| one.clone()).collect();
    let recovered = reader.recovered().iter().any(|(file, _)| file == path);
    let recording = !finished && is_held(path);
    // A recorder that is suspended, or waits for its disk, also holds the lock.
    let silent_s = if recording { silent_s(path) } else { 0 };
    FileReport { path: path.to_owned(), bytes, finished, recording, silent_s, recovered, damage }
}

fn report(
    reader: &RunReader,
    counts: &[(Arc<RecordedChannel>, Count)],
    bounds: Option<(u64, u64)>,
    gaps: &[RecorderGap],
) -> RunReport {
    let first = bounds.map_or(0, |(first, _)| first);
    let begin = reader.begin_ns().unwrap_or(first);
    let mut channels: Vec<ChannelReport> =
        counts.iter().map(|(channel, count)| channel_report(channel, count, begin)).collect();
    channels.sort_by(|a, b| (&a.name, &a.schema).cmp(&(&b.name, &b.schema)));
    let files: Vec<FileReport> =
        reader.files().iter().map(|(path, finished, bytes)| file_report(reader, path, *finished, *bytes)).collect();
    let fast = channels.iter().filter(|channel| channel.rate_hz.is_some_and(|rate_hz| rate_hz >= FAST_HZ));
    let unrecorded_s = fast.map(|channel| channel.unrecorded_s).fold(0.0, f64::max);
    let findings = findings(&files, &channels, unrecorded_s, reader.orphaned());
    let healthy_verdict = || vec!["complete, nothing missing".to_owned()];
    RunReport {
        healthy: findings.is_empty(),
        verdict: if findings.is_empty() {
            healthy_verdict()
        } else {
            findings.iter().map(ToString::to_string).collect()
        },
        findings,
        started: bounds.map(|(first, _)| utc(first)),
        started_unix_ns: bounds.map(|(first, _)| first),
        begin_unix_ns: reader.begin_ns(),
        first_s: if bounds.is_some() { seconds_since(first, begin) } else { 0.0 },
        duration_s: bounds.map_or(0.0, |(first, last)| seconds(last - first)),
        unrecorded_s,
        recording: files.iter().any(|file| file.recording),
        // If one recorder hangs and another one writes, the run is being recorded.
        silent_s: files.iter().filter(|file| file.recording).map(|file| file.silent_s).min().unwrap_or(0),
        messages: channels.iter().map(|channel| channel.messages).sum(),
        sample_bytes: channels.iter().map(|channel| channel.bytes).sum(),
        files,
        channels,
        gaps: gaps.iter().map(|gap| gap_report(gap, reader, [begin, first])).collect(),
        attachments: reader.attachments().iter().map(|attachment| attachment.name.clone()).collect(),
        about: reader.metadata().clone(),
        ended: reader.ends().last().and_then(|end| end.get("reason").cloned()),
    }
}

fn findings(files: &[FileReport], channels: &[ChannelReport], unrecorded_s: f64, orphaned: u64) -> Vec<Finding> {
    let mut found = Vec::new();
    let short = is_short(channels, unrecorded_s);
    for (at, file) in files.iter().enumerate() {
        let holes = file.damage.iter().filter(|damage| !damage.torn_end).count();
        let path = file.path.clone();
        if file.recording && file.silent_s > 0 {
            found.push(Finding::Silent { path, silent_s: file.silent_s });
        } else if file.recording {
            found.push(Finding::Recording { path });
        } else if holes > 0 {
            found.push(Finding::Damaged { path, places: holes });
        } else if !file.finished {
            found.push(Finding::NotClosed { path });
        } else if file.recovered {
            let lack = match (short, at + 1 == files.len()) {
                (true, _) => MissingData::NotOnDisk,
                (false, true) => MissingData::Unknown,
                (false, false) => MissingData::Nothing,
            };
            found.push(Finding::Recovered { path, lack });
        }
    }
    if unrecorded_s >= RunReport::LEAST_S {
        found.push(Finding::Unrecorded { seconds: unrecorded_s });
    }
    found.extend(channels.iter().filter(|channel| channel.lost > 0).map(|channel| Finding::Lost {
        channel: channel.name.clone(),
        samples: channel.lost,
        gaps: channel.gaps,
    }));
    if orphaned > 0 {
        found.push(Finding::Orphaned { samples: orphaned });
    }
    if channels.is_empty() {
        found.push(Finding::NoSamples);
    }
    found
}

impl fmt::Display for RunReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let started = self.started.as_deref().unwrap_or("never");
        let megabytes = |bytes: u64| bytes as f64 / 1e6;
        writeln!(f, "started   {started}, {:.1} s long", self.duration_s)?;
        if let Some(ended) = &self.ended {
            writeln!(f, "ended     {ended}")?;
        }
        for file in &self.files {
            let state = match file {
                FileReport { recording: true, .. } if file.silent_s > 0 => {
                    format!(", open, but nothing has been written for {} s", file.silent_s)
                }
                FileReport { recording: true, .. } => ", being recorded".to_owned(),
                FileReport { finished: false, .. } => ", not finished".to_owned(),
                FileReport { recovered: true, .. } => ", recovered".to_owned(),
                _ => String::new(),
            };
            writeln!(f, "file      {} ({:.2} MB{state})", file.path.display(), megabytes(file.bytes))?;
        }
        writeln!(f, "samples   {} ({:.2} MB)", self.messages, megabytes(self.sample_bytes))?;
        if !self.attachments.is_empty() {
            writeln!(f, "inside    {}", self.attachments.join(", "))?;
        }
        writeln!(f, "\n{:<28} {:>9} {:>9} {:>10} {:>6}  type", "channel", "samples", "rate/Hz", "silence/s", "lost")?;
        for channel in &self.channels {
            let rate = channel.rate_hz.map_or_else(|| "-".to_owned(), |rate| format!("{rate:.1}"));
            writeln!(
                f,
                "{:<28} {:>9} {:>9} {:>10.3} {:>6}  {}",
                channel.name, channel.messages, rate, channel.longest_silence_s, channel.lost, channel.schema
            )?;
            if let Some(refused) = &channel.refused {
                writeln!(f, "{:<28} recorded as plain bytes: {refused}", "")?;
            }
        }
        writeln!(f)?;
        for gap in self.gaps.iter().take(LISTED_GAPS) {
            writeln!(
                f,
                "{}: {} samples are missing, {:.3} s from {:.3} s on: {}",
                gap.channel, gap.missing, gap.lasted_s, gap.at_s, gap.cause
            )?;
        }
        if self.gaps.len() > LISTED_GAPS {
            writeln!(f, "{} more gaps on recorder/gap", self.gaps.len() - LISTED_GAPS)?;
        }
        for sentence in &self.verdict {
            writeln!(f, "{sentence}")?;
        }
        Ok(())
    }
}
