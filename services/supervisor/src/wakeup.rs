//! What ends a wait of the loop at once: the end of a child, a request for the end of the run, the end of the parent
//! program. The loop looks for everything else a few times a second.

use command::{Answer, Failure, StopFlag, stop_flag};
use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM};
use signal_hook::low_level::pipe;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::sync::atomic::Ordering;

/// Wakes the loop, and requests the end of the run.
pub struct Wakeup {
    /// The end of the run is requested.
    pub stop: StopFlag,
    reader: UnixStream,
    writer: UnixStream,
}

/// Requests the end of the run from another thread.
pub struct Stopper {
    stop: StopFlag,
    writer: UnixStream,
}

impl Wakeup {
    /// Wakes at the end of a child, and at the signals of [`stop_flag`].
    ///
    /// # Errors
    /// The handlers cannot be installed.
    pub fn of_signals() -> Answer<Self> {
        // Before the socket, so that a woken loop finds the flag set.
        let stop = stop_flag()?;
        let (reader, writer) = UnixStream::pair().map_err(Failure::not_now)?;
        for end in [&reader, &writer] {
            end.set_nonblocking(true).map_err(Failure::not_now)?;
        }
        for signal in [SIGCHLD, SIGINT, SIGTERM, SIGHUP] {
            let writer = writer.try_clone().map_err(Failure::not_now)?;
            pipe::register(signal, writer).map_err(Failure::not_now)?;
        }
        Ok(Self { stop, reader, writer })
    }

    /// The descriptor to wait for.
    ///
    /// # Errors
    /// No descriptor is left.
    pub fn descriptor(&self) -> Answer<OwnedFd> {
        self.reader.try_clone().map(OwnedFd::from).map_err(Failure::not_now)
    }

    /// For a thread that requests the end.
    ///
    /// # Errors
    /// No descriptor is left.
    pub fn stopper(&self) -> Answer<Stopper> {
        let writer = self.writer.try_clone().map_err(Failure::not_now)?;
        Ok(Stopper { stop: StopFlag::clone(&self.stop), writer })
    }

    /// Forgets what woke the loop, which is about to look for it.
    pub fn clear(&self) {
        let mut bytes = [0; 64];
        while (&self.reader).read(&mut bytes).is_ok_and(|read| read == bytes.len()) {}
    }
}

impl Stopper {
    /// Requests the end of the run.
    pub fn stop(mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // A full socket wakes the loop already.
        let _ = self.writer.write_all(&[0]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::event::{PollFd, PollFlags, poll};
    use rustix::time::Timespec;
    use std::process::Command;

    /// Whether it wakes within that time, s.
    fn wakes(wakeup: &Wakeup, within_s: i64) -> bool {
        let until = Timespec { tv_sec: within_s, tv_nsec: 0 };
        loop {
            match poll(&mut [PollFd::new(&wakeup.reader, PollFlags::IN)], Some(&until)) {
                // The signal of a child may arrive on this thread.
                Err(rustix::io::Errno::INTR) => {}
                ready => return ready.unwrap() == 1,
            }
        }
    }

    #[test]
    fn the_end_of_a_child_and_a_requested_end_wake_the_loop() {
        let wakeup = Wakeup::of_signals().unwrap();
        let mut child = Command::new("/bin/sh").args(["-c", "exit 3"]).spawn().unwrap();
        assert!(wakes(&wakeup, 20), "nothing shows the end of a child");
        child.wait().unwrap();
        wakeup.clear();
        let stopper = wakeup.stopper().unwrap();
        assert!(!wakeup.stop.load(Ordering::Relaxed));
        let thread = std::thread::spawn(|| stopper.stop());
        assert!(wakes(&wakeup, 20), "nothing shows the requested end");
        thread.join().unwrap();
        assert!(wakeup.stop.load(Ordering::Relaxed));
    }
}
