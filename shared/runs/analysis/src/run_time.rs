//! Seconds since the start of a run, from log times and from stamps.

use messages::MotorAuthority;
use runlog::{RecordedSample, seconds_since};

/// The start of a run on both clocks. Requires every sample in order.
#[derive(Debug, Clone, Default)]
pub struct RunTime {
    /// UNIX time from which the run counts, ns; without a clock the log time of the first sample.
    begin_ns: Option<u64>,
    /// The same instant on the clock of the stamps, ns.
    mono_ns: Option<i128>,
}

impl RunTime {
    /// Creates it with the UNIX time from which the run counts, ns, if the run states it.
    #[must_use]
    pub fn new(begin_ns: Option<u64>) -> Self {
        Self { begin_ns, mono_ns: None }
    }

    /// Learns the start of the run from its next sample.
    pub fn observe(&mut self, recorded: &RecordedSample<'_>) {
        let begin_ns = *self.begin_ns.get_or_insert(recorded.log_time_ns);
        if self.mono_ns.is_none()
            && let Some(authority) = recorded.decode::<MotorAuthority>()
        {
            let since = i128::from(recorded.log_time_ns) - i128::from(begin_ns);
            self.mono_ns = Some(i128::from(authority.header.stamp_ns) - since);
        }
    }

    /// Returns a UNIX time since the start, s.
    #[must_use]
    pub fn logged_s(&self, unix_ns: u64) -> f64 {
        seconds_since(unix_ns, self.begin_ns.unwrap_or(unix_ns))
    }

    /// Returns the time of a stamp since the start, s.
    #[must_use]
    pub fn stamped_s(&self, stamp_ns: u64) -> f64 {
        self.mono_ns.map_or(0.0, |mono_ns| (i128::from(stamp_ns) - mono_ns) as f64 * 1e-9)
    }
}
