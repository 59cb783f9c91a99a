//! The files of one run: opened, fed, flushed, split, given up and begun anew.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

use messages::{Message, RecorderGap, RecorderStatus, put_sentence, put_text};
use runlog::{Attachment, ChannelId, ChannelSpec, RunClock, RunError, RunWriter, next_file, run_attachments};

use crate::batch::{Batch, Heard};
use crate::recording::Recording;
use crate::row::Row;

const SECOND_NS: u64 = 1_000_000_000;
/// How often the free space is looked at.
const WATCH_NS: u64 = SECOND_NS / 2;
/// How long after a failure another file is tried.
const RETRY_NS: u64 = 5 * SECOND_NS;
/// And how long after the file was removed: nothing says that the next one cannot be written.
const REMOVED_NS: u64 = SECOND_NS;
/// Recording goes on when there is a tenth more room than it stopped at, so that it does not begin a file every second.
const ROOM_FACTOR: f64 = 1.1;
/// A channel that has been silent for this long when a file ends is static: its last sample begins the next file, so that this can be
/// understood alone. Everything that says its state regularly does so once a second.
const STATIC_NS: u64 = 2 * SECOND_NS;
/// Where the gaps stand in the file.
const GAPS: &str = "recorder/gap";
/// What a file says of its end that was closed because the disk is full.
pub const ENDED_DISK_FULL: &str = "the disk was full";

/// Nothing is recorded, because there is no room.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the disk is full: {:.0} MB are free at {}, and at least {:.0} MB are needed; make room and it goes on",
    *free_bytes as f64 / 1e6, folder.display(), *needed_bytes as f64 / 1e6
)]
pub struct DiskFull {
    /// Of the run.
    pub folder: PathBuf,
    /// Bytes that can be written there.
    pub free_bytes: u64,
    /// Bytes that have to be free.
    pub needed_bytes: u64,
}

/// What a recording needs to know.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The run folder. The files that describe the run in it are kept inside every run file.
    pub folder: PathBuf,
    /// Recording stops below this much free space.
    pub min_free_bytes: u64,
    /// Longest time before samples are handed to the disk, ns.
    pub flush_ns: u64,
    /// Another file is begun when one has this size, bytes.
    pub segment_bytes: u64,
    /// And when it is this old, ns.
    pub segment_ns: u64,
    /// Who, what, with which versions.
    pub about: BTreeMap<String, String>,
}

enum State {
    Recording(Box<Recording>),
    DiskFull,
    Failed { retry_ns: u64 },
}

/// Decides about the files of a run. The time and the free space are told to it.
pub struct Session {
    settings: Settings,
    clock: RunClock,
    state: State,
    rows: Vec<Row>,
    /// Files that are being finished, each in a thread of its own: the last step waits for the disk.
    finishing: Vec<JoinHandle<Result<PathBuf, RunError>>>,
    free_bytes: u64,
    next_flush_ns: u64,
    next_watch_ns: u64,
    total_messages: u64,
    total_bytes: u64,
    gaps: u64,
    /// Why the samples that went to no file did not.
    cause: u8,
    files: u64,
    file: String,
    /// Why nothing is being recorded, and what to do; empty while it is.
    reason: String,
    /// A file of this session could not be finished.
    unfinished: bool,
    /// The file was removed or moved while it was written.
    removed: bool,
    /// What the last file began with beside its samples: the next one is to begin with it even where the run folder has lost it.
    kept: Vec<Attachment>,
    /// It could not be seen at the last look whether the file is still there.
    unseen: bool,
}

impl Session {
    /// Begins the first file of a run.
    ///
    /// # Errors
    /// The folder cannot be written. A disk that is too full is no error: the session waits for room.
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
            kept: Vec::new(),
            unseen: false,
        };
        if free_bytes < session.settings.min_free_bytes {
            session.say_full();
        } else {
            session.begin(now_ns)?;
        }
        Ok(session)
    }

    /// Begins a file with every channel that has been written, and the last sample of those that rarely speak. The file before, if one is
    /// being written, is finished behind.
    fn begin(&mut self, now_ns: u64) -> Result<(), RunError> {
        if self.files > 0 {
            // The run is worth more than the folder that it stood in.
            let folder = &self.settings.folder;
            std::fs::create_dir_all(folder).map_err(|source| RunError::Io {
                path: folder.clone(),
                what: "make the folder of the run again",
                source,
            })?;
        }
        let path = next_file(&self.settings.folder);
        let mut about = self.settings.about.clone();
        about.insert("segment".to_owned(), (self.files + 1).to_string());
        let kept = self.run_attachments();
        let mut writer = RunWriter::create(&path, self.clock, &about, &kept)?;
        let ids = match self.repeat(&mut writer, now_ns) {
            Ok(ids) => ids,
            Err(error) => {
                // nothing is in it that does not stand elsewhere
                writer.abandon();
                return Err(error);
            }
        };
        if self.removed {
            tracing::warn!("a new file is begun in the place of the one that was removed or moved: {}", path.display());
        }
        tracing::info!("recording to {}", path.display());
        self.file = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        self.files += 1;
        (self.removed, self.reason) = (false, String::new());
        self.kept.clone_from(&kept);
        let before = std::mem::replace(&mut self.state, State::DiskFull);
        let before = if let State::Recording(before) = before { self.settle_file(before) } else { None };
        for (row, id) in self.rows.iter_mut().zip(ids) {
            row.id = id;
            let repeated = row.id.is_some() && row.silent_since(now_ns.saturating_sub(STATIC_NS)).is_some();
            if repeated && row.found_again() {
                self.total_messages += 1;
                self.total_bytes += row.spec.size as u64;
            }
        }
        let split_ns = now_ns.saturating_add(self.settings.segment_ns);
        self.state = State::Recording(Box::new(Recording::new(writer, now_ns, split_ns, &kept)));
        if let Some(before) = before {
            let summary = self.summary("the next file was begun");
            self.finishing.push(std::thread::spawn(move || before.finish(&kept, &summary)));
        }
        Ok(())
    }

    /// The files beside the samples that the next run file begins with: those of the run folder, and those that the file before began with
    /// and that are no longer there. The configuration comes first.
    fn run_attachments(&self) -> Vec<Attachment> {
        let mut kept = run_attachments(&self.settings.folder);
        let lost = self.kept.iter().filter(|file| !kept.iter().any(|present| present.name == file.name));
        let lost: Vec<Attachment> = lost.cloned().collect();
        kept.extend(lost);
        kept.sort_by_key(|file| file.name.contains('/'));
        kept
    }

    /// Writes what of the run so far a new file has to know.
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

    /// Adds a channel; it appears in the file with its first sample. The same channel twice is one.
    pub fn declare(&mut self, spec: ChannelSpec) -> usize {
        if let Some(known) = self.rows.iter().position(|row| row.spec == spec) {
            return known;
        }
        self.rows.push(Row::new(spec));
        self.rows.len() - 1
    }

    /// The channels so far.
    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Writes a sorted batch that was heard at `heard_ns`. What cannot be written is counted as lost; nothing here is an error to the caller.
    pub fn write(&mut self, batch: &Batch, heard_ns: u64, now_ns: u64) {
        for (heard, sample) in batch.iter() {
            let written = match self.write_one(heard, sample) {
                Ok(written) => written,
                Err((RunError::Size { .. }, _)) => false,
                Err((error, of_sample)) => {
                    if self.fail(&error, now_ns) && of_sample {
                        self.note(heard, Some(sample));
                        self.settle();
                        continue;
                    }
                    false
                }
            };
            self.note(heard, written.then_some(sample));
            if let Some(row) = self.rows.get_mut(heard.row) {
                row.lagged(now_ns.saturating_sub(heard_ns));
            }
            let settled =
                if let State::Recording(recording) = &mut self.state { recording.has_settled() } else { false };
            if settled {
                self.settle();
            }
        }
    }

    /// Counts a sample that was written, or (`None`) that was not.
    fn note(&mut self, heard: &Heard, written: Option<&[u8]>) {
        let Some(row) = self.rows.get_mut(heard.row) else { return };
        match written {
            Some(sample) => {
                row.written(heard, sample);
                self.total_messages += 1;
                self.total_bytes += sample.len() as u64;
            }
            None => row.not_written(heard),
        }
    }

    /// All that was written stays in the file.
    fn settle(&mut self) {
        self.rows.iter_mut().for_each(Row::settle);
    }

    /// What was written since the file last settled is in no file.
    fn take_back(&mut self) {
        for row in &mut self.rows {
            let lost = row.take_back();
            self.total_messages -= lost;
            self.total_bytes -= lost * row.spec.size as u64;
        }
    }

    /// False if nothing is being recorded. An error says whether it came with the sample itself.
    fn write_one(&mut self, heard: &Heard, sample: &[u8]) -> Result<bool, (RunError, bool)> {
        let State::Recording(recording) = &mut self.state else { return Ok(false) };
        let Recording { writer, gaps, .. } = &mut **recording;
        let Some(row) = self.rows.get_mut(heard.row) else { return Ok(false) };
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
        if let Some(mut gap) = row.gap(heard, self.cause) {
            self.gaps += 1;
            gap.header.seq = self.gaps;
            (gap.header.stamp_ns, gap.header.oldest_input_ns) = (heard.logged_ns, heard.logged_ns);
            let id = match *gaps {
                Some(id) => id,
                None => *gaps.insert(writer.add_channel(&ChannelSpec::of::<RecorderGap>(GAPS)).map_err(before)?),
            };
            let gap = bytemuck::bytes_of(&gap);
            writer.write(id, self.gaps, heard.logged_ns, heard.logged_ns, gap).map_err(before)?;
        }
        writer.write(id, heard.seq, heard.logged_ns, heard.stamp_ns, sample).map_err(|error| (error, true))?;
        Ok(true)
    }

    /// Whether [`Session::tick`] wants to know the free space.
    #[must_use]
    pub fn wants_free_bytes(&self, now_ns: u64) -> bool {
        now_ns >= self.next_watch_ns
    }

    /// Flushes when it is time, begins the next file when one is large or old enough, stops when the disk is too full, goes on when there is
    /// room. Call it after every batch.
    pub fn tick(&mut self, now_ns: u64, free_bytes: Option<u64>) {
        if let Some(free_bytes) = free_bytes {
            self.free_bytes = free_bytes;
            self.next_watch_ns = now_ns + WATCH_NS;
            self.look_at_finished();
            if let State::Recording(recording) = &mut self.state {
                recording.look_at_disk();
            }
        }
        if free_bytes.is_some() && self.look_for_removal(now_ns) {
            return;
        }
        let room = self.free_bytes as f64 >= self.settings.min_free_bytes as f64 * ROOM_FACTOR;
        match &mut self.state {
            State::Recording(_) if self.free_bytes < self.settings.min_free_bytes => {
                self.say_full();
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
                // where the next file cannot be begun, this one goes on
                recording.split_ns = now_ns + RETRY_NS;
                recording.begun_ns = recording.split_ns;
                if let Err(error) = self.begin(now_ns) {
                    tracing::error!("{error}; the file before goes on, trying again in {} s", RETRY_NS / SECOND_NS);
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
            State::DiskFull if room => self.begin_again(now_ns),
            State::Failed { retry_ns } if now_ns >= *retry_ns && room => self.begin_again(now_ns),
            State::DiskFull | State::Failed { .. } => {}
        }
    }

    /// Notices that somebody removed or moved the file: what is written to it goes nowhere, and without an error. True if it was.
    fn look_for_removal(&mut self, now_ns: u64) -> bool {
        let State::Recording(recording) = &self.state else { return false };
        let writer = &recording.writer;
        let seen = writer.is_there();
        let was_unseen = std::mem::replace(&mut self.unseen, seen.is_err());
        match seen {
            Ok(false) => {}
            Ok(true) => return false,
            // What is written may well arrive: no reason to leave the file.
            Err(error) => {
                if !was_unseen {
                    let file = writer.path().display();
                    tracing::warn!(
                        "{file}: it cannot be seen whether the file is still there ({error}); the recording goes on"
                    );
                }
                return false;
            }
        }
        let error = RunError::Removed { path: writer.path().to_owned() };
        self.removed = true;
        // What had been settled there is gone too, but only what comes now can still be counted.
        self.fail(&error, now_ns);
        true
    }

    fn begin_again(&mut self, now_ns: u64) {
        if let Err(error) = self.begin(now_ns) {
            self.fail(&error, now_ns);
        }
    }

    /// Leaves the file, if one is being written; true if all that was written is in it nevertheless.
    fn fail(&mut self, error: &RunError, now_ns: u64) -> bool {
        self.reason = error.to_string();
        let pause_ns = if matches!(error, RunError::Removed { .. }) { REMOVED_NS } else { RETRY_NS };
        tracing::error!("NOTHING IS BEING RECORDED: {error}; trying another file in {} s", pause_ns / SECOND_NS);
        let failed = State::Failed { retry_ns: now_ns + pause_ns };
        self.cause = RecorderGap::CAUSE_FAILED;
        match std::mem::replace(&mut self.state, failed) {
            State::Recording(recording) => self.leave(*recording),
            State::DiskFull | State::Failed { .. } => false,
        }
    }

    /// Leaves a file that cannot be written any more; true if all that was written is in it nevertheless.
    fn leave(&mut self, recording: Recording) -> bool {
        self.unfinished = true;
        let whole = recording.writer.give_up();
        if whole {
            self.settle();
        } else {
            self.take_back();
        }
        whole
    }

    /// Closes the last chunk of a file that is to be finished; `None` if that fails.
    fn settle_file(&mut self, mut recording: Box<Recording>) -> Option<Box<Recording>> {
        match recording.flush() {
            Ok(()) => {
                self.settle();
                Some(recording)
            }
            Err(error) => {
                tracing::error!("{error}");
                self.leave(*recording);
                None
            }
        }
    }

    fn say_full(&mut self) {
        let folder = self.settings.folder.clone();
        let full = DiskFull { folder, free_bytes: self.free_bytes, needed_bytes: self.settings.min_free_bytes };
        self.reason = full.to_string();
        tracing::error!("NOTHING IS BEING RECORDED: {}", self.reason);
    }

    fn look_at_finished(&mut self) {
        while let Some(at) = self.finishing.iter().position(JoinHandle::is_finished) {
            if let Err(error) = joined(self.finishing.swap_remove(at)) {
                tracing::error!("{error}");
                self.unfinished = true;
            }
        }
    }

    /// What the end of a file says of the run so far.
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
            self.leave(*recording);
            return Err(error);
        }
        self.settle();
        recording.finish(&run_attachments(&self.settings.folder), &self.summary(reason)).map(Some)
    }

    /// One sample of `recorder/status` per channel.
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
            put_text(&mut status.file, &self.file);
            put_sentence(&mut status.reason, &self.reason);
            status
        })
    }

    /// Whether a file of this session waits to be recovered, now that there is room again; true once.
    pub fn wants_recovery(&mut self) -> bool {
        self.is_recording() && std::mem::take(&mut self.unfinished)
    }

    /// The folder of the run.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.settings.folder
    }

    /// The final name of the present or last file.
    #[must_use]
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Whether samples go to a file at present.
    #[must_use]
    pub fn is_recording(&self) -> bool {
        matches!(self.state, State::Recording(_))
    }

    /// Finishes the file, and those that are still being finished; `None` if nothing was being recorded.
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

fn joined(thread: JoinHandle<Result<PathBuf, RunError>>) -> Result<(), RunError> {
    match thread.join() {
        Ok(finished) => finished.map(|_| ()),
        Err(panic) => std::panic::resume_unwind(panic),
    }
}
