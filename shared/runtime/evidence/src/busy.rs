//! Detects a computer that is overloaded by other programs, before a start and while the robot runs.

use crate::{Load, Pressure};

/// Pressure above which a computer is busy. That of an idle computer stays below 0.01, and that of a robot alone on two
/// CPUs below 0.1.
const BUSY_SHARE: f64 = 0.25;
/// Number of runnable threads per CPU above which a computer is busy.
const CROWDED: f64 = 2.0;

/// The present load of the computer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SystemLoad {
    /// Fraction of the last ten seconds in which a thread waited for a CPU; `None` if the kernel has no such
    /// statistics.
    pub pressure: Option<f64>,
    /// Number of runnable threads and of CPUs.
    pub load: Option<Load>,
}

impl SystemLoad {
    /// Reads the statistics.
    #[must_use]
    pub fn read() -> Self {
        Self { pressure: Pressure::open().and_then(|pressure| pressure.some_share()), load: Load::read() }
    }

    /// Returns a clause about the load if the computer is busy.
    #[must_use]
    pub fn clause(&self) -> Option<String> {
        let pressed = self.pressure.filter(|share| *share >= BUSY_SHARE);
        let crowded = self.load.filter(|load| f64::from(load.now) > CROWDED * load.processors as f64);
        if pressed.is_none() && crowded.is_none() {
            return None;
        }
        let threads = self.load.map(|load| {
            format!(
                "{} threads are runnable on {} processor{} ({:.1} on average over the last minute)",
                load.now,
                load.processors,
                if load.processors == 1 { "" } else { "s" },
                load.minute
            )
        });
        let waits =
            self.pressure.map(|share| format!("in {:.0} % of the last ten seconds one had to wait", 100.0 * share));
        let parts: Vec<String> = [threads, waits].into_iter().flatten().collect();
        Some(format!("the computer is busy with other programs: {}", parts.join(", and ")))
    }

    /// Returns a sentence with the cure if the computer is busy.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        self.clause().map(|words| format!("{words}; {CURE}"))
    }
}

/// The cure for a busy computer.
pub const CURE: &str =
    "end other programs, or permit [realtime] as `nims doctor` explains; until then the robot may be slow or pause";

/// Monitors the pressure; reports when the computer becomes busy and when that ends.
#[derive(Debug, Default)]
pub struct Watch {
    pressure: Option<Pressure>,
    last: Option<(u64, u64)>,
    busy: bool,
}

/// Time between two readings, ns.
const POLL_NS: u64 = 2_000_000_000;
/// Pressure between two readings above which the computer becomes busy.
const BECOMES: f64 = 0.5;
/// Pressure below which it is no longer busy; lower than [`BECOMES`] to avoid alternating reports.
const ENDS: f64 = 0.15;

impl Watch {
    /// Starts monitoring; without the kernel's statistics it never reports a change.
    #[must_use]
    pub fn new() -> Self {
        Self { pressure: Pressure::open(), last: None, busy: false }
    }

    /// Reads the pressure every two seconds; returns a change.
    pub fn poll(&mut self, now_ns: u64) -> Option<Change> {
        if self.last.is_some_and(|(then_ns, _)| now_ns < then_ns + POLL_NS) {
            return None;
        }
        let some_us = self.pressure.as_ref()?.waiting_us()?;
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

/// A change of the load of the computer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// The computer has become busy: the fraction of the time in which a thread waited for a CPU.
    Busy(f64),
    /// The computer is no longer busy.
    Over,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(now: u32) -> Option<Load> {
        Some(Load { minute: 3.0, now, processors: 2 })
    }

    #[test]
    fn a_computer_with_little_load_causes_no_warning() {
        assert_eq!(SystemLoad { pressure: Some(0.1), load: load(4) }.warning(), None);
        assert_eq!(SystemLoad { pressure: None, load: None }.warning(), None);
    }

    #[test]
    fn the_warning_contains_the_known_figures_and_the_cure() {
        let words = SystemLoad { pressure: Some(0.93), load: load(13) }.warning().unwrap();
        for part in ["13 threads", "2 processors", "93 %", "nims doctor"] {
            assert!(words.contains(part), "{words}");
        }
        // Each of the two statistics alone suffices.
        assert!(SystemLoad { pressure: None, load: load(13) }.clause().is_some());
        assert!(SystemLoad { pressure: Some(0.3), load: None }.clause().is_some());
    }

    #[test]
    fn changes_are_reported_once() {
        const S: u64 = 1_000_000_000;
        let mut watch = Watch::default();
        let steps = [(0, 0), (2, 100_000), (4, 1_900_000), (6, 2_900_000), (8, 3_000_000), (10, 3_100_000)];
        let changes: Vec<Option<Change>> = steps.into_iter().map(|(s, us)| watch.step(s * S, us)).collect();
        assert_eq!(changes, [None, None, Some(Change::Busy(0.9)), None, Some(Change::Over), None]);
    }
}
