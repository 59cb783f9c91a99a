//! Synchronises flushed data to the disk in a separate thread: fdatasync takes milliseconds, and sometimes far longer.

use std::fs::File;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Instant;

/// Stack size of the thread, which only makes one system call.
const STACK_BYTES: usize = 64 * 1024;

/// Statistics of the synchronisation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SyncReport {
    /// Successful synchronisations.
    pub done: u64,
    /// Longest synchronisation, ns.
    pub worst_ns: u64,
    /// Last synchronisation, ns.
    pub last_ns: u64,
    /// Failed synchronisations.
    pub failed: u64,
    /// The last synchronisation failed. Data of a failed one may be lost even if later ones succeed.
    pub failing: bool,
    /// Bytes at the start of the file that would survive a power cut.
    pub safe_bytes: u64,
}

#[derive(Default)]
struct State {
    /// File size to synchronise.
    wanted: Option<u64>,
    stop: bool,
    report: SyncReport,
}

/// The synchronising thread; requests made during a synchronisation are merged.
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
                        debug_assert!(bytes >= guard.report.safe_bytes, "the synchronised file shrank to {bytes}");
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

    /// Requests synchronisation of a file of `bytes` bytes.
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
        panic!("the disk does not respond");
    }

    #[test]
    fn a_file_that_cannot_be_kept_is_told_from_one_that_is() {
        // /dev/null has no storage: the system returns an error
        let report = after_one(File::open("/dev/null").unwrap());
        assert_eq!((report.done, report.failed, report.failing, report.safe_bytes), (0, 1, true, 0));
        let report = after_one(tempfile::tempfile().unwrap());
        assert_eq!((report.done, report.failed, report.failing, report.safe_bytes), (1, 0, false, 1));
    }
}
