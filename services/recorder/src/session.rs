//! The files of one run: opens, writes, flushes, splits and abandons them, and resumes after errors.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

use messages::{Message, RecorderGap, RecorderStatus, put_sentence, put_text};
use runlog::{Attachment, ChannelId, ChannelSpec, RunClock, RunError, RunWriter, next_file, run_attachments};

use crate::batch::{Batch, ReceivedSample};
use crate::disk_full::DiskFull;
use crate::recording::Recording;
use crate::row::Row;
use crate::settings::Settings;

const SECOND_NS: u64 = 1_000_000_000;
/// Time between two checks of the free space, ns.
const WATCH_NS: u64 = SECOND_NS / 2;
/// Time from a failure to the next file, ns.
const RETRY_NS: u64 = 5 * SECOND_NS;
/// Time from the removal of a file to the next one, ns; shorter, because the disk has not failed.
const REMOVED_NS: u64 = SECOND_NS;
/// Free space to resume, as a multiple of that at which recording stops, so that no file is started every second.
const ROOM_FACTOR: f64 = 1.1;
/// Time without a sample after which a channel is static, ns. At the end of a file, the last sample of a static channel
/// is repeated at the start of the next file, so that each file can be read alone. Periodic states are published at
/// least once a second.
const STATIC_NS: u64 = 2 * SECOND_NS;
/// Channel of the gaps in a run file.
const GAPS: &str = "recorder/gap";
/// Reason stored in a file that was closed because the disk was full.
pub const ENDED_DISK_FULL: &str = "the disk was full";

enum State {
    Recording(Box<Recording>),
    DiskFull,
    Failed { retry_ns: u64 },
}

/// Manages the files of a run. Time and free space are arguments of its functions.
pub struct Session {
    settings: Settings,
    clock: RunClock,
    state: State,
    rows: Vec<Row>,
    /// Files that are being finished, each in a thread, because the last step waits for the disk.
    finishing: Vec<JoinHandle<Result<PathBuf, RunError>>>,
    free_bytes: u64,
    next_flush_ns: u64,
    next_watch_ns: u64,
    total_messages: u64,
    total_bytes: u64,
    gaps: u64,
    /// Cause of the present gap, `RecorderGap::CAUSE_*`.
    cause: u8,
    files: u64,
    file: String,
    /// Why nothing is being recorded, and what to do; empty while recording.
    reason: String,
    /// Whether a file of this session could not be finished.
    unfinished: bool,
    /// Whether the file was removed or moved while it was written.
    removed: bool,
    /// Attachments of the last file. The next file has them too, even if they were removed from the run folder.
    attachments: Vec<Attachment>,
    /// Whether the last check could not determine if the file still exists.
    unseen: bool,
}

impl Session {
    /// Opens the first file of a run.
    ///
    /// # Errors
    /// The folder cannot be written. A full disk is no error: the session waits for free space.
    pub fn open(settings: Settings, clock: RunClock, now_ns: u64, free_bytes: u64) -> Result<Self, RunError> {
        let mut session = Self {
            settings,
            clock,
            state: State::DiskFull,
            rows: Vec::new(),
            finishing: Vec::new(),
            free_bytes,
            next_flush_ns: now_ns,
            next_watch_ns: now_ns,
            total_messages: 0,
            total_bytes: 0,
            gaps: 0,
            cause: RecorderGap::CAUSE_DISK_FULL,
            files: 0,
            file: String::new(),
            reason: String::new(),
            unfinished: false,
            removed: false,
            attachments: Vec::new(),
            unseen: false,
        };
        if free_bytes < session.settings.min_free_bytes {
            session.report_full();
        } else {
            session.begin(now_ns)?;
        }
        Ok(session)
    }

    /// Starts a file with every written channel and the last sample of static channels. A present file is finished in a
    /// thread.
    fn begin(&mut self, now_ns: u64) -> Result<(), RunError> {
        if self.files > 0 {
            // Create the run folder again if it was removed.
            let folder = &self.settings.folder;
            std::fs::create_dir_all(folder).map_err(|source| RunError::Io {
                path: folder.clone(),
                what: "create the folder of the run again",
                source,
            })?;
        }
        let path = next_file(&self.settings.folder);
        let mut about = self.settings.about.clone();
        about.insert("segment".to_owned(), number_of(&path).to_string());
        let attachments = self.run_attachments();
        let mut writer = RunWriter::create(&path, self.clock, &about, &attachments)?;
        let ids = match self.repeat(&mut writer, now_ns) {
            Ok(ids) => ids,
            Err(error) => {
                // The file contains only repeated samples, so it can be removed.
                writer.abandon();
                return Err(error);
            }
        };
        if self.removed {
            tracing::warn!("started a new file, because the last one was removed or moved: {}", path.display());
        }
        tracing::info!("recording to {}", path.display());
        self.file = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        self.files += 1;
        (self.removed, self.reason) = (false, String::new());
        self.attachments.clone_from(&attachments);
        let before = std::mem::replace(&mut self.state, State::DiskFull);
        let before = if let State::Recording(before) = before { self.settle_file(before) } else { None };
        for (row, id) in self.rows.iter_mut().zip(ids) {
            row.id = id;
            let repeated = row.id.is_some() && row.silent_since(now_ns.saturating_sub(STATIC_NS)).is_some();
            if let Some(bytes) = if repeated { row.restore_newest() } else { None } {
                self.total_messages += 1;
                self.total_bytes += bytes;
            }
        }
        let split_ns = now_ns.saturating_add(self.settings.segment_ns);
        self.state = State::Recording(Box::new(Recording::new(writer, now_ns, split_ns, &attachments)));
        if let Some(before) = before {
            let summary = self.summary("the next file was started");
            self.finishing.push(std::thread::spawn(move || before.finish(&attachments, &summary)));
        }
        Ok(())
    }

    /// Returns the attachments of the next run file: the files of the run folder, and attachments of the last file that
    /// were removed from it. The configuration comes first.
    fn run_attachments(&self) -> Vec<Attachment> {
        let mut files = run_attachments(&self.settings.folder);
        let lost = self.attachments.iter().filter(|file| !files.iter().any(|present| present.name == file.name));
        let lost: Vec<Attachment> = lost.cloned().collect();
        files.extend(lost);
        files.sort_by_key(|file| file.name.contains('/'));
        files
    }

    /// Writes the channels and the last samples of static channels to a new file; returns the ids of the channels.
    fn repeat(&self, writer: &mut RunWriter, now_ns: u64) -> Result<Vec<Option<ChannelId>>, RunError> {
        let mut ids = vec![None; self.rows.len()];
        for (row, id) in self.rows.iter().zip(&mut ids).filter(|(row, _)| row.messages() > 0) {
            let known = *id.insert(writer.add_channel(&row.spec)?);
            if let Some((last, sample)) = row.silent_since(now_ns.saturating_sub(STATIC_NS)) {
                writer.write(known, last.seq, now_ns, last.stamp_ns, sample)?;
            }
        }
        writer.flush()?;
        Ok(ids)
    }

    /// Adds a channel, and returns its index. The channel is written with its first sample. A channel that is already
    /// known is not added again.
    pub fn declare(&mut self, spec: ChannelSpec) -> usize {
        if let Some(known) = self.rows.iter().position(|row| row.spec == spec) {
            return known;
        }
        self.rows.push(Row::new(spec));
        self.rows.len() - 1
    }

    /// Returns the channels.
    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Writes a sorted batch that was received at `received_ns`. What cannot be written is counted as lost; nothing
    /// here is an error to the caller.
    pub fn write(&mut self, batch: &Batch, received_ns: u64, now_ns: u64) {
        for (received, sample) in batch.iter() {
            let written = match self.write_one(received, sample) {
                Ok(written) => written,
                Err((RunError::Size { .. }, _)) => false,
                Err((error, of_sample)) => {
                    if self.fail(&error, now_ns) && of_sample {
                        self.count(received, Some(sample));
                        self.settle();
                        continue;
                    }
                    false
                }
            };
            self.count(received, written.then_some(sample));
            if let Some(row) = self.rows.get_mut(received.row) {
                row.record_lag(now_ns.saturating_sub(received_ns));
            }
            let settled =
                if let State::Recording(recording) = &mut self.state { recording.has_settled() } else { false };
            if settled {
                self.settle();
            }
        }
    }

    /// Counts a sample that was written or, with `None`, was not.
    fn count(&mut self, received: &ReceivedSample, written: Option<&[u8]>) {
        let Some(row) = self.rows.get_mut(received.row) else { return };
        match written {
            Some(sample) => {
                row.record_written(received, sample);
                self.total_messages += 1;
                self.total_bytes += sample.len() as u64;
            }
            None => row.record_unwritten(received),
        }
    }

    /// Marks all written samples as permanent in the file.
    fn settle(&mut self) {
        self.rows.iter_mut().for_each(Row::settle);
    }

    /// Reverts the counts of samples written since the file last settled, which are in no file.
    fn take_back(&mut self) {
        for row in &mut self.rows {
            let (lost, bytes) = row.take_back();
            self.total_messages -= lost;
            self.total_bytes -= bytes;
        }
    }

    /// Writes a sample, and a gap before it; returns false if nothing is being recorded. With an error it returns
    /// whether the sample itself caused it.
    fn write_one(&mut self, received: &ReceivedSample, sample: &[u8]) -> Result<bool, (RunError, bool)> {
        let State::Recording(recording) = &mut self.state else { return Ok(false) };
        let Recording { writer, gaps, .. } = &mut **recording;
        let Some(row) = self.rows.get_mut(received.row) else { return Ok(false) };
        let before = |error| (error, false);
        let id = match row.id {
            Some(id) => id,
            None => {
                let id = writer.add_channel(&row.spec).map_err(before)?;
                if let Some(why) = writer.refusal(id) {
                    tracing::warn!("channel {} is recorded as plain bytes: {why}", row.spec.name);
                }
                *row.id.insert(id)
            }
        };
        if let Some(mut gap) = row.gap(received, self.cause) {
            self.gaps += 1;
            gap.header.seq = self.gaps;
            (gap.header.stamp_ns, gap.header.oldest_input_ns) = (received.logged_ns, received.logged_ns);
            let id = match *gaps {
                Some(id) => id,
                None => *gaps.insert(writer.add_channel(&ChannelSpec::for_type::<RecorderGap>(GAPS)).map_err(before)?),
            };
            let gap = bytemuck::bytes_of(&gap);
            writer.write(id, self.gaps, received.logged_ns, received.logged_ns, gap).map_err(before)?;
        }
        writer.write(id, received.seq, received.logged_ns, received.stamp_ns, sample).map_err(|error| (error, true))?;
        Ok(true)
    }

    /// Returns whether [`Session::tick`] needs the free space.
    #[must_use]
    pub fn wants_free_bytes(&self, now_ns: u64) -> bool {
        now_ns >= self.next_watch_ns
    }

    /// Does the periodic work: flushes, starts the next file when one is large or old enough, stops when the disk is
    /// full, and resumes when there is space. Call it after every batch.
    pub fn tick(&mut self, now_ns: u64, free_bytes: Option<u64>) {
        if let Some(free_bytes) = free_bytes {
            self.free_bytes = free_bytes;
            self.next_watch_ns = now_ns + WATCH_NS;
            self.join_finished();
            if let State::Recording(recording) = &mut self.state {
                recording.report_sync();
            }
        }
        if free_bytes.is_some() && self.check_removal(now_ns) {
            return;
        }
        let room = self.free_bytes as f64 >= self.settings.min_free_bytes as f64 * ROOM_FACTOR;
        match &mut self.state {
            State::Recording(_) if self.free_bytes < self.settings.min_free_bytes => {
                self.report_full();
                if let Err(error) = self.end(ENDED_DISK_FULL) {
                    tracing::error!("{error}");
                    self.unfinished = true;
                }
                self.cause = RecorderGap::CAUSE_DISK_FULL;
            }
            State::Recording(recording)
                if now_ns >= recording.split_ns
                    || (recording.writer.bytes() >= self.settings.segment_bytes && now_ns > recording.begun_ns) =>
            {
                // If the next file cannot be started, this one continues.
                recording.split_ns = now_ns + RETRY_NS;
                recording.begun_ns = recording.split_ns;
                if let Err(error) = self.begin(now_ns) {
                    tracing::error!("{error}; the present file continues, next attempt in {} s", RETRY_NS / SECOND_NS);
                }
            }
            State::Recording(recording) if now_ns >= self.next_flush_ns => {
                self.next_flush_ns = now_ns + self.settings.flush_ns;
                match recording.flush() {
                    Ok(()) => self.settle(),
                    Err(error) => {
                        self.fail(&error, now_ns);
                    }
                }
            }
            State::Recording(_) => {}
            State::DiskFull if room => self.resume(now_ns),
            State::Failed { retry_ns } if now_ns >= *retry_ns && room => self.resume(now_ns),
            State::DiskFull | State::Failed { .. } => {}
        }
    }

    /// Abandons the file if it was removed or moved, because writes to it would be lost without an error; returns
    /// whether it was.
    fn check_removal(&mut self, now_ns: u64) -> bool {
        let State::Recording(recording) = &self.state else { return false };
        let writer = &recording.writer;
        let seen = writer.exists();
        let was_unseen = std::mem::replace(&mut self.unseen, seen.is_err());
        match seen {
            Ok(false) => {}
            Ok(true) => return false,
            // The file may still exist, so continue to write it.
            Err(error) => {
                if !was_unseen {
                    let file = writer.path().display();
                    tracing::warn!(
                        "{file}: cannot check whether the file still exists ({error}); the recording continues"
                    );
                }
                return false;
            }
        }
        let error = RunError::Removed { path: writer.path().to_owned() };
        self.removed = true;
        // Settled samples are lost too, but only the later ones can still be counted.
        self.fail(&error, now_ns);
        true
    }

    fn resume(&mut self, now_ns: u64) {
        if let Err(error) = self.begin(now_ns) {
            self.fail(&error, now_ns);
        }
    }

    /// Abandons the file after an error; returns whether it contains all written samples nevertheless.
    fn fail(&mut self, error: &RunError, now_ns: u64) -> bool {
        self.reason = error.to_string();
        let pause_ns = if matches!(error, RunError::Removed { .. }) { REMOVED_NS } else { RETRY_NS };
        tracing::error!("NOTHING IS BEING RECORDED: {error}; next file in {} s", pause_ns / SECOND_NS);
        let failed = State::Failed { retry_ns: now_ns + pause_ns };
        self.cause = RecorderGap::CAUSE_FAILED;
        match std::mem::replace(&mut self.state, failed) {
            State::Recording(recording) => self.abandon_file(*recording),
            State::DiskFull | State::Failed { .. } => false,
        }
    }

    /// Abandons a file that can no longer be written; returns whether it contains all written samples nevertheless.
    fn abandon_file(&mut self, recording: Recording) -> bool {
        self.unfinished = true;
        let whole = recording.writer.give_up();
        if whole {
            self.settle();
        } else {
            self.take_back();
        }
        whole
    }

    /// Closes the last chunk of a file before it is finished; returns `None` if that fails.
    fn settle_file(&mut self, mut recording: Box<Recording>) -> Option<Box<Recording>> {
        match recording.flush() {
            Ok(()) => {
                self.settle();
                Some(recording)
            }
            Err(error) => {
                tracing::error!("{error}");
                self.abandon_file(*recording);
                None
            }
        }
    }

    fn report_full(&mut self) {
        let folder = self.settings.folder.clone();
        let full = DiskFull { folder, free_bytes: self.free_bytes, needed_bytes: self.settings.min_free_bytes };
        self.reason = full.to_string();
        tracing::error!("NOTHING IS BEING RECORDED: {}", self.reason);
    }

    fn join_finished(&mut self) {
        while let Some(at) = self.finishing.iter().position(JoinHandle::is_finished) {
            if let Err(error) = joined(self.finishing.swap_remove(at)) {
                tracing::error!("{error}");
                self.unfinished = true;
            }
        }
    }

    /// Returns the summary of the run so far for the end of a file.
    fn summary(&self, reason: &str) -> BTreeMap<String, String> {
        let lost = self.rows.iter().fold(0_u64, |sum, row| sum.saturating_add(row.lost()));
        let mut summary = BTreeMap::from([
            ("reason".to_owned(), reason.to_owned()),
            ("messages".to_owned(), self.total_messages.to_string()),
            ("lost".to_owned(), lost.to_string()),
            ("gaps".to_owned(), self.rows.iter().map(Row::gaps).sum::<u64>().to_string()),
        ]);
        for row in self.rows.iter().filter(|row| row.lost() > 0) {
            summary.insert(format!("lost {}", row.spec.name), format!("{} in {} gaps", row.lost(), row.gaps()));
        }
        for row in self.rows.iter().filter(|row| row.messages() > 0) {
            summary.insert(format!("messages {}", row.spec.name), row.messages().to_string());
        }
        summary
    }

    fn end(&mut self, reason: &str) -> Result<Option<PathBuf>, RunError> {
        let State::Recording(mut recording) = std::mem::replace(&mut self.state, State::DiskFull) else {
            return Ok(None);
        };
        if let Err(error) = recording.flush() {
            self.abandon_file(*recording);
            return Err(error);
        }
        self.settle();
        recording.finish(&run_attachments(&self.settings.folder), &self.summary(reason)).map(Some)
    }

    /// Returns one sample of `recorder/status` per channel.
    pub fn status(&self, now_ns: u64) -> impl Iterator<Item = RecorderStatus> {
        self.rows.iter().map(move |row| {
            let mut status = row.status();
            status.total_messages = self.total_messages;
            status.total_bytes = self.total_bytes;
            status.disk_free_bytes = self.free_bytes;
            status.state = match self.state {
                State::Recording(_) => RecorderStatus::STATE_RECORDING,
                State::DiskFull => RecorderStatus::STATE_DISK_FULL,
                State::Failed { .. } => RecorderStatus::STATE_FAILED,
            };
            status.header_mut().stamp_ns = now_ns;
            status.header_mut().oldest_input_ns = now_ns;
            status.removed = self.removed.into();
            put_text(&mut status.file, &self.file);
            put_sentence(&mut status.reason, &self.reason);
            status
        })
    }

    /// Returns true once if a file of this session must be recovered and recording has resumed.
    pub fn wants_recovery(&mut self) -> bool {
        self.is_recording() && std::mem::take(&mut self.unfinished)
    }

    /// Returns the run folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.settings.folder
    }

    /// Returns the free space below which recording stops, bytes.
    #[must_use]
    pub fn min_free_bytes(&self) -> u64 {
        self.settings.min_free_bytes
    }

    /// Returns the final name of the present or last file.
    #[must_use]
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Returns whether samples are being recorded.
    #[must_use]
    pub fn is_recording(&self) -> bool {
        matches!(self.state, State::Recording(_))
    }

    /// Finishes the file, and waits for those that are being finished; returns `None` if nothing was being recorded.
    ///
    /// # Errors
    /// A file could not be finished; it can be recovered.
    pub fn close(mut self, reason: &str) -> Result<Option<PathBuf>, RunError> {
        let last = self.end(reason);
        for thread in self.finishing.drain(..) {
            joined(thread)?;
        }
        last
    }
}

/// Returns the number of a run file by its name, which counts those of earlier recorders of the run too.
fn number_of(file: &Path) -> u64 {
    let stem = file.file_stem().and_then(|stem| stem.to_str());
    stem.and_then(|stem| stem.strip_prefix("run-")?.parse().ok()).unwrap_or(1)
}

fn joined(thread: JoinHandle<Result<PathBuf, RunError>>) -> Result<(), RunError> {
    match thread.join() {
        Ok(finished) => finished.map(|_| ()),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}
