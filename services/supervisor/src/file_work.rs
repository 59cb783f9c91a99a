//! File work that the loop of the supervisor needs for a process: its files, its program, the repair of the run folder.
//! Each piece runs on a thread of its own, because a disk can block it for as long as it likes.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest wait of the loop, during which it watches no process: the same as that for the files of a request.
const PATIENCE: Duration = super::archive::PATIENCE;
/// As [`PATIENCE`], while earlier work still waits for its disk, so that many processes of one disk do not add up to
/// the time of the service's watchdog. A shared machine can stand still for as long.
const LATE_PATIENCE: Duration = Duration::from_millis(250);
/// Pause between two looks at late work.
const POLL: Duration = Duration::from_millis(5);

/// Threads whose results the loop did not wait for.
#[derive(Debug, Default)]
pub struct FileWork {
    late: Vec<(String, JoinHandle<()>)>,
}

/// A piece of work, until its result is collected or given up.
#[derive(Debug)]
pub struct Pending<T> {
    result: Receiver<T>,
    thread: JoinHandle<()>,
}

impl FileWork {
    /// Begins work for a process. A result that comes after it was given up goes to `undo`, on the thread of the work.
    ///
    /// # Errors
    /// Earlier work for this process still waits for its disk, or no thread can be started.
    pub fn begin<T: Send + 'static>(
        &mut self,
        process: &str,
        work: impl FnOnce() -> T + Send + 'static,
        undo: impl FnOnce(T) + Send + 'static,
    ) -> io::Result<Pending<T>> {
        self.late.retain(|(_, thread)| !thread.is_finished());
        if self.late.iter().any(|(other, _)| other == process) {
            return Err(io::Error::other("its previous start still waits for a disk that does not answer"));
        }
        // Without room for a result: it is either collected or comes back.
        let (done, result) = sync_channel(0);
        let thread = std::thread::Builder::new().name("file-work".to_owned()).spawn(move || {
            if let Err(late) = done.send(work()) {
                undo(late.0);
            }
        })?;
        Ok(Pending { result, thread })
    }

    /// How long the loop may wait for a result.
    #[must_use]
    pub fn patience(&self) -> Duration {
        if self.late.iter().any(|(_, thread)| !thread.is_finished()) { LATE_PATIENCE } else { PATIENCE }
    }

    /// Waits for that long until the late work ends; returns the processes whose work still waits for its disk.
    pub fn finish(&mut self, time: Duration) -> Vec<String> {
        let give_up = Instant::now() + time;
        loop {
            self.late.retain(|(_, thread)| !thread.is_finished());
            if self.late.is_empty() || Instant::now() >= give_up {
                return self.late.iter().map(|(process, _)| process.clone()).collect();
            }
            std::thread::sleep(POLL);
        }
    }

    /// Stops waiting for work of that process.
    pub fn give_up<T>(&mut self, process: &str, pending: Pending<T>) {
        self.late.push((process.to_owned(), pending.thread));
    }
}

impl<T> Pending<T> {
    /// Waits for the result; `None` if it is not there yet.
    ///
    /// # Errors
    /// The thread ended without one.
    pub fn wait(&self, time: Duration) -> io::Result<Option<T>> {
        match self.result.recv_timeout(time) {
            Ok(result) => Ok(Some(result)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(io::Error::other("the thread of its start failed")),
        }
    }

    /// After the result: the thread ends at once, and is not taken for one that waits.
    pub fn end(self) {
        let _ = self.thread.join();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    const SOON: Duration = Duration::from_secs(20);

    #[test]
    fn what_comes_too_late_is_undone_and_only_its_process_waits_for_it() {
        let mut files = FileWork::default();
        let ((answer, disk), (undone, undo)) = (channel::<u32>(), channel());
        let work = move || disk.recv().unwrap();
        let pending = files.begin("wind", work, move |late| undone.send(late).unwrap()).unwrap();
        assert_eq!(files.patience(), PATIENCE);
        assert_eq!(pending.wait(Duration::ZERO).unwrap(), None);
        files.give_up("wind", pending);
        assert_eq!(files.patience(), LATE_PATIENCE);
        assert!(files.begin("wind", || 2, drop).is_err());
        assert_eq!(files.finish(Duration::ZERO), ["wind"]);
        let other = files.begin("soil", || 3, |_| panic!("it was collected")).unwrap();
        assert_eq!(other.wait(SOON).unwrap(), Some(3));
        other.end();
        answer.send(1).unwrap();
        assert_eq!(undo.recv_timeout(SOON).unwrap(), 1);
        while files.patience() == LATE_PATIENCE {
            std::thread::yield_now();
        }
        let again = files.begin("wind", || 4, drop).unwrap();
        assert_eq!(again.wait(SOON).unwrap(), Some(4));
    }

    #[test]
    fn a_thread_that_fails_is_no_disk_that_waits() {
        let pending = FileWork::default().begin("wind", || panic!("on purpose"), drop::<()>).unwrap();
        assert!(pending.wait(SOON).is_err());
    }
}
