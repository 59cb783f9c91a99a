//! Statistics: medians, tails, ratios. Pure.

use runtime::Timing;
use serde::Serialize;

/// Distribution of a duration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Number of measurements.
    pub count: u64,
    /// Median, s.
    pub median_s: f64,
    /// 99.9 % quantile, s.
    pub p999_s: f64,
    /// Maximum, s.
    pub worst_s: f64,
}

impl Spread {
    /// Summarises the recorded times, to two digits except for the maximum. Times below the resolution of the clock
    /// count as 1 ns.
    #[must_use]
    pub fn from_timing(timing: &Timing) -> Self {
        let worst_ns = timing.max_ns().max(1);
        let quantile_s = |fraction| timing.quantile_ns(fraction).clamp(1, worst_ns) as f64 * 1e-9;
        Self {
            count: timing.passes(),
            median_s: quantile_s(0.5),
            p999_s: quantile_s(0.999),
            worst_s: worst_ns as f64 * 1e-9,
        }
    }

    /// Returns the distribution of one of `parts` equal steps that were timed together.
    #[must_use]
    pub fn divided(self, parts: u64) -> Self {
        let parts = parts.max(1) as f64;
        Self { median_s: self.median_s / parts, p999_s: self.p999_s / parts, worst_s: self.worst_s / parts, ..self }
    }
}

/// Time of the plain way divided by the time of the product.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ratio {
    /// Ratio of the medians.
    pub median: f64,
    /// Ratio of the 99.9 % quantiles.
    pub p999: f64,
}

impl Ratio {
    /// Divides two distributions.
    #[must_use]
    pub fn between(plain: &Spread, ours: &Spread) -> Self {
        Self { median: plain.median_s / ours.median_s, p999: plain.p999_s / ours.p999_s }
    }
}

/// Records one duration in a [`Timing`].
pub fn record(timing: &mut Timing, begin_ns: u64, end_ns: u64) {
    timing.begin(begin_ns);
    timing.end(end_ns);
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Records these durations, ns.
    pub fn timing(times: impl IntoIterator<Item = u64>) -> Timing {
        let mut timing = Timing::new();
        times.into_iter().for_each(|took| record(&mut timing, 5, 5 + took));
        timing
    }

    fn near(a: f64, b: f64) -> bool {
        (a / b - 1.0).abs() < 0.01
    }

    #[test]
    fn medians_and_tails_match_the_durations() {
        let spread = Spread::from_timing(&timing((1..=10_000).map(|k| k * 1000)));
        assert_eq!(spread.count, 10_000);
        assert!(near(spread.median_s, 5e-3) && near(spread.p999_s, 9.99e-3), "{spread:?}");
        assert_eq!(spread.worst_s, 1e-2);
        // One in a thousand lies beyond the 99.9 % quantile.
        let spread = Spread::from_timing(&timing(std::iter::repeat_n(1000, 999).chain([5_000_000])));
        assert!(near(spread.p999_s, 1e-6) && spread.worst_s == 5e-3, "{spread:?}");
        let spread = Spread::from_timing(&timing(std::iter::repeat_n(1000, 998).chain([5_000_000; 2])));
        assert!(near(spread.p999_s, 5e-3), "{spread:?}");
    }

    #[test]
    fn quantiles_never_exceed_the_maximum() {
        for took in [0, 1, 7, 1023, 1_234_567, u64::MAX - 5] {
            let spread = Spread::from_timing(&timing([took]));
            assert!(spread.median_s <= spread.p999_s && spread.p999_s <= spread.worst_s, "{spread:?}");
            assert!(spread.median_s > 0.0, "{spread:?}");
        }
        let none = Spread::from_timing(&timing([]));
        assert!(none.count == 0 && none.median_s > 0.0, "{none:?}");
    }

    #[test]
    fn ratios_and_parts() {
        let (ours, plain) = (Spread::from_timing(&timing([1000; 10])), Spread::from_timing(&timing([4000; 10])));
        let ratio = Ratio::between(&plain, &ours);
        assert!(near(ratio.median, 4.0) && near(ratio.p999, 4.0), "{ratio:?}");
        let part = plain.divided(4);
        assert!(near(part.median_s, ours.median_s) && near(part.worst_s, 1e-6) && part.count == 10, "{part:?}");
    }
}
