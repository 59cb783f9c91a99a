//! A budget per second with a burst.

/// Grants so many units per second.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Budget {
    per_s: f64,
    most: f64,
    left: f64,
    at_ns: u64,
}

impl Budget {
    /// Begins with a whole burst of `most` units.
    pub(crate) fn new(per_s: f64, most: f64, now_ns: u64) -> Self {
        Self { per_s, most, left: most, at_ns: now_ns }
    }

    /// Spends one unit, if there is one.
    pub(crate) fn spend(&mut self, now_ns: u64) -> bool {
        let passed_s = now_ns.saturating_sub(self.at_ns) as f64 * 1e-9;
        self.left = (self.left + passed_s * self.per_s).min(self.most);
        self.at_ns = now_ns;
        let granted = self.left >= 1.0;
        if granted {
            self.left -= 1.0;
        }
        granted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_passes_and_then_the_rate() {
        let second = 1_000_000_000;
        let mut budget = Budget::new(10.0, 5.0, second);
        let granted = |budget: &mut Budget, at_ns| (0..100).filter(|_| budget.spend(at_ns)).count();
        assert_eq!(granted(&mut budget, second), 5);
        assert_eq!(granted(&mut budget, second + second / 10), 1);
        // Never more than a burst, however long nothing was spent.
        assert_eq!(granted(&mut budget, 100 * second), 5);
        // Time does not run back.
        assert_eq!(granted(&mut budget, second), 0);
    }
}
