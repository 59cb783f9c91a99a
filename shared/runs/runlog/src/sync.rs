//! Brings what was flushed onto the disk, in a thread of its own: fdatasync takes milliseconds, and now and then far more.

use std::fs::File;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Instant;

/// Stack of the thread: it calls one system call.
const STACK_BYTES: usize = 64 * 1024;

/// What synchronising has cost so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SyncReport {
    /// Times that the disk confirmed.
    pub done: u64,
    /// Longest, ns.
    pub worst_ns: u64,
    /// The last one, ns.
    pub last_ns: u64,
    /// Times that the disk refused.
    pub failed: u64,
    /// It refused the last time. What it refused once may be lost although it accepts what comes later.
    pub failing: bool,
    /// Bytes at the beginning of the file that a power cut would leave there.
    pub safe_bytes: u64,
}

#[derive(Default)]
struct State {
    /// Bytes to be made safe.
    wanted: Option<u64>,
    stop: bool,
    report: SyncReport,
}

/// The thread; asks in between coalesce.
pub(crate) struct Syncer {
    shared: Arc<(Mutex<State>, Condvar)>,
    thread: Option<JoinHandle<()>>,
}

impl Syncer {
    pub(crate) fn start(file: File) -> std::io::Result<Self> {
        let shared = Arc::new((Mutex::new(State::default()), Condvar::new()));
        let theirs = Arc::clone(&shared);
        let thread = thread::Builder::new().name("sync".into()).stack_size(STACK_BYTES).spawn(move || {
            let (state, wake) = &*theirs;
            loop {
                let mut guard = lock(state);
                while guard.wanted.is_none() && !guard.stop {
                    guard = wake.wait(guard).unwrap_or_else(PoisonError::into_inner);
                }
                if guard.stop {
                    return;
                }
                let bytes = guard.wanted.take().unwrap_or_default();
                drop(guard);
                let begin = Instant::now();
                let result = file.sync_data();
                let took = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
                let mut guard = lock(state);
                match result {
                    Ok(()) => {
                        guard.report.done += 1;
                        guard.report.failing = false;
                        guard.report.safe_bytes = bytes;
                    }
                    Err(_) => {
                        guard.report.failed += 1;
                        guard.report.failing = true;
                    }
                }
                guard.report.worst_ns = guard.report.worst_ns.max(took);
                guard.report.last_ns = took;
            }
        })?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// The file has so many bytes now.
    pub(crate) fn ask(&self, bytes: u64) {
        lock(&self.shared.0).wanted = Some(bytes);
        self.shared.1.notify_one();
    }

    pub(crate) fn report(&self) -> SyncReport {
        lock(&self.shared.0).report
    }
}

impl Drop for Syncer {
    fn drop(&mut self) {
        lock(&self.shared.0).stop = true;
        self.shared.1.notify_one();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn lock(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after_one(file: File) -> SyncReport {
        let syncer = Syncer::start(file).unwrap();
        syncer.ask(1);
        for _ in 0..60_000 {
            let report = syncer.report();
            if report.done + report.failed > 0 {
                return report;
            }
            thread::sleep(std::time::Duration::from_millis(1));
        }
        panic!("the disk does not answer");
    }

    #[test]
    fn a_file_that_cannot_be_kept_is_told_from_one_that_is() {
        // nothing to synchronise: the system refuses
        let report = after_one(File::open("/dev/null").unwrap());
        assert_eq!((report.done, report.failed, report.failing, report.safe_bytes), (0, 1, true, 0));
        let report = after_one(tempfile::tempfile().unwrap());
        assert_eq!((report.done, report.failed, report.failing, report.safe_bytes), (1, 0, false, 1));
    }
}
