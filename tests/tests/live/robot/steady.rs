//! A machine that stands still, or gives its time to others, stops a robot that is flown in real time, and rightly so. Whether it did is
//! seen by threads that have nothing to do with the robot.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Two control cycles at the usual rate: with the one that is under way, enough for the robot to stop.
const STALL: Duration = Duration::from_millis(20);
/// How often a witness looks at the clock.
const NAP: Duration = Duration::from_millis(2);
const TRIES: usize = 4;

/// What the robot itself says of it: a machine that gives its time to others does not keep a witness waiting who needs hardly any.
static STARVED: AtomicBool = AtomicBool::new(false);

static TURN: Mutex<()> = Mutex::new(());

/// The run files of a test that fails show cycles that this machine did not let happen.
pub(super) fn starved() {
    STARVED.store(true, Ordering::Relaxed);
}

/// Runs a test of a robot in real time; once more where it fails and a processor of this machine stood still meanwhile for longer than the
/// robot can bear, or had no time for it. What fails on a machine that runs, and what fails every time, fails.
pub fn steadily(test: impl Fn()) {
    // What happens while another test flies says nothing about this one.
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    for attempt in 1.. {
        let witness = Witness::begin();
        let result = catch_unwind(AssertUnwindSafe(&test));
        let longest = witness.end();
        let starved = STARVED.swap(false, Ordering::Relaxed);
        match result {
            Ok(()) => return,
            Err(_) if (longest > STALL || starved) && attempt < TRIES => {
                println!(
                    "the machine stood still for {longest:?}, or had no time for the robot (seen by it: {starved}), so that says nothing: once more"
                );
            }
            Err(cause) => resume_unwind(cause),
        }
    }
}

/// A thread on each processor that should wake up every two milliseconds.
struct Witness {
    ended: Arc<AtomicBool>,
    longest_us: Arc<AtomicU64>,
    threads: Vec<JoinHandle<()>>,
}

impl Witness {
    fn begin() -> Self {
        let (ended, longest_us) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let permitted = sched_getaffinity(None).unwrap();
        let threads = (0..CpuSet::MAX_CPU)
            .filter(|processor| permitted.is_set(*processor))
            .map(|processor| {
                let (ended, longest_us) = (ended.clone(), longest_us.clone());
                std::thread::spawn(move || {
                    let mut own = CpuSet::new();
                    own.set(processor);
                    sched_setaffinity(None, &own).unwrap();
                    let mut before = Instant::now();
                    while !ended.load(Ordering::Relaxed) {
                        std::thread::sleep(NAP);
                        let late = before.elapsed().saturating_sub(NAP);
                        longest_us.fetch_max(late.as_micros() as u64, Ordering::Relaxed);
                        before = Instant::now();
                    }
                })
            })
            .collect();
        Self { ended, longest_us, threads }
    }

    fn end(self) -> Duration {
        self.ended.store(true, Ordering::Relaxed);
        self.threads.into_iter().for_each(|thread| thread.join().unwrap());
        Duration::from_micros(self.longest_us.load(Ordering::Relaxed))
    }
}
