//! Whether the computer is busy with other things than the robot: before a start, and while one runs.

use crate::{Load, Pressure};

/// Share of the time in which something waited for a processor, above which a computer is busy. An idle one stays below a hundredth, and a
/// robot alone on two processors below a tenth.
const BUSY_SHARE: f64 = 0.25;
/// So many times as many threads as processors want to run at once.
const CROWDED: f64 = 2.0;

/// What is known of the moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Busy {
    /// Share of the last ten seconds in which a thread waited for a processor; `None`: the kernel does not tell.
    pub pressure: Option<f64>,
    /// Threads that want to run, and processors.
    pub load: Option<Load>,
}

impl Busy {
    /// Looks.
    #[must_use]
    pub fn look() -> Self {
        Self { pressure: Pressure::open().and_then(|pressure| pressure.some_share()), load: Load::read() }
    }

    /// What is the case, where the robot has to share its computer: a part of a sentence.
    #[must_use]
    pub fn words(&self) -> Option<String> {
        let pressed = self.pressure.filter(|share| *share >= BUSY_SHARE);
        let crowded = self.load.filter(|load| f64::from(load.now) > CROWDED * load.processors as f64);
        if pressed.is_none() && crowded.is_none() {
            return None;
        }
        let threads = self.load.map(|load| {
            format!(
                "{} threads want to run on {} processor{} ({:.1} on average over the last minute)",
                load.now,
                load.processors,
                if load.processors == 1 { "" } else { "s" },
                load.minute
            )
        });
        let waits =
            self.pressure.map(|share| format!("in {:.0} % of the last ten seconds one had to wait", 100.0 * share));
        let parts: Vec<String> = [threads, waits].into_iter().flatten().collect();
        Some(format!("the computer is busy with other things: {}", parts.join(", and ")))
    }

    /// The same as a whole sentence before a start, with its cure.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        self.words().map(|words| format!("{words}; {CURE}"))
    }
}

/// What helps.
pub const CURE: &str =
    "end what else runs, or permit [realtime] as `nims doctor` says; until then the robot may be slow, or wait";

/// Looks at the pressure again and again; says when the computer becomes busy, and when it is over.
#[derive(Debug, Default)]
pub struct Watch {
    pressure: Option<Pressure>,
    last: Option<(u64, u64)>,
    busy: bool,
}

/// Between two looks, ns.
const LOOK_NS: u64 = 2_000_000_000;
/// Above this share between two looks the computer has become busy ..
const BECOMES: f64 = 0.5;
/// .. and below this it is over.
const ENDS: f64 = 0.15;

impl Watch {
    /// Where the kernel does not tell, it never says anything.
    #[must_use]
    pub fn new() -> Self {
        Self { pressure: Pressure::open(), last: None, busy: false }
    }

    /// What has changed, if anything: busy now, by this share, or no longer.
    pub fn look(&mut self, now_ns: u64) -> Option<Change> {
        if self.last.is_some_and(|(then_ns, _)| now_ns < then_ns + LOOK_NS) {
            return None;
        }
        let some_us = self.pressure.as_ref()?.some_us()?;
        self.step(now_ns, some_us)
    }

    fn step(&mut self, now_ns: u64, some_us: u64) -> Option<Change> {
        let (then_ns, then_us) = self.last.replace((now_ns, some_us))?;
        let share = some_us.saturating_sub(then_us) as f64 * 1e3 / now_ns.saturating_sub(then_ns).max(1) as f64;
        let before = self.busy;
        self.busy = share > if before { ENDS } else { BECOMES };
        match (before, self.busy) {
            (false, true) => Some(Change::Busy(share)),
            (true, false) => Some(Change::Over),
            _ => None,
        }
    }
}

/// What has become of the computer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// Something waits for a processor in this share of the time.
    Busy(f64),
    /// No longer.
    Over,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(now: u32) -> Option<Load> {
        Some(Load { minute: 3.0, now, processors: 2 })
    }

    #[test]
    fn a_computer_with_time_is_no_finding() {
        assert_eq!(Busy { pressure: Some(0.1), load: load(4) }.warning(), None);
        assert_eq!(Busy { pressure: None, load: None }.warning(), None);
    }

    #[test]
    fn a_busy_one_is_said_with_what_is_known_and_the_cure() {
        let words = Busy { pressure: Some(0.93), load: load(13) }.warning().unwrap();
        for part in ["13 threads", "2 processors", "93 %", "nims doctor"] {
            assert!(words.contains(part), "{words}");
        }
        // each alone is enough
        assert!(Busy { pressure: None, load: load(13) }.words().is_some());
        assert!(Busy { pressure: Some(0.3), load: None }.words().is_some());
    }

    #[test]
    fn changes_are_said_once() {
        const S: u64 = 1_000_000_000;
        let mut watch = Watch::default();
        let steps = [(0, 0), (2, 100_000), (4, 1_900_000), (6, 2_900_000), (8, 3_000_000), (10, 3_100_000)];
        let said: Vec<Option<Change>> = steps.into_iter().map(|(s, us)| watch.step(s * S, us)).collect();
        assert_eq!(said, [None, None, Some(Change::Busy(0.9)), None, Some(Change::Over), None]);
    }
}
