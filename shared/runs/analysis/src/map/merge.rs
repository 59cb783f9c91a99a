//! Recorded and computed samples of a sensor as one sequence in the order of their times.

use messages::Sample;
use std::collections::VecDeque;

/// Time around a recorded sample for which its sensor counts as recorded, ns: the sensor logger leaves out single
/// readings on purpose, and a restart takes longer.
const APART_NS: u64 = 2_000_000_000;
/// Age from which a stretch of recorded samples is forgotten, ns: readings arrive in about their order.
const LONG_NS: u64 = 60_000_000_000;

/// Origin of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// Recorded in flight by the sensor logger.
    Recorded,
    /// Computed from readings and estimates.
    Computed,
}

/// Samples of a sensor of the last few seconds: a computed one waits until it is known whether the sensor logger
/// recorded any at its time, and those of later times wait behind it.
#[derive(Default)]
pub(super) struct Merge {
    /// In the order of their stamps. A computed one has the time at which it was computed, ns; a recorded one has none.
    waiting: VecDeque<(Option<u64>, Sample)>,
    /// First and last stamp of stretches in which samples were recorded, ns.
    recorded: VecDeque<[u64; 2]>,
}

impl Merge {
    /// Adds a sample that the sensor logger recorded.
    pub(super) fn add_recorded(&mut self, sample: &Sample) {
        let stamp_ns = sample.header.stamp_ns;
        self.forget_before(stamp_ns);
        match self.recorded.back_mut() {
            Some([from_ns, to_ns]) if is_near([*from_ns, *to_ns], stamp_ns) => {
                (*from_ns, *to_ns) = ((*from_ns).min(stamp_ns), (*to_ns).max(stamp_ns));
            }
            _ => self.recorded.push_back([stamp_ns; 2]),
        }
        self.add(None, sample);
    }

    /// Adds a sample that was computed at this time.
    pub(super) fn add_computed(&mut self, now_ns: u64, sample: &Sample) {
        self.add(Some(now_ns), sample);
    }

    fn add(&mut self, computed_ns: Option<u64>, sample: &Sample) {
        // Samples arrive in about their order.
        let is_behind = |other: &Sample| other.header.stamp_ns > sample.header.stamp_ns;
        let behind = self.waiting.iter().rev().take_while(|(_, other)| is_behind(other)).count();
        self.waiting.insert(self.waiting.len() - behind, (computed_ns, *sample));
    }

    /// Returns the next sample that is due at this time; computed ones only where none was recorded.
    pub(super) fn next(&mut self, now_ns: u64) -> Option<(Origin, Sample)> {
        while let Some((computed_ns, sample)) = self.waiting.front().copied() {
            let Some(at_ns) = computed_ns else {
                self.waiting.pop_front();
                return Some((Origin::Recorded, sample));
            };
            if at_ns.saturating_add(2 * APART_NS) > now_ns {
                return None;
            }
            let stamp_ns = sample.header.stamp_ns;
            self.forget_before(stamp_ns);
            let known = self.recorded.iter().any(|stretch| is_near(*stretch, stamp_ns));
            self.waiting.pop_front();
            if !known {
                return Some((Origin::Computed, sample));
            }
        }
        None
    }

    /// Drops the stretches long before a sample: they are no neighbours of later samples either.
    fn forget_before(&mut self, stamp_ns: u64) {
        while self.recorded.front().is_some_and(|[_, to_ns]| to_ns.saturating_add(LONG_NS) < stamp_ns) {
            self.recorded.pop_front();
        }
    }
}

fn is_near([from_ns, to_ns]: [u64; 2], stamp_ns: u64) -> bool {
    (from_ns.saturating_sub(APART_NS)..=to_ns.saturating_add(APART_NS)).contains(&stamp_ns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Header;

    const PERIOD_NS: u64 = 10_000_000;

    fn at(number: u64) -> Sample {
        Sample { header: Header::at(1_000_000_000 + number * PERIOD_NS), reading_seq: number, ..Sample::default() }
    }

    /// An hour of readings at 100 Hz, whose samples the sensor logger recorded in every other minute, 0.3 s later.
    #[test]
    fn both_come_in_order_and_only_the_last_seconds_wait() {
        let (late, end) = (30, 360_000);
        let is_recorded = |number: u64| (number / 6000).is_multiple_of(2);
        let (mut merge, mut given, mut most) = (Merge::default(), Vec::new(), 0);
        for number in 0..end + late {
            let now_ns = at(number).header.stamp_ns;
            if number < end {
                merge.add_computed(now_ns, &at(number));
            }
            if number >= late && is_recorded(number - late) {
                merge.add_recorded(&at(number - late));
            }
            most = most.max(merge.waiting.len());
            given.extend(std::iter::from_fn(|| merge.next(now_ns)).map(|(origin, one)| (one.reading_seq, origin)));
        }
        given.extend(std::iter::from_fn(|| merge.next(u64::MAX)).map(|(origin, one)| (one.reading_seq, origin)));
        assert!(given.windows(2).all(|two| two[0].0 < two[1].0), "each once, in order");
        assert!(given.iter().all(|(number, origin)| (*origin == Origin::Recorded) == is_recorded(*number)));
        // At each of the 59 borders two seconds have neither.
        assert_eq!(given.len() as u64, end - 59 * APART_NS / PERIOD_NS);
        assert!(most <= 1000, "{most} samples waited");
    }
}
