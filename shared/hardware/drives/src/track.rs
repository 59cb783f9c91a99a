//! Where the motion of counts leads, for protocols whose checksums miss some errors.

use crate::{AXES, CountBound};

/// Motion older than this leads nowhere, ns.
const OLD_NS: u64 = 500_000_000;
/// Time between two reads of a counter by a unit that were asked one after the other, ns: its loop takes a millisecond.
const SCAN_NS: u64 = 1_000_000;
/// Share of its highest speed by which a motor changes it from one sample to the next without being asked again.
const ABRUPT: u64 = 8;

/// The motion of a unit's counts up to the last sample that was used.
///
/// A changed digit makes another number, and nothing else shows it. So a motion that the one before does not lead to is
/// used once it was read again: the same error does not come twice.
#[derive(Debug, Clone, Copy, Default)]
pub struct Track {
    /// Speeds between the last two samples, counts per nanosecond.
    pace: Option<[f64; AXES]>,
    /// Motion since the last sample used that came unexpectedly, and its time, ns.
    abrupt: Option<([i64; AXES], u64)>,
}

impl Track {
    /// Motion that is expected in this time, counts.
    #[must_use]
    pub fn ahead(&self, passed_ns: u64) -> Option<[i64; AXES]> {
        let pace = self.pace.filter(|_| passed_ns < OLD_NS)?;
        Some(pace.map(|pace| (pace * passed_ns as f64).round() as i64))
    }

    /// True for a motion, in counts since the last sample used, that the motion before leads to, or that was read twice
    /// in a row. `at_ns` is the time of the sample.
    pub fn is_sure(&mut self, bound: CountBound, moved: [i64; AXES], passed_ns: u64, at_ns: u64) -> bool {
        let Some(ahead) = self.ahead(passed_ns) else { return true };
        let agree = |from: [i64; AXES], ns: u64| {
            from.iter().zip(moved).all(|(from, to)| within(bound, to.saturating_sub(*from), ns))
        };
        let expected = agree(ahead, passed_ns / ABRUPT);
        let again = self.abrupt.is_some_and(|(before, before_ns)| agree(before, at_ns.saturating_sub(before_ns)));
        self.abrupt = (!expected && !again).then_some((moved, at_ns));
        expected || again
    }

    /// Records the motion between two samples that were used.
    pub fn record(&mut self, moved: [i64; AXES], passed_ns: u64) {
        if passed_ns > 0 {
            self.pace = Some(moved.map(|counts| counts as f64 / passed_ns as f64));
        }
    }

    /// Forgets the motion: the next one continues nothing.
    pub fn forget(&mut self) {
        *self = Self::default();
    }
}

/// True where a motor can have moved so far between two reads that were asked in this time.
#[must_use]
pub fn within(bound: CountBound, moved: i64, apart_ns: u64) -> bool {
    CountBound { margin: 1.0, ..bound }.explains(moved as f64, apart_ns + SCAN_NS)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUND: CountBound = CountBound { counts_s: 100_000.0, margin: 50.0 };
    const CYCLE_NS: u64 = 10_000_000;

    #[test]
    fn a_motion_that_nothing_leads_to_is_used_once_it_was_read_again() {
        let mut track = Track::default();
        assert!(track.is_sure(BOUND, [900, 0], CYCLE_NS, CYCLE_NS), "nothing is expected yet");
        track.record([500, 0], CYCLE_NS);
        assert_eq!(track.ahead(2 * CYCLE_NS), Some([1000, 0]));
        // an eighth of the highest speed in 10 ms is 125 counts, and a millisecond of it 100
        assert!(track.is_sure(BOUND, [700, 0], CYCLE_NS, 2 * CYCLE_NS));
        assert!(!track.is_sure(BOUND, [-500, 0], CYCLE_NS, 3 * CYCLE_NS), "backwards");
        assert!(!track.is_sure(BOUND, [9_000, 0], 2 * CYCLE_NS, 4 * CYCLE_NS), "and another wrong number");
        assert!(track.is_sure(BOUND, [9_300, 0], 3 * CYCLE_NS, 5 * CYCLE_NS), "the same twice is true");
        track.forget();
        assert!(track.is_sure(BOUND, [-9_000, 0], CYCLE_NS, 6 * CYCLE_NS));
    }
}
