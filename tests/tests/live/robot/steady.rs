//! Repeats a test of a robot in real time if the kernel shows that the machine stood still.
//!
//! A processor that stands still, or runs other programs, stops a robot that flies in real time, as it should. Two
//! kinds of evidence excuse a failed attempt, both by the kernel's own figures:
//! * a thread on each processor that sleeps for two milliseconds woke up far too late;
//! * the kernel kept threads of the robot waiting for a processor, in the cycles in which the robot lost periods.
//!
//! Each repetition is noted with its evidence; `scripts/test` prints the notes and fails where there are too many.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Two control cycles at the usual rate: with the cycle under way, enough to stop the robot.
const STALL: Duration = Duration::from_millis(20);
/// Sleep time of a witness thread.
const NAP: Duration = Duration::from_millis(2);
/// Most attempts of one test.
const TRIES: usize = 4;

/// The kernel's figures in the run files of a failed attempt.
static STARVED: Mutex<Option<String>> = Mutex::new(None);

static TURN: Mutex<()> = Mutex::new(());

/// The run files of a test that fails show cycles in which the kernel kept the robot waiting.
pub(super) fn starved(evidence: String) {
    *STARVED.lock().unwrap_or_else(PoisonError::into_inner) = Some(evidence);
}

/// Runs a test of a robot in real time, and repeats it if it fails and the kernel shows that the machine stood still. A
/// test that fails without that evidence, or every time, fails.
pub fn steadily(test: impl Fn()) {
    // Events during another test's flight are no evidence for this one.
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    for attempt in 1.. {
        let witness = Witness::begin();
        let stolen_before = stolen_s();
        let result = catch_unwind(AssertUnwindSafe(&test));
        let longest = witness.end();
        let stolen_s = stolen_s() - stolen_before;
        let starved = STARVED.lock().unwrap_or_else(PoisonError::into_inner).take();
        match result {
            Ok(()) => return,
            Err(_) if (longest > STALL || starved.is_some()) && attempt < TRIES => {
                let starved = starved.unwrap_or_else(|| "no thread of the robot waited long".to_owned());
                notes::repeated(format_args!(
                    "attempt {attempt} failed; a processor stood still for up to {longest:.1?}, \
                     the hypervisor took {stolen_s:.2} s; {starved}"
                ));
            }
            Err(cause) => resume_unwind(cause),
        }
    }
}

/// Time that the hypervisor took from this machine, s: the eighth figure of `/proc/stat` (proc_stat(5)), in hundredths.
fn stolen_s() -> f64 {
    let text = std::fs::read_to_string("/proc/stat").unwrap_or_default();
    text.split_whitespace().nth(8).and_then(|steal| steal.parse::<f64>().ok()).unwrap_or(0.0) / 100.0
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
