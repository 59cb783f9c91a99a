//! Readings that wait for time that no cycle leaves.

/// Cycles in a row that leave a reading out before it is taken all the same: the status of a unit, which may have a
/// stop button, is then read four times in a second of a hundred cycles, and at most every 25th cycle comes late.
const MOST_LEFT_OUT: u32 = 24;
/// Longest time for which it is left out, ns: that of as many cycles at 100 Hz. At lower rates a stop button would wait
/// for more than a second, so there the time decides, and more of the cycles come late.
const LONGEST_NS: u64 = 240_000_000;

/// Cycles in a row that had no time for readings that can wait.
#[derive(Debug, Clone, Copy, Default)]
pub struct Overdue {
    left_out: u32,
    /// Time of the first of them, ns.
    since_ns: u64,
    /// The last reading did not fit, and the cycle after it is not judged yet.
    on_trial: bool,
    /// The last reading that did not fit cost a later cycle its deadline.
    costs: bool,
}

impl Overdue {
    /// True where the readings of this cycle are to be taken: they fit, or have been left out too often.
    pub fn is_due(&mut self, fits: bool, now_ns: u64) -> bool {
        self.is_due_or(fits, now_ns, 1)
    }

    /// The same where one of many values is read at a time, which does not fit. A unit has several of them, so they
    /// are read in every second cycle while that costs no cycle its deadline, because the port is free again before the
    /// next one needs it; otherwise as rarely as in [`Overdue::is_due`], for each of so many units.
    pub fn is_value_due(&mut self, now_ns: u64, units: usize) -> bool {
        let free = self.left_out > 0 && !self.costs;
        self.on_trial = self.is_due_or(free, now_ns, units);
        self.on_trial
    }

    /// Whether the exchange after [`Overdue::is_value_due`] came late.
    pub fn judge(&mut self, late: bool) {
        if std::mem::take(&mut self.on_trial) {
            self.costs = late;
        }
    }

    fn is_due_or(&mut self, fits: bool, now_ns: u64, units: usize) -> bool {
        let units = u32::try_from(units).unwrap_or(u32::MAX).max(1);
        if self.left_out == 0 {
            self.since_ns = now_ns;
        }
        let waited_ns = now_ns.saturating_sub(self.since_ns);
        let due = fits || self.left_out >= MOST_LEFT_OUT / units || waited_ns >= LONGEST_NS / u64::from(units);
        self.left_out = if due { 0 } else { self.left_out + 1 };
        due
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

    /// Gaps between the cycles, of 10 ms, in which a value of so many units is read that never fits, where this costs a
    /// cycle its deadline or not.
    fn gaps(units: usize, late: bool) -> Vec<u64> {
        let mut overdue = Overdue::default();
        let due = |cycle: &u64| {
            overdue.judge(late);
            overdue.is_value_due(cycle * 10_000_000, units)
        };
        let read: Vec<u64> = (1..=200).filter(due).collect();
        read.windows(2).map(|two| two[1] - two[0]).collect()
    }

    #[test]
    fn a_value_that_costs_no_cycle_is_read_in_every_second_one() {
        assert!(gaps(1, false).iter().all(|gap| *gap == 2));
        assert!(gaps(1, true).iter().all(|gap| *gap == 25), "{:?}", gaps(1, true));
        assert!(gaps(2, true).iter().all(|gap| *gap == 13), "{:?}", gaps(2, true));
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
