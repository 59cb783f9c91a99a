//! The box's time: that of the computer, less the time for which the box or the program that drives it had no
//! processor.
//!
//! Hardware does not wait for a computer. A virtual box that does not wait either would report delays of the computer
//! as faults of the drives. Time therefore does not pass in the box while the box itself has no processor, nor while a
//! program that uses [`serial::LeftOutClock`] (motor-io) waits for one, as the kernel counts it. A program that was
//! stopped, has ended, or has closed the port stops nothing: the units' watchdogs continue, as on hardware. The same
//! holds for a program that does not use the file.

use std::path::Path;

use evidence::Thread;
use serial::{LeftOutClock, Program};

use crate::BoxError;

/// Longest delay of a wake-up that counts as ordinary, ns, and longest time that the box advances at once; half a
/// period where that is shorter. Shared machines stop for a quarter of a second now and then, with everything on them.
/// A box that made up for it would find that its drives had received nothing for that long, and stop them; after some
/// milliseconds, or half a period, it would have missed an exchange that was in time.
const HICCUP_NS: u64 = 2_000_000;

/// Longest wait of a program for a processor that counts as ordinary, ns; half a period where that is shorter.
const NOTICED_NS: u64 = 2_000_000;

/// Most of a wait that is left out later, ns: a wait is detected after it has begun, when the box has advanced by its
/// first milliseconds.
const MOST_OWED_NS: u64 = 20_000_000;

/// Period of checks of a program's threads, ns.
const LOOK_NS: u64 = 2_000_000;

/// Period of checks which program uses the port, ns.
const MEET_NS: u64 = 10_000_000;

/// Time that was left out, by its cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeftOut {
    /// The box had no processor, ns.
    pub box_ns: u64,
    /// The program that drives it had no processor, ns.
    pub program_ns: u64,
}

impl LeftOut {
    /// Sum of both, ns.
    #[must_use]
    pub fn total_ns(&self) -> u64 {
        self.box_ns + self.program_ns
    }
}

/// Clock of the box.
#[derive(Debug)]
pub struct BoxTime {
    /// The box's time, ns.
    now_ns: u64,
    /// Time on the real clock at that moment, ns.
    real_ns: u64,
    left_out: LeftOut,
    /// Waits of a program through which the box has advanced, ns.
    owed_ns: u64,
    looked_ns: u64,
    met_ns: u64,
    /// Requested length of the last sleep, ns; unlimited before the first.
    asked_ns: u64,
    /// Next wake-up as written for the programs, ns on the real clock.
    wakes_ns: u64,
    /// Longest delay of a wake-up that counts as ordinary, ns.
    hiccup_ns: u64,
    ends: Vec<FarEnd>,
}

impl BoxTime {
    /// Creates a clock at 0 for a box with these ports, whose program has this control period, ns.
    ///
    /// # Errors
    /// A file beside a port cannot be created.
    pub fn new<'a>(links: impl Iterator<Item = &'a Path>, period_ns: u64) -> Result<Self, BoxError> {
        let [hiccup_ns, noticed_ns] = [HICCUP_NS, NOTICED_NS].map(|ns| ns.min(period_ns / 2));
        let end = |link: &Path| match LeftOutClock::create(link) {
            Ok(file) => Ok(FarEnd::new(file, noticed_ns)),
            Err(error) => Err(BoxError::Time { link: link.to_owned(), error }),
        };
        let real_ns = serial::monotonic_ns();
        let ends = links.map(end).collect::<Result<_, _>>()?;
        Ok(Self {
            now_ns: 0,
            real_ns,
            left_out: LeftOut::default(),
            owed_ns: 0,
            looked_ns: 0,
            met_ns: 0,
            asked_ns: u64::MAX,
            wakes_ns: 0,
            hiccup_ns,
            ends,
        })
    }

    /// The box's time, ns.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Time on the real clock (CLOCK_MONOTONIC) at that moment, ns.
    #[must_use]
    pub fn real_ns(&self) -> u64 {
        self.real_ns
    }

    /// Time left out so far.
    #[must_use]
    pub fn left_out(&self) -> LeftOut {
        self.left_out
    }

    /// Records that the box will sleep for `asked_ns`; `busy`: until bytes are due on a wire, and not only until a
    /// program writes.
    pub fn sleep(&mut self, asked_ns: u64, busy: bool) {
        self.asked_ns = asked_ns;
        let wakes_ns = if busy { self.real_ns + asked_ns } else { 0 };
        if wakes_ns != self.wakes_ns {
            self.wakes_ns = wakes_ns;
            self.ends.iter().for_each(|end| drop(end.file.sleeps_until(wakes_ns)));
        }
    }

    /// True while time stands still because a program waits for a processor.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.ends.iter().any(FarEnd::waits)
    }

    /// Advances to `real_ns` on the real clock.
    pub fn pass(&mut self, real_ns: u64) {
        let passed_ns = real_ns - self.real_ns;
        self.real_ns = real_ns;
        if real_ns >= self.looked_ns + LOOK_NS {
            self.looked_ns = real_ns;
            if real_ns >= self.met_ns + MEET_NS {
                self.met_ns = real_ns;
                self.ends.iter_mut().for_each(FarEnd::meet);
            }
            self.owed_ns += self.ends.iter_mut().map(|end| end.waited_ns(real_ns)).max().unwrap_or(0);
        }
        let lived_ns = passed_ns.min(self.asked_ns.saturating_add(self.hiccup_ns));
        let program_ns = lived_ns.min(self.owed_ns);
        // Time that the box did not advance through is already left out.
        self.owed_ns = (self.owed_ns - program_ns).saturating_sub(passed_ns - lived_ns).min(MOST_OWED_NS);
        let before = self.left_out;
        self.left_out.box_ns += passed_ns - lived_ns;
        self.left_out.program_ns += program_ns;
        self.now_ns += lived_ns - program_ns;
        if self.left_out != before {
            // Without the file a program counts the time as a delay, as with hardware.
            self.ends.iter().for_each(|end| drop(end.file.write(self.left_out.total_ns())));
        }
    }
}

/// A program at the far end of a port.
#[derive(Debug)]
struct FarEnd {
    file: LeftOutClock,
    program: Option<Program>,
    threads: [Option<Waiting>; 2],
    /// Longest wait of a thread that counts as ordinary, ns.
    noticed_ns: u64,
}

impl FarEnd {
    fn new(file: LeftOutClock, noticed_ns: u64) -> Self {
        Self { file, program: None, threads: [None, None], noticed_ns }
    }

    /// Reads which program uses the port.
    fn meet(&mut self) {
        let program = self.file.program();
        if program != self.program {
            self.program = program;
            let watch = |tid| Some(Waiting::new(Thread::with_id(tid).ok()?, self.noticed_ns));
            self.threads = program.map_or([None, None], |program| [watch(program.main), watch(program.port)]);
        }
    }

    /// Time that a thread of it has waited for a processor since the last check, ns.
    fn waited_ns(&mut self, now_ns: u64) -> u64 {
        let waited = self.threads.iter_mut().flatten().map(|thread| thread.waited_ns(now_ns));
        waited.max().unwrap_or(0)
    }

    fn waits(&self) -> bool {
        self.threads.iter().flatten().any(|thread| thread.noticed)
    }
}

/// A thread and its present wait.
#[derive(Debug)]
struct Waiting {
    thread: Thread,
    /// Wait that the kernel has counted so far, ns.
    delay_ns: Option<u64>,
    /// Present wait so far, ns.
    wait_ns: u64,
    /// The wait is long enough to count, with all of its continuation.
    noticed: bool,
    /// Longest wait that counts as ordinary, ns.
    noticed_ns: u64,
}

impl Waiting {
    fn new(thread: Thread, noticed_ns: u64) -> Self {
        Self { thread, delay_ns: None, wait_ns: 0, noticed: false, noticed_ns }
    }

    fn waited_ns(&mut self, now_ns: u64) -> u64 {
        let Some(delay_ns) = self.thread.run_delay_ns(now_ns) else {
            (self.wait_ns, self.noticed) = (0, false);
            return 0;
        };
        let more_ns = delay_ns - self.delay_ns.replace(delay_ns).unwrap_or(delay_ns);
        let counts_ns = self.count(more_ns);
        if !self.thread.was_waiting() {
            (self.wait_ns, self.noticed) = (0, false);
        }
        counts_ns
    }

    /// Part of a wait that counts when it has become this much longer.
    fn count(&mut self, more_ns: u64) -> u64 {
        self.wait_ns += more_ns;
        if self.noticed {
            more_ns
        } else if self.wait_ns >= self.noticed_ns {
            self.noticed = true;
            self.wait_ns
        } else {
            0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn time() -> BoxTime {
        time_of(10 * MS)
    }

    fn time_of(period_ns: u64) -> BoxTime {
        match BoxTime::new(std::iter::empty(), period_ns) {
            Ok(time) => time,
            Err(error) => panic!("{error}"),
        }
    }

    #[test]
    fn a_hiccup_is_at_most_half_a_period() {
        for (period_ns, ordinary_ns) in [(10 * MS, 2 * MS), (4 * MS, 2 * MS), (2 * MS, MS)] {
            let mut time = time_of(period_ns);
            let real_ns = time.real_ns();
            time.sleep(MS, false);
            time.pass(real_ns + 9 * MS);
            assert_eq!((time.now_ns(), time.left_out().box_ns), (MS + ordinary_ns, 8 * MS - ordinary_ns));
        }
    }

    #[test]
    fn the_box_lives_through_a_hiccup_and_not_through_more() {
        let mut time = time();
        let real_ns = time.real_ns();
        time.sleep(5 * MS, false);
        time.pass(real_ns + 7 * MS);
        assert_eq!((time.now_ns(), time.left_out()), (7 * MS, LeftOut::default()));
        // A wake-up can come before the end of the sleep.
        time.pass(real_ns + 8 * MS);
        assert_eq!((time.now_ns(), time.left_out()), (8 * MS, LeftOut::default()));
        time.pass(real_ns + 308 * MS);
        assert_eq!((time.now_ns(), time.left_out().box_ns), (15 * MS, 293 * MS));
    }

    #[test]
    fn a_programs_wait_is_left_out_once() {
        let mut time = time();
        let real_ns = time.real_ns();
        time.owed_ns = 7 * MS;
        time.sleep(5 * MS, false);
        time.pass(real_ns + 5 * MS);
        assert_eq!((time.now_ns(), time.left_out().program_ns), (0, 5 * MS));
        time.pass(real_ns + 10 * MS);
        assert_eq!((time.now_ns(), time.left_out().program_ns), (3 * MS, 7 * MS));
        // The box waited as well: the same milliseconds are not left out twice.
        time.owed_ns = 100 * MS;
        time.sleep(18 * MS, false);
        time.pass(real_ns + 110 * MS);
        assert_eq!((time.now_ns(), time.left_out()), (3 * MS, LeftOut { box_ns: 80 * MS, program_ns: 27 * MS }));
        time.pass(real_ns + 120 * MS);
        assert_eq!((time.now_ns(), time.owed_ns), (13 * MS, 0));
    }

    #[test]
    fn only_a_wait_that_is_noticed_counts_and_then_from_its_beginning() {
        let thread = Thread::current().map(|thread| Waiting::new(thread, NOTICED_NS));
        let Ok(mut waiting) = thread else { panic!("no statistics") };
        assert_eq!([waiting.count(MS), waiting.count(MS / 2), waiting.count(MS)], [0, 0, 2 * MS + MS / 2]);
        assert_eq!(waiting.count(MS / 10), MS / 10);
    }
}
