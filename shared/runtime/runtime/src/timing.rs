//! Durations of the passes of a loop.

use hdrhistogram::Histogram;

/// Largest recorded duration, ns; longer passes count as this.
const LONGEST_NS: u64 = 10_000_000_000;
/// Significant digits of the histogram: with two it takes 14 KB, and its error is below one percent.
const DIGITS: u8 = 2;

/// Histogram of the durations of passes; recording neither allocates nor blocks.
#[derive(Debug)]
pub struct Timing {
    histogram: Option<Histogram<u32>>,
    began_ns: Option<u64>,
    max_ns: u64,
    passes: u64,
}

impl Default for Timing {
    fn default() -> Self {
        Self::new()
    }
}

impl Timing {
    /// Creates an empty histogram.
    #[must_use]
    pub fn new() -> Self {
        // The bounds are valid, so this never is `None`.
        Self { histogram: Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).ok(), began_ns: None, max_ns: 0, passes: 0 }
    }

    /// Records the start of a pass.
    pub fn begin(&mut self, now_ns: u64) {
        self.began_ns = Some(now_ns);
    }

    /// Records the end of a pass; ignored without a start.
    pub fn end(&mut self, now_ns: u64) {
        if let Some(began) = self.began_ns.take() {
            let busy = now_ns.saturating_sub(began);
            self.passes += 1;
            self.max_ns = self.max_ns.max(busy);
            if let Some(histogram) = &mut self.histogram {
                histogram.saturating_record(busy.max(1));
            }
        }
    }

    /// Returns the number of recorded passes.
    #[must_use]
    pub fn passes(&self) -> u64 {
        self.passes
    }

    /// Returns the quantile of the durations, ns, to two digits; 0 before the first pass.
    #[must_use]
    pub fn quantile_ns(&self, fraction: f64) -> u64 {
        self.histogram
            .as_ref()
            .filter(|histogram| !histogram.is_empty())
            .map_or(0, |histogram| histogram.value_at_quantile(fraction))
    }

    /// Returns how many durations are in this range, ns, both ends included, to two digits.
    #[must_use]
    pub fn count_between_ns(&self, low_ns: u64, high_ns: u64) -> u64 {
        self.histogram.as_ref().map_or(0, |histogram| histogram.count_between(low_ns.max(1), high_ns))
    }

    /// Returns the longest duration, ns, exact.
    #[must_use]
    pub fn max_ns(&self) -> u64 {
        self.max_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_correct_to_two_digits() {
        let mut timing = Timing::new();
        timing.end(5);
        assert_eq!((timing.passes(), timing.quantile_ns(0.5)), (0, 0));
        for k in 1..=1000 {
            timing.begin(7_000_000);
            timing.end(7_000_000 + k * 1000);
        }
        assert_eq!((timing.passes(), timing.max_ns()), (1000, 1_000_000));
        for (fraction, exact) in [(0.5, 500_000.0), (0.99, 990_000.0)] {
            assert!((timing.quantile_ns(fraction) as f64 / exact - 1.0).abs() < 0.01);
        }
        let halves = [timing.count_between_ns(0, 500_000), timing.count_between_ns(510_000, u64::MAX)];
        assert!(halves.iter().all(|half| (490..=510).contains(half)), "{halves:?}");
        timing.begin(0);
        timing.end(u64::MAX);
        assert_eq!(timing.max_ns(), u64::MAX);
    }
}
