//! Readings that wait for time that no cycle leaves.

/// Cycles in a row that leave the readings out before all are taken all the same: the status of a unit, which may have
/// a stop button, is then read four times in a second of a hundred cycles, and at most every 25th cycle comes late.
const MOST_LEFT_OUT: u32 = 24;
/// Longest time for which it is left out, ns: that of as many cycles at 100 Hz. At lower rates a stop button would wait
/// for more than a second, so there the time decides, and more of the cycles come late.
const LONGEST_NS: u64 = 240_000_000;
/// Cycles in a row that leave out one of many values which costs a later cycle its deadline: every eighth reads one. So
/// the status and the duties of a single unit, each of which is every third value, are 0.24 s old at most at 100 Hz.
const MOST_LEFT_OUT_VALUES: u32 = 7;
/// Time in which the status and the duties of each unit and one more value are read at rates that leave more than so
/// many cycles for it, ns: [`LONGEST_NS`], less what the begin of a cycle may differ by.
const ROUND_NS: u64 = 228_000_000;

/// Cycles in a row that had no time for readings that can wait.
#[derive(Debug, Clone, Copy, Default)]
pub struct Overdue {
    left_out: u32,
    /// Time of the first of them, or of the value that was read before them, ns.
    since_ns: u64,
    /// The last reading did not fit, and the cycle after it is not judged yet.
    on_trial: bool,
    /// The last reading that did not fit cost a later cycle its deadline, or seems to: a cycle that the computer made
    /// late looks the same, and makes the values rare until the next of them.
    costs: bool,
}

impl Overdue {
    /// True where the readings of this cycle are to be taken: they fit, or have been left out too often.
    pub fn is_due(&mut self, fits: bool, now_ns: u64) -> bool {
        if self.left_out == 0 {
            self.since_ns = now_ns;
        }
        let waited_ns = now_ns.saturating_sub(self.since_ns);
        let due = fits || self.left_out >= MOST_LEFT_OUT || waited_ns >= LONGEST_NS;
        self.left_out = if due { 0 } else { self.left_out + 1 };
        due
    }

    /// The same where one of many values is read at a time, which does not fit. A unit has several of them, so they
    /// are read in every second cycle while that costs no cycle its deadline, because the port is free again before the
    /// next one needs it. Otherwise they are rare ([`Overdue::is_rare`]): one in 80 ms for one unit, and in less time
    /// for several, but from 100 Hz on not more than one in eight cycles.
    pub fn is_value_due(&mut self, now_ns: u64, units: usize) -> bool {
        let due = if self.costs { self.is_rare_value_due(now_ns, units) } else { self.left_out > 0 };
        if due {
            (self.left_out, self.since_ns) = (0, now_ns);
        } else {
            self.left_out += 1;
        }
        self.on_trial = due;
        due
    }

    /// Whether values are rare, because the last one cost a cycle its deadline. Of the values that are read then, the
    /// status and the duties of every unit are to be all but one of a round.
    pub fn is_rare(&self) -> bool {
        self.costs
    }

    fn is_rare_value_due(&self, now_ns: u64, units: usize) -> bool {
        let units = u64::try_from(units).unwrap_or(u64::MAX).max(1);
        let waited_ns = now_ns.saturating_sub(self.since_ns);
        let turn_ns = ROUND_NS / units.saturating_mul(2).saturating_add(1);
        // At a low rate so many cycles are a long time.
        let longest_ns = (LONGEST_NS / units).max(ROUND_NS / 3);
        self.left_out >= MOST_LEFT_OUT_VALUES && waited_ns >= turn_ns || waited_ns >= longest_ns
    }

    /// Whether the exchange after [`Overdue::is_value_due`] came late.
    pub fn judge(&mut self, late: bool) {
        if std::mem::take(&mut self.on_trial) {
            self.costs = late;
        }
        // A late cycle has no time to ask whether a value is due, and counts all the same.
        self.left_out += u32::from(late && self.costs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cycles, of this period, in which a reading is taken that never fits.
    fn read(cycles: u64, period_ns: u64) -> Vec<u64> {
        let mut overdue = Overdue::default();
        (1..=cycles).filter(|cycle| overdue.is_due(false, cycle * period_ns)).collect()
    }

    #[test]
    fn what_never_fits_is_read_in_every_25th_cycle() {
        for rate_hz in [100, 200, 500] {
            assert_eq!(read(60, 1_000_000_000 / rate_hz), [25, 50], "{rate_hz} Hz");
        }
        let mut overdue = Overdue::default();
        assert!(overdue.is_due(true, 0));
        assert!((0..24).all(|_| !overdue.is_due(false, 0)), "it counts from the last reading");
    }

    #[test]
    fn a_stop_button_waits_no_longer_at_a_low_rate() {
        assert_eq!(read(20, 50_000_000), [6, 12, 18]);
        assert_eq!(read(40, 20_000_000), [13, 26, 39]);
    }

    /// Gaps between the cycles, at this rate, in which a value of so many units is read that never fits, where this
    /// costs a cycle its deadline or not.
    fn gaps(rate_hz: u64, units: usize, late: bool) -> Vec<u64> {
        let (mut overdue, mut last) = (Overdue::default(), false);
        let due = |cycle: &u64| {
            let is_late = late && last;
            overdue.judge(is_late);
            last = !is_late && overdue.is_value_due(cycle * 1_000_000_000 / rate_hz, units);
            last
        };
        let read: Vec<u64> = (1..=400).filter(due).collect();
        read.windows(2).map(|two| two[1] - two[0]).collect()
    }

    #[test]
    fn a_value_that_costs_no_cycle_is_read_in_every_second_one() {
        assert!(gaps(100, 1, false).iter().all(|gap| *gap == 2));
        for (rate_hz, units, cycles) in
            [(20, 1, 5), (50, 1, 8), (100, 1, 8), (100, 2, 8), (100, 4, 8), (200, 1, 16), (200, 2, 10), (500, 1, 38)]
        {
            let gaps = gaps(rate_hz, units, true);
            assert!(gaps.iter().all(|gap| *gap == cycles), "{rate_hz} Hz, {units} units: {gaps:?}");
        }
    }

    #[test]
    fn a_late_cycle_that_follows_no_such_reading_is_no_evidence() {
        let mut overdue = Overdue::default();
        overdue.judge(true);
        assert!(!overdue.is_value_due(0, 1) && overdue.is_value_due(1, 1));
        overdue.judge(false);
        overdue.judge(true);
        assert!(!overdue.is_value_due(2, 1) && overdue.is_value_due(3, 1));
    }
}
