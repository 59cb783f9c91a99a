//! How far a count can move.

/// Largest motion of an encoder count that its motor explains.
///
/// A driver holds back one sample beyond it, to find out whether the unit restarted and began to count at zero. It does
/// not judge whether the count is credible: the caller knows the robot and judges it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CountBound {
    /// Highest believable speed, counts per second. 0: no bound.
    pub counts_s: f64,
    /// Motion that is believed in no time at all, counts.
    pub margin: f64,
}

impl CountBound {
    /// Explains every motion. A restart is then found only when the watchdog is next read.
    pub const NONE: CountBound = CountBound { counts_s: 0.0, margin: 0.0 };

    /// True where the motor can have moved by so many counts in this time.
    #[must_use]
    pub fn explains(&self, moved: f64, passed_ns: u64) -> bool {
        self.counts_s <= 0.0 || moved.abs() <= self.counts_s * passed_ns as f64 * 1e-9 + self.margin
    }
}
