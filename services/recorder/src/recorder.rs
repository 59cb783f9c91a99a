//! The loop of the process: receive, write, flush, report.

use std::path::PathBuf;

use bus::clock::{SECOND_NS, now_ns};
use bus::{Bus, BusError, Publisher};
use messages::RecorderStatus;
use runlog::{PART_ENDING, RunClock, RunError, free_bytes, recover_leaving, segments};

use crate::around::BlobsAround;
use crate::batch::Batch;
use crate::listen::Listening;
use crate::session::Session;
use crate::settings::Settings;

/// Time between two polls of the channels, ns. Their buffers hold seconds; this bounds the loss by a kill beyond the
/// last flush. Most of a poll is looking at channels without a new sample, so twice the period costs two thirds.
const POLL_NS: u64 = 20_000_000;
/// Time between two searches for channels that were not announced, ns.
const SEARCH_NS: u64 = SECOND_NS;
/// Rows of `recorder/status` that are published at once: the recorder receives them too, before it publishes the next,
/// so that their channel's buffer holds them for any number of channels.
const STATUS_ROWS: usize = 64;
/// Most batches of a poll, 8 MB: between two polls the recorder sends its heartbeat, and sees the request to end.
const POLL_BATCHES: usize = 4;
/// Longest time for the samples that are left at the end, ns; the supervisor kills a recorder that has not ended after
/// eight seconds.
const LAST_NS: u64 = 2 * SECOND_NS;
/// Memory that a batch keeps for reuse, bytes.
const KEEP_BYTES: usize = 256 * 1024;
/// Stack of the recovery thread, bytes.
const STACK_BYTES: usize = 512 * 1024;

/// Error of the recorder.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// Error of the bus.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// Error of the run file.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// Records every channel of a domain.
pub struct Recorder {
    session: Session,
    listening: Listening,
    status: Publisher<RecorderStatus>,
    batch: Batch,
    /// Selection of the blobs, if not all are recorded, and the selected batch.
    around: Option<(BlobsAround, Batch)>,
    next_poll_ns: u64,
    next_search_ns: u64,
    next_status_ns: u64,
    /// Rows of the status that were already published.
    published_rows: usize,
}

impl Recorder {
    /// Starts to record. `exclude` as for [`Listening::new`].
    ///
    /// # Errors
    /// The folder cannot be written, or the domain cannot be used.
    pub fn open(bus: &Bus, settings: Settings, exclude: Vec<String>) -> Result<Self, RecorderError> {
        let now = now_ns();
        let free = free_bytes(&settings.folder)?;
        // All processes of a run use its clock. Without one, a restarted recorder uses the clock of the first file.
        let set = bus.domain().wall_clock();
        let set = set.map(|clock| RunClock { t0_unix_ns: clock.unix_ns, t0_mono_ns: clock.mono_ns });
        let clock = RunClock::from_run(&settings.folder, set);
        let around = settings.blobs.map(|around| (BlobsAround::new(around), Batch::default()));
        let mut session = Session::open(settings, clock, now, free)?;
        let mut listening = Listening::new(exclude);
        listening.discover_first(bus, &mut session)?;
        let status = bus.publisher::<RecorderStatus>("recorder/status")?;
        listening.discover(bus, &mut session)?;
        Ok(Self {
            session,
            listening,
            status,
            batch: Batch::default(),
            around,
            next_poll_ns: now,
            next_search_ns: now + SEARCH_NS,
            next_status_ns: now + SECOND_NS,
            published_rows: 0,
        })
    }

    /// Returns the time of the next poll, CLOCK_MONOTONIC, ns; an announced channel is a reason to poll earlier.
    #[must_use]
    pub fn next_poll_ns(&self) -> u64 {
        self.next_poll_ns
    }

    /// Receives and writes samples, and does the periodic work. `announced`: a new channel may exist.
    ///
    /// # Errors
    /// The domain cannot be used any more. Problems with the disk are no error: they are reported, and recording
    /// resumes as soon as possible.
    pub fn poll(&mut self, bus: &Bus, announced: bool) -> Result<(), RecorderError> {
        let now = now_ns();
        // No burst of polls after a stall of the machine.
        self.next_poll_ns = now + POLL_NS;
        if announced || now >= self.next_search_ns {
            self.next_search_ns = now + SEARCH_NS;
            self.listening.discover(bus, &mut self.session)?;
        }
        if self.record_received() {
            self.next_poll_ns = now;
        }
        let now = now_ns();
        let free = self.session.wants_free_bytes(now).then(|| {
            // If the free space cannot be read, the disk counts as not full; a write then shows whether it is.
            free_bytes(self.session.folder()).unwrap_or(u64::MAX)
        });
        let recorded = self.session.is_recording();
        self.session.tick(now, free);
        // Publish a start or stop of the recording at once.
        if recorded != self.session.is_recording() {
            (self.next_status_ns, self.published_rows) = (now, 0);
        }
        if self.session.wants_recovery() {
            recover_leftovers(&self.session);
        }
        if now >= self.next_status_ns && !self.publish_status(now)? {
            (self.next_status_ns, self.published_rows) = (now + SECOND_NS, 0);
        }
        Ok(())
    }

    /// Publishes the next rows of the status; returns whether more are left.
    fn publish_status(&mut self, now_ns: u64) -> Result<bool, BusError> {
        for mut row in self.session.status(now_ns).skip(self.published_rows).take(STATUS_ROWS) {
            self.status.send(&mut row)?;
            self.published_rows += 1;
        }
        Ok(self.published_rows < self.session.rows().len())
    }

    /// Records what has arrived, at most a few batches; returns whether more is left.
    fn record_received(&mut self) -> bool {
        for _ in 0..POLL_BATCHES {
            let received_ns = now_ns();
            let more = self.listening.drain(&mut self.batch, received_ns);
            if !self.batch.is_empty() {
                self.batch.sort();
                if let Some((around, selected)) = &mut self.around {
                    around.select(&self.batch, self.session.rows(), selected);
                    selected.sort();
                    self.session.write(selected, received_ns, now_ns());
                    selected.clear(KEEP_BYTES);
                } else {
                    self.session.write(&self.batch, received_ns, now_ns());
                }
                self.batch.clear(KEEP_BYTES);
            }
            if !more {
                return false;
            }
        }
        true
    }

    /// Records what is left at the end.
    fn record_last(&mut self, give_up_ns: u64) {
        while self.record_received() && now_ns() < give_up_ns {}
    }

    /// Returns the number of samples that are not in the files, over all channels.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.session.rows().iter().map(crate::Row::lost).sum()
    }

    /// Returns the state of the recording.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Records the remaining samples and finishes the file; returns `None` if nothing was being recorded.
    ///
    /// # Errors
    /// The file could not be finished; it can be recovered.
    pub fn close(mut self, bus: &Bus, reason: &str) -> Result<Option<PathBuf>, RecorderError> {
        self.listening.discover(bus, &mut self.session)?;
        let give_up_ns = now_ns() + LAST_NS;
        self.record_last(give_up_ns);
        // Publish the losses since the last status. The file is finished even if that fails.
        self.published_rows = 0;
        while let Ok(true) = self.publish_status(now_ns()) {
            self.record_last(give_up_ns);
        }
        Ok(self.session.close(reason)?)
    }
}

/// Recovers, in a thread, the files that an earlier recorder of the same run left unfinished.
pub fn recover_leftovers(session: &Session) {
    let (current, leave_bytes) = (session.file(), session.min_free_bytes());
    let unfinished = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.strip_suffix(".part").is_some_and(|name| name != current) && name.ends_with(PART_ENDING)
    };
    let left: Vec<PathBuf> = segments(session.folder()).unwrap_or_default().into_iter().filter(unfinished).collect();
    if left.is_empty() {
        return;
    }
    let work = move || {
        // On Linux this sets the nice value of this thread only, so that the recording has priority.
        let _ = rustix::process::nice(10);
        for path in left {
            match recover_leaving(&path, leave_bytes, &mut |_, _| {}) {
                Ok(recovery) => tracing::warn!("an earlier recording was not closed; {recovery}"),
                Err(RunError::Busy { .. }) => {}
                Err(error) => tracing::error!("{error}"),
            }
        }
    };
    if let Err(error) = std::thread::Builder::new().name("recover".into()).stack_size(STACK_BYTES).spawn(work) {
        tracing::error!("an earlier recording could not be recovered: {error}");
    }
}
