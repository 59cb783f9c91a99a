//! The interface between the estimator and its methods, for one cable.

/// The parameters of the methods: `[estimator]` of the system file.
pub use config::EstimatorSection as Parameters;

use cable_robot::rate::lasting;

/// Largest number of cycles without a reading that a method may bridge, at more than 250 Hz as long: a hiccup of the
/// machine does not become shorter. A drive unit is lost after the same number of cycles without an answer.
pub const BRIDGED_CYCLES: u32 = 3;

/// A method of estimation for one cable: computes length and velocity at an instant from readings and commands.
///
/// The estimator creates one per cable at its start and calls it in every control cycle: first [`read`](Self::read),
/// then [`at`](Self::at). The estimator itself computes the node's position, tensions and covariance, and handles slots
/// and epochs. If the measurement of a cable is missing or not finite, the estimate of that cycle is not valid.
///
/// Methods run in the control cycle: they must not wait, use input or output, read a clock, or allocate. The same calls
/// must give the same bits, so that a run can be replayed; use `libm` for functions that IEEE 754 does not fix.
///
/// Cable velocity is dL/dt: positive pays out. Lengths are unstretched lengths from pulley to node.
pub trait CableEstimator: CopyToBox + Send {
    /// Processes the sample of one cycle. Called once per cycle, in the order of the cycles.
    fn read(&mut self, sample: &CableSample);

    /// Returns length and velocity at an instant of the cycle that was read last; `None` if they are unknown.
    ///
    /// The instant is a few milliseconds after or before the reading, plus one period for each cycle without a reading.
    /// It is not called after a longer time without a reading than [`Instant::bridges`].
    fn at(&self, instant: &Instant) -> Option<Measurement>;

    /// Drops all readings: another life of motor-io has started, or a cycle was repeated. An identified model of the
    /// winch may remain.
    fn forget(&mut self);

    /// Declares the next reading correct even if it does not fit: with a new epoch, the operator may have set the
    /// lengths. Called before the [`read`](Self::read) of that cycle.
    fn expect_anything(&mut self) {}

    /// Changes the parameters between two cycles (`nims set`). The state of the method should remain, so that the
    /// estimate does not jump. For a custom method it is also called once before the first reading.
    fn retune(&mut self, _parameters: &Parameters) {}

    /// Returns further constants of the method as TOML, one `key = value` per text line. The run file stores them.
    fn constants(&self) -> String {
        String::new()
    }
}

/// Copies an estimator with its state to a box; implemented for every `Clone` type.
pub trait CopyToBox {
    /// Returns the copy.
    fn copy_to_box(&self) -> Box<dyn CableEstimator>;
}

impl<E: CableEstimator + Clone + 'static> CopyToBox for E {
    fn copy_to_box(&self) -> Box<dyn CableEstimator> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn CableEstimator> {
    fn clone(&self) -> Self {
        (**self).copy_to_box()
    }
}

/// Reading and command of one cable in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CableSample {
    /// Control cycle. It increases by one from sample to sample, or by more if samples were lost.
    pub cycle: u64,
    /// Unstretched length from the encoder, m, finite; `None` if this cycle has no reading.
    pub length_m: Option<f64>,
    /// Time of the reading, ns on the monotonic clock; meaningless without a reading.
    pub sampled_ns: u64,
    /// Velocity commanded at the start of this cycle, m/s, finite. It applies until the command of the next cycle.
    pub command_m_s: f64,
    /// Period of the control cycle, s; 0 if it is unknown.
    pub period_s: f64,
}

impl CableSample {
    /// Returns the instant of the reading; meaningless without a reading.
    #[must_use]
    pub fn instant(&self) -> Instant {
        Instant { cycle: self.cycle, time_ns: self.sampled_ns, period_s: self.period_s }
    }
}

/// An instant of a control cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// The cycle.
    pub cycle: u64,
    /// Time on the monotonic clock, ns.
    pub time_ns: u64,
    /// Period of the control cycle, s; 0 if it is unknown.
    pub period_s: f64,
}

impl Instant {
    /// Returns true if a method may bridge the time from a reading of this or an earlier cycle to this instant: at most
    /// [`BRIDGED_CYCLES`], and at more than 250 Hz as long as these are there.
    pub fn bridges(&self, cycle: u64) -> bool {
        self.is_within(BRIDGED_CYCLES, cycle)
    }

    /// The same for so many cycles.
    pub(crate) fn is_within(&self, cycles: u32, cycle: u64) -> bool {
        let most = u64::from(lasting(cycles, self.period_s));
        self.cycle.checked_sub(cycle).is_some_and(|silent| silent <= most)
    }

    /// Returns the time from a reading of this or an earlier cycle to this instant, s; negative if the instant is
    /// before the reading. Limited to 0.1 s per cycle, the longest period (10 Hz), so that a clock that jumps does not
    /// move the node.
    pub fn ahead_of_s(&self, sampled_ns: u64, cycle: u64) -> f64 {
        let silent = self.cycle.saturating_sub(cycle);
        let ahead_s = if self.time_ns >= sampled_ns {
            (self.time_ns - sampled_ns) as f64 * 1e-9
        } else {
            -((sampled_ns - self.time_ns) as f64 * 1e-9)
        };
        ahead_s.clamp(-0.1, 0.1 * (1 + silent) as f64)
    }
}

/// Length and velocity of one cable at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Unstretched length, m.
    pub length_m: f64,
    /// Velocity dL/dt during the present cycle, m/s.
    pub velocity_m_s: f64,
    /// Velocity for the velocity of the node, m/s; `None`: motor-io's mean over 50 ms is used, because in a method
    /// without memory one encoder step in one cycle is a large velocity.
    pub steady_velocity_m_s: Option<f64>,
    /// Standard deviation of the length in addition to that of a reading (`sigma_length_m`), m.
    pub sigma_m: f64,
    /// `[φ1, φ2]` of the motor model (18); zeros for a method without it.
    pub phi: [f64; 2],
    /// Time of the newest reading that it contains, ns on the monotonic clock.
    pub sampled_ns: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cycles after a reading that are bridged at this period, s.
    fn bridged(period_s: f64) -> u64 {
        let at = |cycle| Instant { cycle, time_ns: 0, period_s };
        (0..20).take_while(|silent| at(100 + silent).bridges(100)).count() as u64 - 1
    }

    #[test]
    fn cycles_count_by_their_time_where_they_are_short() {
        let periods_s = [0.1, 0.01, 0.004, 0.0025, 0.002];
        assert_eq!(periods_s.map(bridged), [3, 3, 3, 5, 6]);
    }

    #[test]
    fn without_a_period_no_cycle_is_short() {
        assert_eq!(bridged(0.0), u64::from(BRIDGED_CYCLES));
        assert!(!Instant { cycle: 99, time_ns: 0, period_s: 0.01 }.bridges(100), "an earlier cycle");
    }
}
