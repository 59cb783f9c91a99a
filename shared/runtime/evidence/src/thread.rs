//! Statistics of one thread: its state, and how long it waited for a CPU.

use std::fs::File;
use std::io;
use std::os::fd::AsFd;

use rustix::io::pread;

/// State of a thread, see proc_pid_stat(5).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// The thread runs or waits for a CPU.
    Runnable,
    /// The thread waits for a disk, or for memory that is read from a disk.
    Blocked,
    /// The thread waits for an event, e.g. a time or a message.
    Asleep,
    /// A signal or a debugger has stopped the thread.
    Stopped,
    /// The thread has ended.
    Dead,
}

/// Content of `/proc/TID/schedstat` (Documentation/scheduler/sched-stats.rst).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Counts {
    ran_ns: u64,
    waited_ns: u64,
    slices: u64,
}

/// A thread of this machine. Its files stay open, so another thread that reuses its id is not mistaken for it.
#[derive(Debug)]
pub struct Thread {
    stat: File,
    schedstat: File,
    /// Whether this is the calling thread, which always runs.
    own: bool,
    state: State,
    counts: Counts,
    read_ns: u64,
    /// Time for which the thread was runnable with unchanged counts: the kernel counts a wait only when it has ended.
    pending_ns: u64,
    delay_ns: u64,
}

impl Thread {
    /// Opens the statistics of the calling thread.
    ///
    /// # Errors
    /// The kernel has no such statistics.
    pub fn current() -> io::Result<Self> {
        Self::open("/proc/thread-self", true)
    }

    /// Opens the statistics of a thread of any process, by its id.
    ///
    /// # Errors
    /// There is no such thread, or the kernel has no such statistics.
    pub fn with_id(tid: u32) -> io::Result<Self> {
        Self::open(&format!("/proc/{tid}"), false)
    }

    fn open(folder: &str, own: bool) -> io::Result<Self> {
        let stat = File::open(format!("{folder}/stat"))?;
        let schedstat = File::open(format!("{folder}/schedstat"))?;
        let counts = Counts::default();
        let mut thread =
            Self { stat, schedstat, own, state: State::Asleep, counts, read_ns: 0, pending_ns: 0, delay_ns: 0 };
        let (state, counts) = thread.read().ok_or(io::ErrorKind::Unsupported)?;
        (thread.state, thread.counts, thread.delay_ns) = (state, counts, counts.waited_ns);
        Ok(thread)
    }

    /// Returns the state at the last reading.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// Reads the statistics; returns the total time in which the thread was runnable and did not run, ns, including the
    /// present wait. `now_ns` is the monotonic clock. The result never decreases. `None` if the thread has ended.
    ///
    /// A thread that runs from one reading to the next may look like a waiting one until the next scheduler tick of the
    /// kernel counts its time. This makes the total too large by at most one tick, independent of the number of
    /// readings.
    pub fn run_delay_ns(&mut self, now_ns: u64) -> Option<u64> {
        let Some((state, counts)) = self.read() else {
            self.state = State::Dead;
            return None;
        };
        let waits = state == State::Runnable && self.state == State::Runnable && counts == self.counts && !self.own;
        self.pending_ns =
            if waits && self.read_ns > 0 { self.pending_ns + now_ns.saturating_sub(self.read_ns) } else { 0 };
        (self.state, self.counts, self.read_ns) = (state, counts, now_ns);
        if state == State::Dead {
            return None;
        }
        self.delay_ns = self.delay_ns.max(counts.waited_ns.saturating_add(self.pending_ns));
        Some(self.delay_ns)
    }

    /// As [`Thread::run_delay_ns`], for a thread that sleeps until it is given work: `given_ns` is the time when it was
    /// given work that is not done yet. If the thread is runnable and has not run since the last reading, it has waited
    /// since `given_ns`. Without work, only the kernel's counts are read, which is cheaper.
    pub fn run_delay_since_ns(&mut self, now_ns: u64, given_ns: Option<u64>) -> Option<u64> {
        let before = self.counts;
        let Some(given_ns) = given_ns else {
            let mut buffer = [0; 96];
            let Some(counts) = read_start(&self.schedstat, &mut buffer).and_then(counts) else {
                self.state = State::Dead;
                return None;
            };
            (self.state, self.counts, self.read_ns, self.pending_ns) = (State::Asleep, counts, now_ns, 0);
            self.delay_ns = self.delay_ns.max(counts.waited_ns);
            return Some(self.delay_ns);
        };
        self.run_delay_ns(now_ns)?;
        if self.state == State::Runnable && self.counts == before && !self.own {
            self.pending_ns = self.pending_ns.max(now_ns.saturating_sub(given_ns));
            self.delay_ns = self.delay_ns.max(self.counts.waited_ns.saturating_add(self.pending_ns));
        }
        Some(self.delay_ns)
    }

    /// Returns whether the thread waited for a CPU at the last two readings.
    #[must_use]
    pub fn was_waiting(&self) -> bool {
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

/// Parses `123 456 7`: time on a CPU, time waited, number of time slices.
fn counts(text: &[u8]) -> Option<Counts> {
    let mut fields = std::str::from_utf8(text).ok()?.split_ascii_whitespace().map(str::parse);
    let mut next = || fields.next()?.ok();
    Some(Counts { ran_ns: next()?, waited_ns: next()?, slices: next()? })
}

/// PF_EXITING of the kernel's include/linux/sched.h: the thread frees its memory and does nothing else.
const EXITING: u64 = 0x4;

/// Parses `123 (name) S ..`; the name may contain any characters. The flags are the sixth number after the state.
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

    /// A child process that is killed when dropped.
    struct KilledOnDrop(Child);

    impl Drop for KilledOnDrop {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    fn poll_until(thread: &mut Thread, wanted: impl Fn(&Thread, Option<u64>) -> bool) -> bool {
        let began = Instant::now();
        while began.elapsed() < Duration::from_secs(20) {
            let delay = thread.run_delay_ns(began.elapsed().as_nanos() as u64 + 1);
            if wanted(thread, delay) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        false
    }

    #[test]
    fn texts_of_the_kernel_are_parsed() {
        assert_eq!(state(b"12 (a) b) c) T 1 2"), Some(State::Stopped));
        assert_eq!(state(b"12 (x) R 1"), Some(State::Runnable));
        assert_eq!(state(b"12 (x) R 1 12 12 34816 12 4194304 89"), Some(State::Runnable));
        assert_eq!(state(b"12 (x) R 1 12 12 34816 12 4228108 89"), Some(State::Dead));
        assert_eq!(state(b"12 (x"), None);
        assert_eq!(counts(b"5 6 7\n"), Some(Counts { ran_ns: 5, waited_ns: 6, slices: 7 }));
        assert_eq!(counts(b"5 6"), None);
    }

    #[test]
    fn a_stopped_or_dead_process_does_not_wait_for_a_cpu() {
        let mut child =
            KilledOnDrop(Command::new("sleep").arg("100").spawn().unwrap_or_else(|error| panic!("{error}")));
        let pid = rustix::process::Pid::from_child(&child.0);
        let mut thread = Thread::with_id(child.0.id()).unwrap_or_else(|error| panic!("{error}"));
        assert!(poll_until(&mut thread, |thread, _| thread.state() == State::Asleep));
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::STOP);
        assert!(poll_until(&mut thread, |thread, _| thread.state() == State::Stopped));
        let before = thread.run_delay_ns(1);
        std::thread::sleep(Duration::from_millis(30));
        assert_eq!(thread.run_delay_ns(30_000_001), before);
        assert!(!thread.was_waiting());
        let _ = child.0.kill();
        let _ = child.0.wait();
        assert_eq!(thread.run_delay_ns(2), None);
        assert_eq!(thread.state(), State::Dead);
        assert!(Thread::with_id(child.0.id()).is_err());
    }

    #[test]
    fn busy_loops_on_one_cpu_wait_for_each_other() {
        let busy = || {
            let spawned = Command::new("taskset").args(["-c", "0", "sh", "-c", "while :; do :; done"]).spawn();
            spawned.map(KilledOnDrop).ok()
        };
        // Skip the test without taskset.
        let (Some(one), Some(_two)) = (busy(), busy()) else { return };
        let mut thread = Thread::with_id(one.0.id()).unwrap_or_else(|error| panic!("{error}"));
        assert!(poll_until(&mut thread, |_, delay| delay.is_some_and(|delay_ns| delay_ns > 50_000_000)));
    }

    #[test]
    fn a_sleeping_or_stopped_thread_with_work_does_not_wait_for_a_cpu() {
        let mut child =
            KilledOnDrop(Command::new("sleep").arg("100").spawn().unwrap_or_else(|error| panic!("{error}")));
        let pid = rustix::process::Pid::from_child(&child.0);
        let mut thread = Thread::with_id(child.0.id()).unwrap_or_else(|error| panic!("{error}"));
        assert!(poll_until(&mut thread, |thread, _| thread.state() == State::Asleep));
        let before = thread.run_delay_since_ns(1_000, None);
        assert_eq!(thread.run_delay_since_ns(50_000_000, Some(2_000)), before);
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::STOP);
        assert!(poll_until(&mut thread, |thread, _| thread.state() == State::Stopped));
        let stopped = thread.run_delay_since_ns(100_000_000, None);
        assert_eq!(thread.run_delay_since_ns(150_000_000, Some(100_000_000)), stopped);
        let _ = child.0.kill();
        let _ = child.0.wait();
        assert_eq!((thread.run_delay_since_ns(1, None), thread.state()), (None, State::Dead));
    }

    #[test]
    fn the_total_never_decreases_and_the_calling_thread_runs() {
        let mut own = Thread::current().unwrap_or_else(|error| panic!("{error}"));
        let mut last = 0;
        for now_ns in (0..100).map(|k| k * 1_000_000) {
            let delay = own.run_delay_ns(now_ns);
            assert!(delay >= Some(last) && !own.was_waiting());
            last = delay.unwrap_or_default();
        }
        assert_eq!(own.state(), State::Runnable);
    }
}
