//! One thread: whether it runs, and how long it was kept from running.

use std::fs::File;
use std::io;
use std::os::fd::AsFd;

use rustix::io::pread;

/// What a thread does, proc_pid_stat(5).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// It runs, or waits for a processor.
    Runnable,
    /// It waits for a disk, or for memory that has to be read from one.
    Blocked,
    /// It waits for something else: a time, a message.
    Asleep,
    /// A signal or a debugger has stopped it.
    Stopped,
    /// It has ended.
    Dead,
}

/// `/proc/TID/schedstat` (Documentation/scheduler/sched-stats.rst): what a thread has had so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Counts {
    ran_ns: u64,
    waited_ns: u64,
    slices: u64,
}

/// A thread of this machine, its files held open: a number that is given to another thread later does not become this one.
#[derive(Debug)]
pub struct Thread {
    stat: File,
    schedstat: File,
    /// It looks at itself, so it runs.
    own: bool,
    state: State,
    counts: Counts,
    looked_ns: u64,
    /// For how long it has been seen runnable without anything having changed: the kernel counts a wait when it is over.
    pending_ns: u64,
    delay_ns: u64,
}

impl Thread {
    /// The calling thread.
    ///
    /// # Errors
    /// The kernel keeps no such statistics.
    pub fn own() -> io::Result<Self> {
        Self::open("/proc/thread-self", true)
    }

    /// A thread by its number, of any process.
    ///
    /// # Errors
    /// There is no such thread, or the kernel keeps no such statistics.
    pub fn of(tid: u32) -> io::Result<Self> {
        Self::open(&format!("/proc/{tid}"), false)
    }

    fn open(folder: &str, own: bool) -> io::Result<Self> {
        let stat = File::open(format!("{folder}/stat"))?;
        let schedstat = File::open(format!("{folder}/schedstat"))?;
        let counts = Counts::default();
        let mut thread =
            Self { stat, schedstat, own, state: State::Asleep, counts, looked_ns: 0, pending_ns: 0, delay_ns: 0 };
        let (state, counts) = thread.read().ok_or(io::ErrorKind::Unsupported)?;
        (thread.state, thread.counts, thread.delay_ns) = (state, counts, counts.waited_ns);
        Ok(thread)
    }

    /// What it does, as of the last look.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// Time so far in which it was runnable and did not run, ns, with what it waits at this moment; `now_ns` is the monotonic clock. Never goes
    /// back. `None` once the thread has ended.
    ///
    /// A thread that runs without a pause from one look to the next may be taken for a waiting one until the kernel's next tick has
    /// counted its time: that makes the sum too large by a tick at most, however often it is looked at.
    pub fn look(&mut self, now_ns: u64) -> Option<u64> {
        let Some((state, counts)) = self.read() else {
            self.state = State::Dead;
            return None;
        };
        let waits = state == State::Runnable && self.state == State::Runnable && counts == self.counts && !self.own;
        self.pending_ns =
            if waits && self.looked_ns > 0 { self.pending_ns + now_ns.saturating_sub(self.looked_ns) } else { 0 };
        (self.state, self.counts, self.looked_ns) = (state, counts, now_ns);
        if state == State::Dead {
            return None;
        }
        self.delay_ns = self.delay_ns.max(counts.waited_ns.saturating_add(self.pending_ns));
        Some(self.delay_ns)
    }

    /// The same of a thread that sleeps until it is given work: `given_ns` is when it was, where what it is to do is not done yet. A thread that
    /// is runnable then and has not had a processor since the last look has waited from that moment on. Without work only what the
    /// kernel has counted is read, which is cheaper.
    pub fn look_since(&mut self, now_ns: u64, given_ns: Option<u64>) -> Option<u64> {
        let before = self.counts;
        let Some(given_ns) = given_ns else {
            let mut buffer = [0; 96];
            let Some(counts) = read_start(&self.schedstat, &mut buffer).and_then(counts) else {
                self.state = State::Dead;
                return None;
            };
            (self.state, self.counts, self.looked_ns, self.pending_ns) = (State::Asleep, counts, now_ns, 0);
            self.delay_ns = self.delay_ns.max(counts.waited_ns);
            return Some(self.delay_ns);
        };
        self.look(now_ns)?;
        if self.state == State::Runnable && self.counts == before && !self.own {
            self.pending_ns = self.pending_ns.max(now_ns.saturating_sub(given_ns));
            self.delay_ns = self.delay_ns.max(self.counts.waited_ns.saturating_add(self.pending_ns));
        }
        Some(self.delay_ns)
    }

    /// Whether it was seen waiting for a processor at the last look, and at the one before.
    #[must_use]
    pub fn waits(&self) -> bool {
        self.pending_ns > 0
    }

    fn read(&self) -> Option<(State, Counts)> {
        let mut buffer = [0; 160];
        let counts = counts(read_start(&self.schedstat, &mut buffer)?)?;
        let state = state(read_start(&self.stat, &mut buffer)?)?;
        Some((state, counts))
    }
}

fn read_start(file: impl AsFd, buffer: &mut [u8]) -> Option<&[u8]> {
    let length = pread(file, &mut *buffer, 0).ok()?;
    buffer.get(..length)
}

/// `123 456 7`: ran, waited, times on a processor.
fn counts(text: &[u8]) -> Option<Counts> {
    let mut fields = std::str::from_utf8(text).ok()?.split_ascii_whitespace().map(str::parse);
    let mut next = || fields.next()?.ok();
    Some(Counts { ran_ns: next()?, waited_ns: next()?, slices: next()? })
}

/// PF_EXITING of the kernel's include/linux/sched.h: it gives back its memory, on a processor or waiting for one, and does nothing else.
const EXITING: u64 = 0x4;

/// `123 (name) S ..`; the name may hold anything, and stands within the first bytes. Its flags are the sixth number after the state.
fn state(text: &[u8]) -> Option<State> {
    let end = text.iter().rposition(|&byte| byte == b')')?;
    let mut fields = std::str::from_utf8(text.get(end + 1..)?).ok()?.split_ascii_whitespace();
    let state = fields.next()?;
    let flags: Option<u64> = fields.nth(5).and_then(|flags| flags.parse().ok());
    Some(match state {
        _ if flags.is_some_and(|flags| flags & EXITING != 0) => State::Dead,
        "R" => State::Runnable,
        "D" => State::Blocked,
        "T" | "t" => State::Stopped,
        "Z" | "X" | "x" => State::Dead,
        _ => State::Asleep,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Child, Command};
    use std::time::{Duration, Instant};

    struct Ended(Child);

    impl Drop for Ended {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    fn looked_until(thread: &mut Thread, wanted: impl Fn(&Thread, Option<u64>) -> bool) -> bool {
        let began = Instant::now();
        while began.elapsed() < Duration::from_secs(20) {
            let delay = thread.look(began.elapsed().as_nanos() as u64 + 1);
            if wanted(thread, delay) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        false
    }

    #[test]
    fn lines_of_the_kernel_are_understood() {
        assert_eq!(state(b"12 (a) b) c) T 1 2"), Some(State::Stopped));
        assert_eq!(state(b"12 (x) R 1"), Some(State::Runnable));
        assert_eq!(state(b"12 (x) R 1 12 12 34816 12 4194304 89"), Some(State::Runnable));
        assert_eq!(state(b"12 (x) R 1 12 12 34816 12 4228108 89"), Some(State::Dead));
        assert_eq!(state(b"12 (x"), None);
        assert_eq!(counts(b"5 6 7\n"), Some(Counts { ran_ns: 5, waited_ns: 6, slices: 7 }));
        assert_eq!(counts(b"5 6"), None);
    }

    #[test]
    fn a_stopped_and_a_dead_process_are_no_starving_ones() {
        let mut child = Ended(Command::new("sleep").arg("100").spawn().unwrap_or_else(|error| panic!("{error}")));
        let pid = rustix::process::Pid::from_child(&child.0);
        let mut thread = Thread::of(child.0.id()).unwrap_or_else(|error| panic!("{error}"));
        assert!(looked_until(&mut thread, |thread, _| thread.state() == State::Asleep));
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::STOP);
        assert!(looked_until(&mut thread, |thread, _| thread.state() == State::Stopped));
        let before = thread.look(1);
        std::thread::sleep(Duration::from_millis(30));
        assert_eq!(thread.look(30_000_001), before);
        assert!(!thread.waits());
        let _ = child.0.kill();
        let _ = child.0.wait();
        assert_eq!(thread.look(2), None);
        assert_eq!(thread.state(), State::Dead);
        assert!(Thread::of(child.0.id()).is_err());
    }

    #[test]
    fn busy_loops_on_one_processor_wait_for_each_other() {
        let busy = || {
            let spawned = Command::new("taskset").args(["-c", "0", "sh", "-c", "while :; do :; done"]).spawn();
            spawned.map(Ended).ok()
        };
        // without taskset there is nothing to be tried
        let (Some(one), Some(_two)) = (busy(), busy()) else { return };
        let mut thread = Thread::of(one.0.id()).unwrap_or_else(|error| panic!("{error}"));
        assert!(looked_until(&mut thread, |_, delay| delay.is_some_and(|delay_ns| delay_ns > 50_000_000)));
    }

    #[test]
    fn work_that_a_sleeping_or_stopped_thread_was_given_is_no_wait_for_a_processor() {
        let mut child = Ended(Command::new("sleep").arg("100").spawn().unwrap_or_else(|error| panic!("{error}")));
        let pid = rustix::process::Pid::from_child(&child.0);
        let mut thread = Thread::of(child.0.id()).unwrap_or_else(|error| panic!("{error}"));
        assert!(looked_until(&mut thread, |thread, _| thread.state() == State::Asleep));
        let before = thread.look_since(1_000, None);
        assert_eq!(thread.look_since(50_000_000, Some(2_000)), before);
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::STOP);
        assert!(looked_until(&mut thread, |thread, _| thread.state() == State::Stopped));
        let stopped = thread.look_since(100_000_000, None);
        assert_eq!(thread.look_since(150_000_000, Some(100_000_000)), stopped);
        let _ = child.0.kill();
        let _ = child.0.wait();
        assert_eq!((thread.look_since(1, None), thread.state()), (None, State::Dead));
    }

    #[test]
    fn the_sum_never_goes_back_and_ones_own_thread_runs() {
        let mut own = Thread::own().unwrap_or_else(|error| panic!("{error}"));
        let mut last = 0;
        for now_ns in (0..100).map(|k| k * 1_000_000) {
            let delay = own.look(now_ns);
            assert!(delay >= Some(last) && !own.waits());
            last = delay.unwrap_or_default();
        }
        assert_eq!(own.state(), State::Runnable);
    }
}
