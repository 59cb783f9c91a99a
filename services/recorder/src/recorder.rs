//! The loop of the process: hear, write, flush, report.

use std::path::{Path, PathBuf};

use bus::clock::{SECOND_NS, now_ns};
use bus::{Bus, BusError, Publisher};
use messages::RecorderStatus;
use runlog::{PART_ENDING, RunClock, RunError, free_bytes, recover, segments};

use crate::batch::Batch;
use crate::listen::{Listening, listen_to_known};
use crate::session::{Session, Settings};

/// Between two looks at the channels. Their buffers hold seconds; this bounds what a kill loses beyond the last flush.
const LOOK_NS: u64 = 10_000_000;
/// Between two searches for channels that did not announce themselves.
const SEARCH_NS: u64 = SECOND_NS;
/// Memory kept for the next batch.
const KEEP_BYTES: usize = 256 * 1024;
/// Stack of the thread that recovers.
const STACK_BYTES: usize = 512 * 1024;

/// Why the recorder cannot work.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// Shared memory.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The run file.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// Listens to everything in a domain and writes it down.
pub struct Recorder {
    session: Session,
    listening: Listening,
    status: Publisher<RecorderStatus>,
    batch: Batch,
    next_look_ns: u64,
    next_search_ns: u64,
    next_status_ns: u64,
}

impl Recorder {
    /// Begins to record. `exclude` as for [`Listening::new`].
    ///
    /// # Errors
    /// The folder cannot be written, or the domain cannot be used.
    pub fn open(bus: &Bus, settings: Settings, exclude: Vec<String>) -> Result<Self, RecorderError> {
        let now = now_ns();
        let free = free_bytes(&settings.folder)?;
        // a recorder that was started again goes on in the time of the first, and all of a robot's processes in that of the run
        let set = bus.domain().wall_clock();
        let set = set.map(|clock| RunClock { t0_unix_ns: clock.unix_ns, t0_mono_ns: clock.mono_ns });
        let clock = RunClock::of_run(&settings.folder, set);
        let mut session = Session::open(settings, clock, now, free)?;
        let mut listening = Listening::new(exclude);
        listen_to_known(bus, &mut listening, &mut session)?;
        let status = bus.publisher::<RecorderStatus>("recorder/status")?;
        listening.discover(bus, &mut session)?;
        let (next_look_ns, next_search_ns, next_status_ns) = (now, now + SEARCH_NS, now + SECOND_NS);
        Ok(Self { session, listening, status, batch: Batch::default(), next_look_ns, next_search_ns, next_status_ns })
    }

    /// When the next look is due, CLOCK_MONOTONIC, ns; a channel that announces itself is a reason to look earlier.
    #[must_use]
    pub fn next_look_ns(&self) -> u64 {
        self.next_look_ns
    }

    /// Takes and writes what has arrived, and does what is due. `announced`: there may be a new channel.
    ///
    /// # Errors
    /// The domain cannot be used any more. Troubles with the disk are no error: they are said, and recording goes on as soon as it can.
    pub fn look(&mut self, bus: &Bus, announced: bool) -> Result<(), RecorderError> {
        let now = now_ns();
        // without catching up after the machine stood still
        self.next_look_ns = now + LOOK_NS;
        if announced || now >= self.next_search_ns {
            self.next_search_ns = now + SEARCH_NS;
            self.listening.discover(bus, &mut self.session)?;
        }
        self.take();
        let now = now_ns();
        let free = self.session.wants_free_bytes(now).then(|| {
            // A file system that does not answer has not said that it is full: what it takes is seen when it is written.
            free_bytes(self.session.folder()).unwrap_or(u64::MAX)
        });
        let recorded = self.session.is_recording();
        self.session.tick(now, free);
        // a recording that stops, or goes on, is no news for the next second
        if recorded != self.session.is_recording() {
            self.next_status_ns = now;
        }
        if self.session.wants_recovery() {
            recover_leftovers(self.session.folder(), self.session.file());
        }
        if now >= self.next_status_ns {
            self.next_status_ns = now + SECOND_NS;
            for mut row in self.session.status(now) {
                self.status.send(&mut row)?;
            }
        }
        Ok(())
    }

    fn take(&mut self) {
        loop {
            let heard_ns = now_ns();
            let more = self.listening.drain(&self.session, &mut self.batch, heard_ns);
            if !self.batch.is_empty() {
                self.batch.sort();
                self.session.write(&self.batch, heard_ns, now_ns());
                self.batch.clear(KEEP_BYTES);
            }
            if !more {
                return;
            }
        }
    }

    /// Samples that are not in the file, over all channels.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.session.rows().iter().map(crate::Row::lost).sum()
    }

    /// The state of the recording.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Takes what is still there and finishes the file; `None` if nothing was being recorded.
    ///
    /// # Errors
    /// The file could not be finished; it can be recovered.
    pub fn close(mut self, bus: &Bus, reason: &str) -> Result<Option<PathBuf>, RecorderError> {
        self.listening.discover(bus, &mut self.session)?;
        self.take();
        // What was lost since the last second nobody would hear of otherwise; the file is finished whether it is heard or not.
        for mut row in self.session.status(now_ns()) {
            if self.status.send(&mut row).is_err() {
                break;
            }
        }
        Ok(self.session.close(reason)?)
    }
}

/// Recovers, in a thread of its own, what an earlier recorder of the same run has left unfinished; `current` is the file being written.
pub fn recover_leftovers(folder: &Path, current: &str) {
    let unfinished = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.strip_suffix(".part").is_some_and(|name| name != current) && name.ends_with(PART_ENDING)
    };
    let left: Vec<PathBuf> = segments(folder).unwrap_or_default().into_iter().filter(unfinished).collect();
    if left.is_empty() {
        return;
    }
    let work = move || {
        // on Linux this is the thread's own niceness: the recording goes first
        let _ = rustix::process::nice(10);
        for path in left {
            match recover(&path, &mut |_, _| {}) {
                Ok(recovery) => tracing::warn!("an earlier recording had not been closed; {recovery}"),
                Err(RunError::Busy { .. }) => {}
                Err(error) => tracing::error!("{error}"),
            }
        }
    };
    if let Err(error) = std::thread::Builder::new().name("recover".into()).stack_size(STACK_BYTES).spawn(work) {
        tracing::error!("an earlier recording could not be recovered: {error}");
    }
}
