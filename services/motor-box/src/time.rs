//! The box's time: the machine's, less what the computer kept from the box or from the program that drives it.
//!
//! Iron does not wait for a computer, and a virtual box that did not either would report as its own fault what is the computer's. So
//! time does not pass in the box while the box itself has no processor, and while a program that goes by [`serial::LeftOut`] (motor-io)
//! wants one and gets none, as the kernel counts it. A program that was stopped, has ended, or has closed the port stops nothing: the
//! watchdogs of the units run on, as on iron. So they do for a program that does not say who it is.

use std::path::Path;

use evidence::Thread;
use serial::{LeftOut, Program};

use crate::BoxError;

/// A box that wakes up later than it wanted to by less than this is not late, ns: every wake-up takes some. It lives through no more at
/// once. Shared machines stand still for a quarter of a second now and then, and everything on them with it; a box that caught up
/// would find that its drives had heard nothing for so long, and stop them. And one that caught up with some milliseconds would have
/// missed an exchange in which its drives were asked in time.
const HICCUP_NS: u64 = 2_000_000;

/// A program that waits for a processor for less than this is not late, ns: every wake-up takes some.
const NOTICED_NS: u64 = 2_000_000;

/// Most that is made up for later, ns: a wait is seen when it has begun, so that the box has lived through its first milliseconds.
const MOST_OWED_NS: u64 = 20_000_000;

/// Between two looks at the threads of a program, ns.
const LOOK_NS: u64 = 2_000_000;

/// Between two looks for who the program is, ns.
const MEET_NS: u64 = 10_000_000;

/// Time that was left out, by what the computer had no time for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Kept {
    /// The box itself, ns.
    pub box_ns: u64,
    /// The program that drives it, ns.
    pub program_ns: u64,
}

impl Kept {
    /// All of it, ns.
    #[must_use]
    pub fn total_ns(&self) -> u64 {
        self.box_ns + self.program_ns
    }
}

/// The box's clock.
#[derive(Debug)]
pub struct BoxTime {
    /// The box's time, ns.
    now_ns: u64,
    /// The real clock when that was true, ns.
    real_ns: u64,
    kept: Kept,
    /// A program's waits that the box has lived through, ns.
    owed_ns: u64,
    looked_ns: u64,
    met_ns: u64,
    /// Length of the last sleep as it was asked for, ns; unlimited before the first.
    asked_ns: u64,
    /// What the programs were told of the next wake-up, ns on the real clock.
    wakes_ns: u64,
    ends: Vec<FarEnd>,
}

impl BoxTime {
    /// A clock at 0 for a box with these ports.
    ///
    /// # Errors
    /// A file beside a port cannot be made.
    pub fn new<'a>(links: impl Iterator<Item = &'a Path>) -> Result<Self, BoxError> {
        let end = |link: &Path| match LeftOut::create(link) {
            Ok(file) => Ok(FarEnd::new(file)),
            Err(error) => Err(BoxError::Time { link: link.to_owned(), error }),
        };
        let real_ns = serial::monotonic_ns();
        let ends = links.map(end).collect::<Result<_, _>>()?;
        Ok(Self {
            now_ns: 0,
            real_ns,
            kept: Kept::default(),
            owed_ns: 0,
            looked_ns: 0,
            met_ns: 0,
            asked_ns: u64::MAX,
            wakes_ns: 0,
            ends,
        })
    }

    /// The box's time, ns.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// The real clock (CLOCK_MONOTONIC, ns) when that was true.
    #[must_use]
    pub fn real_ns(&self) -> u64 {
        self.real_ns
    }

    /// Time left out so far.
    #[must_use]
    pub fn kept(&self) -> Kept {
        self.kept
    }

    /// The box will sleep for `asked_ns`; `busy`: until it has to send or take in bytes on a line, and not only to be asked.
    pub fn sleep(&mut self, asked_ns: u64, busy: bool) {
        self.asked_ns = asked_ns;
        let wakes_ns = if busy { self.real_ns + asked_ns } else { 0 };
        if wakes_ns != self.wakes_ns {
            self.wakes_ns = wakes_ns;
            self.ends.iter().for_each(|end| drop(end.file.sleeps_until(wakes_ns)));
        }
    }

    /// Whether time stands at this moment, because a program waits for a processor.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.ends.iter().any(FarEnd::waits)
    }

    /// Lets the time pass until `real_ns` on the real clock.
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
        let lived_ns = passed_ns.min(self.asked_ns.saturating_add(HICCUP_NS));
        let program_ns = lived_ns.min(self.owed_ns);
        // What the box did not live through is made up for already.
        self.owed_ns = (self.owed_ns - program_ns).saturating_sub(passed_ns - lived_ns).min(MOST_OWED_NS);
        let before = self.kept;
        self.kept.box_ns += passed_ns - lived_ns;
        self.kept.program_ns += program_ns;
        self.now_ns += lived_ns - program_ns;
        if self.kept != before {
            // A program that cannot learn of it takes it for lateness, as it does on iron.
            self.ends.iter().for_each(|end| drop(end.file.tell(self.kept.total_ns())));
        }
    }
}

/// A program at the far end of a port.
#[derive(Debug)]
struct FarEnd {
    file: LeftOut,
    program: Option<Program>,
    threads: [Option<Waiting>; 2],
}

impl FarEnd {
    fn new(file: LeftOut) -> Self {
        Self { file, program: None, threads: [None, None] }
    }

    /// Looks who it is.
    fn meet(&mut self) {
        let program = self.file.program();
        if program != self.program {
            self.program = program;
            let watch = |tid| Thread::of(tid).ok().map(Waiting::new);
            self.threads = program.map_or([None, None], |program| [watch(program.main), watch(program.port)]);
        }
    }

    /// How long a thread of it has waited for a processor since the last look, ns.
    fn waited_ns(&mut self, now_ns: u64) -> u64 {
        let waited = self.threads.iter_mut().flatten().map(|thread| thread.waited_ns(now_ns));
        waited.max().unwrap_or(0)
    }

    fn waits(&self) -> bool {
        self.threads.iter().flatten().any(|thread| thread.noticed)
    }
}

/// A thread, and the wait that it is in.
#[derive(Debug)]
struct Waiting {
    thread: Thread,
    /// What the kernel has counted so far, ns.
    delay_ns: Option<u64>,
    /// The wait so far, ns.
    wait_ns: u64,
    /// It is long enough to count, and all of it that comes does.
    noticed: bool,
}

impl Waiting {
    fn new(thread: Thread) -> Self {
        Self { thread, delay_ns: None, wait_ns: 0, noticed: false }
    }

    fn waited_ns(&mut self, now_ns: u64) -> u64 {
        let Some(delay_ns) = self.thread.look(now_ns) else {
            (self.wait_ns, self.noticed) = (0, false);
            return 0;
        };
        let more_ns = delay_ns - self.delay_ns.replace(delay_ns).unwrap_or(delay_ns);
        let counts_ns = self.count(more_ns);
        if !self.thread.waits() {
            (self.wait_ns, self.noticed) = (0, false);
        }
        counts_ns
    }

    /// What of a wait counts when it has become so much longer.
    fn count(&mut self, more_ns: u64) -> u64 {
        self.wait_ns += more_ns;
        if self.noticed {
            more_ns
        } else if self.wait_ns >= NOTICED_NS {
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
        match BoxTime::new(std::iter::empty()) {
            Ok(time) => time,
            Err(error) => panic!("{error}"),
        }
    }

    #[test]
    fn the_box_lives_through_a_hiccup_and_not_through_more() {
        let mut time = time();
        let real_ns = time.real_ns();
        time.sleep(5 * MS, false);
        time.pass(real_ns + 7 * MS);
        assert_eq!((time.now_ns(), time.kept()), (7 * MS, Kept::default()));
        // It may be woken up earlier than it asked for.
        time.pass(real_ns + 8 * MS);
        assert_eq!((time.now_ns(), time.kept()), (8 * MS, Kept::default()));
        time.pass(real_ns + 308 * MS);
        assert_eq!((time.now_ns(), time.kept().box_ns), (15 * MS, 293 * MS));
    }

    #[test]
    fn a_programs_wait_is_left_out_once() {
        let mut time = time();
        let real_ns = time.real_ns();
        time.owed_ns = 7 * MS;
        time.sleep(5 * MS, false);
        time.pass(real_ns + 5 * MS);
        assert_eq!((time.now_ns(), time.kept().program_ns), (0, 5 * MS));
        time.pass(real_ns + 10 * MS);
        assert_eq!((time.now_ns(), time.kept().program_ns), (3 * MS, 7 * MS));
        // the box waited as well: the same milliseconds are not left out twice
        time.owed_ns = 100 * MS;
        time.sleep(18 * MS, false);
        time.pass(real_ns + 110 * MS);
        assert_eq!((time.now_ns(), time.kept()), (3 * MS, Kept { box_ns: 80 * MS, program_ns: 27 * MS }));
        time.pass(real_ns + 120 * MS);
        assert_eq!((time.now_ns(), time.owed_ns), (13 * MS, 0));
    }

    #[test]
    fn only_a_wait_that_is_noticed_counts_and_then_from_its_beginning() {
        let thread = Thread::own().map(Waiting::new);
        let Ok(mut waiting) = thread else { panic!("no statistics") };
        assert_eq!([waiting.count(MS), waiting.count(MS / 2), waiting.count(MS)], [0, 0, 2 * MS + MS / 2]);
        assert_eq!(waiting.count(MS / 10), MS / 10);
    }
}
