//! How many samples of a channel may be passed on now.

const SECOND_NS: f64 = 1e9;

/// A share of samples that grows with time: what comes rarely passes whole, also in bursts of up to a second's share;
/// of what comes faster for long, only as much as the rate allows.
#[derive(Debug, Clone)]
pub struct Budget {
    rate_hz: f64,
    saved: f64,
    counted_ns: u64,
}

impl Budget {
    /// Creates a budget of `rate_hz` samples per second, with the budget of one second available at `now_ns`.
    #[must_use]
    pub fn new(rate_hz: f64, now_ns: u64) -> Self {
        Self { rate_hz, saved: rate_hz.max(1.0), counted_ns: now_ns }
    }

    /// Returns how many of `waiting` samples may be forwarded at `now_ns`, and spends the budget for them.
    pub fn spend(&mut self, waiting: usize, now_ns: u64) -> usize {
        let elapsed_s = now_ns.saturating_sub(self.counted_ns) as f64 / SECOND_NS;
        self.counted_ns = self.counted_ns.max(now_ns);
        self.saved = (self.saved + elapsed_s * self.rate_hz).min(self.rate_hz.max(1.0));
        let granted = waiting.min(self.saved as usize);
        self.saved -= granted as f64;
        granted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Number of samples forwarded from `from_s` to `to_s`, if `per_poll` samples arrive with each poll every 20 ms.
    fn passed(budget: &mut Budget, from_s: u64, to_s: u64, per_poll: usize) -> usize {
        (from_s * 50..to_s * 50).map(|poll| budget.spend(per_poll, poll * 20 * MS)).sum()
    }

    #[test]
    fn a_fast_channel_is_limited_to_the_rate() {
        let mut budget = Budget::new(30.0, 0);
        passed(&mut budget, 0, 2, 4); // spends the initial budget
        assert_eq!(passed(&mut budget, 2, 12, 4), 300);
    }

    #[test]
    fn a_slow_channel_passes_completely_also_in_bursts() {
        let mut budget = Budget::new(50.0, 0);
        assert_eq!(passed(&mut budget, 0, 10, 1), 500);
        let mut budget = Budget::new(50.0, 0);
        assert_eq!((1..10).map(|second| budget.spend(40, second * 1000 * MS)).sum::<usize>(), 9 * 40);
    }

    #[test]
    fn the_budget_is_limited_to_one_second_and_does_not_grow_while_the_clock_stands() {
        let mut budget = Budget::new(20.0, 0);
        assert_eq!(budget.spend(1000, 3_600_000 * MS), 20);
        assert_eq!(budget.spend(1000, 3_600_000 * MS), 0);
        assert_eq!(budget.spend(1000, 0), 0);
    }
}
