//! The interface between the estimator and its methods, for one cable.

/// The parameters of the methods: `[estimator]` of the system file.
pub use config::EstimatorSection as Parameters;

use cable_robot::rate::COUNTED_PERIOD_S;

/// Largest number of cycles without a reading that a method may bridge, at more than 250 Hz as long: a hiccup of the
/// machine does not become shorter. A drive unit is lost after the same number of cycles without an answer.
pub const BRIDGED_CYCLES: u64 = 3;
/// The same as a time, ns, and the most cycles that it is, at 500 Hz: a clock that stands still bridges no more.
const BRIDGED_NS: u64 = (BRIDGED_CYCLES as f64 * COUNTED_PERIOD_S * 1e9) as u64;
const MOST_BRIDGED_CYCLES: u64 = 2 * BRIDGED_CYCLES;
/// Least period, ns: that of 500 Hz, less what clocks differ by. An instant that stands still, because the estimator
/// missed cycles or knows no period, is no sign that the cycles were short.
const LEAST_PERIOD_NS: u64 = 1_900_000;

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
}

/// An instant of a control cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instant {
    /// The cycle.
    pub cycle: u64,
    /// Time on the monotonic clock, ns.
    pub time_ns: u64,
}

impl Instant {
    /// Returns true if a method may bridge the time from a reading of this or an earlier cycle to this instant: at most
    /// [`BRIDGED_CYCLES`], or as long as these are at 250 Hz.
    pub fn bridges(&self, sampled_ns: u64, cycle: u64) -> bool {
        self.is_within(1, sampled_ns, cycle)
    }

    /// The same for so many times of that.
    pub(crate) fn is_within(&self, times: u64, sampled_ns: u64, cycle: u64) -> bool {
        self.cycle.checked_sub(cycle).is_some_and(|silent| {
            let passed_ns = self.time_ns.saturating_sub(sampled_ns);
            // A reading may be up to a period later in its cycle than the instant is in its own.
            let least_ns = silent.saturating_sub(1).saturating_mul(LEAST_PERIOD_NS);
            let short = (least_ns..=times * BRIDGED_NS).contains(&passed_ns);
            silent <= times * BRIDGED_CYCLES || short && silent <= times * MOST_BRIDGED_CYCLES
        })
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

    /// Cycles after a reading that are bridged where the instant advances by this much in each, ns.
    fn bridged(advance_ns: u64) -> u64 {
        let at = |cycle| Instant { cycle, time_ns: 1_000_000_000 + cycle * advance_ns };
        (0..20).take_while(|silent| at(100 + silent).bridges(at(100).time_ns, 100)).count() as u64 - 1
    }

    #[test]
    fn cycles_count_by_their_time_where_they_are_short() {
        assert_eq!(bridged(10_000_000), BRIDGED_CYCLES);
        assert_eq!(bridged(4_000_000), BRIDGED_CYCLES);
        assert_eq!(bridged(2_000_000), MOST_BRIDGED_CYCLES);
    }

    #[test]
    fn an_instant_that_stands_still_makes_no_cycles_short() {
        assert_eq!(bridged(0), BRIDGED_CYCLES);
        // Readings of a cycle are apart, so the instant may be some milliseconds after one of them.
        assert!(!Instant { cycle: 104, time_ns: 5_000_000 }.bridges(0, 100));
    }
}
