//! The files of one run: opened, fed, flushed, given up and begun anew.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use messages::schema::Schema;
use messages::{RecorderStatus, put_text};
use runlog::{Attachment, ChannelId, ChannelSpec, RunClock, RunError, RunWriter, next_file};

use crate::batch::{Batch, Heard};

const SECOND_NS: u64 = 1_000_000_000;
/// How often the free space is looked at.
const WATCH_NS: u64 = SECOND_NS;
/// How long after a failure another file is tried.
const RETRY_NS: u64 = 5 * SECOND_NS;
/// Recording goes on when there is a tenth more room than it stopped at, so that it does not begin a file every second.
const ROOM_FACTOR: f64 = 1.1;

/// What a recording needs to know.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The run folder.
    pub folder: PathBuf,
    /// Recording stops below this much free space.
    pub min_free_bytes: u64,
    /// Longest time before samples are handed to the disk, ns.
    pub flush_ns: u64,
    /// Who, what, with which versions.
    pub about: BTreeMap<String, String>,
    /// Files to be kept inside every run file.
    pub attachments: Vec<Attachment>,
}

/// A channel of the session.
#[derive(Debug)]
pub struct Row {
    spec: ChannelSpec,
    /// Number and time of a sample can be read.
    has_header: bool,
    id: Option<ChannelId>,
    messages: u64,
    bytes: u64,
    lost: u64,
    gaps: u64,
    worst_lag_ns: u64,
}

impl Row {
    /// The channel.
    #[must_use]
    pub fn spec(&self) -> &ChannelSpec {
        &self.spec
    }

    /// Whether a sample begins with the header that all of this project's samples have.
    #[must_use]
    pub fn has_header(&self) -> bool {
        self.has_header
    }

    /// Samples written.
    #[must_use]
    pub fn messages(&self) -> u64 {
        self.messages
    }

    /// Samples that are not in the file.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

enum State {
    Recording(Box<RunWriter>),
    DiskFull,
    Failed { retry_ns: u64 },
}

/// Decides about the files of a run. The time and the free space are told to it.
pub struct Session {
    settings: Settings,
    clock: RunClock,
    state: State,
    rows: Vec<Row>,
    free_bytes: u64,
    next_flush_ns: u64,
    next_watch_ns: u64,
    total_messages: u64,
    total_bytes: u64,
    file: String,
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
            free_bytes,
            next_flush_ns: now_ns,
            next_watch_ns: now_ns,
            total_messages: 0,
            total_bytes: 0,
            file: String::new(),
        };
        if free_bytes < session.settings.min_free_bytes {
            session.say_full();
        } else {
            session.begin()?;
        }
        Ok(session)
    }

    fn begin(&mut self) -> Result<(), RunError> {
        let path = next_file(&self.settings.folder);
        let writer = RunWriter::create(&path, self.clock, &self.settings.about, &self.settings.attachments)?;
        tracing::info!("recording to {}", path.display());
        self.file = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        for row in &mut self.rows {
            row.id = None;
        }
        self.state = State::Recording(Box::new(writer));
        Ok(())
    }

    /// Adds a channel; it appears in the file with its first sample. The same channel twice is one.
    pub fn declare(&mut self, spec: ChannelSpec) -> usize {
        if let Some(known) = self.rows.iter().position(|row| row.spec == spec) {
            return known;
        }
        let has_header = Schema::parse(&spec.schema).is_ok_and(|schema| schema.has_header());
        let (messages, bytes, lost, gaps, worst_lag_ns) = (0, 0, 0, 0, 0);
        self.rows.push(Row { spec, has_header, id: None, messages, bytes, lost, gaps, worst_lag_ns });
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
            let written = self.write_one(heard, sample);
            if let Err(error) = &written
                && !matches!(error, RunError::Size { .. })
            {
                tracing::error!("{error}; trying another file in {} s", RETRY_NS / SECOND_NS);
                self.state = State::Failed { retry_ns: now_ns + RETRY_NS };
            }
            let written = matches!(written, Ok(true));
            let Some(row) = self.rows.get_mut(heard.row) else { continue };
            // a publisher of another build may number as it likes
            row.lost = row.lost.saturating_add(heard.missing);
            row.gaps += u64::from(heard.missing > 0);
            row.worst_lag_ns = row.worst_lag_ns.max(now_ns.saturating_sub(heard_ns));
            if written {
                row.messages += 1;
                row.bytes += sample.len() as u64;
                self.total_messages += 1;
                self.total_bytes += sample.len() as u64;
            } else {
                row.lost = row.lost.saturating_add(1);
            }
        }
    }

    /// False if nothing is being recorded.
    fn write_one(&mut self, heard: &Heard, sample: &[u8]) -> Result<bool, RunError> {
        let State::Recording(writer) = &mut self.state else { return Ok(false) };
        let Some(row) = self.rows.get_mut(heard.row) else { return Ok(false) };
        let id = match row.id {
            Some(id) => id,
            None => {
                let id = writer.add_channel(&row.spec)?;
                if let Some(why) = writer.refusal(id) {
                    tracing::warn!("channel {} is recorded as plain bytes: {why}", row.spec.name);
                }
                *row.id.insert(id)
            }
        };
        writer.write(id, heard.seq, heard.logged_ns, heard.stamp_ns, sample)?;
        Ok(true)
    }

    /// Whether [`Session::tick`] wants to know the free space.
    #[must_use]
    pub fn wants_free_bytes(&self, now_ns: u64) -> bool {
        now_ns >= self.next_watch_ns
    }

    /// Flushes when it is time, stops when the disk is too full, goes on when there is room. Call it after every batch.
    pub fn tick(&mut self, now_ns: u64, free_bytes: Option<u64>) {
        if let Some(free_bytes) = free_bytes {
            self.free_bytes = free_bytes;
            self.next_watch_ns = now_ns + WATCH_NS;
        }
        let room = self.free_bytes as f64 >= self.settings.min_free_bytes as f64 * ROOM_FACTOR;
        match &mut self.state {
            State::Recording(_) if self.free_bytes < self.settings.min_free_bytes => {
                self.say_full();
                if let Err(error) = self.end("the disk was full") {
                    tracing::error!("{error}");
                }
                self.state = State::DiskFull;
            }
            State::Recording(writer) if now_ns >= self.next_flush_ns => {
                self.next_flush_ns = now_ns + self.settings.flush_ns;
                if let Err(error) = writer.flush() {
                    tracing::error!("{error}; trying another file in {} s", RETRY_NS / SECOND_NS);
                    self.state = State::Failed { retry_ns: now_ns + RETRY_NS };
                }
            }
            State::Recording(_) => {}
            State::DiskFull if room => self.begin_again(now_ns),
            State::Failed { retry_ns } if now_ns >= *retry_ns && room => self.begin_again(now_ns),
            State::DiskFull | State::Failed { .. } => {}
        }
    }

    fn begin_again(&mut self, now_ns: u64) {
        if let Err(error) = self.begin() {
            tracing::error!("{error}; trying again in {} s", RETRY_NS / SECOND_NS);
            self.state = State::Failed { retry_ns: now_ns + RETRY_NS };
        }
    }

    fn say_full(&self) {
        let (free, wanted) = (self.free_bytes as f64 / 1e6, self.settings.min_free_bytes as f64 / 1e6);
        let folder = self.settings.folder.display();
        tracing::error!(
            "NOTHING IS BEING RECORDED: {free:.0} MB free at {folder}, at least {wanted:.0} MB are needed; make room and it goes on"
        );
    }

    fn end(&mut self, reason: &str) -> Result<Option<PathBuf>, RunError> {
        let State::Recording(writer) = std::mem::replace(&mut self.state, State::DiskFull) else { return Ok(None) };
        let mut summary = BTreeMap::from([
            ("reason".to_owned(), reason.to_owned()),
            ("messages".to_owned(), self.total_messages.to_string()),
            ("lost".to_owned(), self.rows.iter().fold(0_u64, |sum, row| sum.saturating_add(row.lost)).to_string()),
        ]);
        for row in self.rows.iter().filter(|row| row.lost > 0) {
            summary.insert(format!("lost {}", row.spec.name), format!("{} in {} gaps", row.lost, row.gaps));
        }
        writer.finish(&summary).map(Some)
    }

    /// One sample of `recorder/status` per channel.
    pub fn status(&self, now_ns: u64) -> impl Iterator<Item = RecorderStatus> {
        self.rows.iter().map(move |row| {
            let mut status = RecorderStatus {
                messages: row.messages,
                bytes: row.bytes,
                lost: row.lost,
                gaps: row.gaps,
                total_messages: self.total_messages,
                total_bytes: self.total_bytes,
                disk_free_bytes: self.free_bytes,
                worst_lag_ns: row.worst_lag_ns,
                state: match self.state {
                    State::Recording(_) => RecorderStatus::STATE_RECORDING,
                    State::DiskFull => RecorderStatus::STATE_DISK_FULL,
                    State::Failed { .. } => RecorderStatus::STATE_FAILED,
                },
                ..RecorderStatus::default()
            };
            status.header.stamp_ns = now_ns;
            status.header.oldest_input_ns = now_ns;
            put_text(&mut status.channel, &row.spec.name);
            put_text(&mut status.file, &self.file);
            status
        })
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

    /// Finishes the file; `None` if nothing was being recorded.
    ///
    /// # Errors
    /// The file could not be finished; it can be recovered.
    pub fn close(mut self, reason: &str) -> Result<Option<PathBuf>, RunError> {
        self.end(reason)
    }
}
