//! The unit's clock beside the port's: whether an answer is of now, and whether the unit has restarted.

/// Largest difference of the two clocks' rates: a controller's own oscillator is within 1 %, and the maker trims it in
/// steps of 0.25 %.
const DRIFT: f64 = 0.02;
/// Milliseconds by which the two clocks may disagree besides: a simulated port's clock leaves out stalls of the machine
/// a little before or after its units do. A unit that is quiet gets one question in a cycle, and its questions have 720
/// orders, so within this time the order tells which one an answer is for.
const SLACK_MS: i64 = 1000;

/// A reading of the unit's millisecond counter between the question and the answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ClockReading {
    pub(super) ms: i32,
    pub(super) sent_ns: u64,
    pub(super) received_ns: u64,
}

impl ClockReading {
    /// True where a unit that did not restart since can show `later`: no earlier time, which is an older answer or a
    /// restart, and about as much later as the port's clock.
    pub(super) fn explains(&self, later: &ClockReading) -> bool {
        let passed_ms = i64::from(later.ms.wrapping_sub(self.ms));
        let least_ns = later.sent_ns.saturating_sub(self.received_ns) as f64;
        let most_ns = later.received_ns.saturating_sub(self.sent_ns) as f64;
        let least_ms = (least_ns * 1e-6 * (1.0 - DRIFT)) as i64 - SLACK_MS;
        let most_ms = (most_ns * 1e-6 * (1.0 + DRIFT)) as i64 + SLACK_MS;
        (least_ms.max(0)..=most_ms).contains(&passed_ms)
    }

    /// True where a unit that was switched on since, and so counts from zero, can show `later`.
    pub(super) fn allows_restart(&self, later: &ClockReading) -> bool {
        let most_ns = later.received_ns.saturating_sub(self.sent_ns) as f64;
        let most_ms = (most_ns * 1e-6 * (1.0 + DRIFT)) as i64 + SLACK_MS;
        (0..=most_ms).contains(&i64::from(later.ms))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn reading(ms: i32, sent_ms: u64) -> ClockReading {
        ClockReading { ms, sent_ns: sent_ms * 1_000_000, received_ns: (sent_ms + 1) * 1_000_000 }
    }

    #[test]
    fn an_older_answer_and_a_restart_are_told_from_a_fresh_answer() {
        let before = reading(50_000, 1000);
        assert!(before.explains(&reading(50_010, 1010)) && !before.allows_restart(&reading(50_010, 1010)));
        assert!(!before.explains(&reading(49_960, 1010)), "an answer of some cycles before");
        assert!(!before.allows_restart(&reading(49_960, 1010)), "an old answer is no restart");
        assert!(!before.explains(&reading(3, 1010)) && before.allows_restart(&reading(3, 1010)), "a restart");
        assert!(!before.explains(&reading(51_070, 1010)) && !before.allows_restart(&reading(51_070, 1010)));
        assert!(!before.explains(&reading(50_100, 3000)), "an answer of two seconds before");
        // Ten seconds later, with a clock that is 1 % slow or fast.
        assert!(before.explains(&reading(59_900, 11_000)) && before.explains(&reading(60_100, 11_000)));
        assert!(!before.explains(&reading(10_000, 11_000)));
        // Ten minutes old, switched on again a minute later, and next heard half an hour later.
        let (old, after) = (reading(600_000, 1000), reading(1_740_000, 1_801_000));
        assert!(!old.explains(&after) && old.allows_restart(&after));
        // The counter wraps after 25 days.
        assert!(reading(i32::MAX, 1000).explains(&reading(i32::MIN + 9, 1010)));
    }
}
