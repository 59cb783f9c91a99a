//! The seam between the estimator and its methods: what a method is told of one cable, and what it answers.

use config::EstimatorSection;

/// Cycles without a reading that a method may bridge. The same number of silent cycles makes a drive unit lost.
pub const BRIDGED_CYCLES: u64 = 3;

/// A method of estimation for one cable: its readings and commands to its length and velocity at an instant.
///
/// The estimator makes one per cable at its start and calls it in every control cycle: first [`read`](Self::read), then
/// [`at`](Self::at). Around it everything stays as it is: the node's position from the lengths, tensions, covariance, slots and epochs.
/// A cable without a measurement makes the estimate of that cycle invalid, and so does a measurement that is not finite.
///
/// All methods run in the control cycle: no waiting, no input or output, no clock, and no allocation. The same calls give the same bits,
/// so that a run replays; take functions that IEEE 754 does not fix from `libm`.
///
/// Cable velocity is dL/dt: positive pays out. Lengths are unstretched lengths from pulley to node.
pub trait CableEstimator: CopyToBox + Send {
    /// Takes what motor-io says of the cable in one cycle, in the order of the cycles, each cycle once.
    fn read(&mut self, sample: &CableSample);

    /// Where the cable is at an instant of the cycle that was read last; `None` if that is not known.
    ///
    /// The instant lies a few milliseconds after the reading, or before it; a cycle later for each cycle without a reading. The
    /// estimator does not ask after more than [`BRIDGED_CYCLES`] cycles without a reading.
    fn at(&self, instant: &Instant) -> Option<Measurement>;

    /// All readings are void: motor-io has begun another life, or a cycle came twice. What was learnt of the winch may stay.
    fn forget(&mut self);

    /// The next reading may be anywhere, and is right: the operator may have given the lengths anew (a new epoch). Called before the
    /// [`read`](Self::read) of that cycle.
    fn expect_anything(&mut self) {}

    /// Other parameters, between two cycles (`nims set`). What was filtered and learnt stays, so that the estimate does not jump. A method
    /// in a program of its own is told the parameters once before its first reading too.
    fn retune(&mut self, _parameters: &Parameters) {}

    /// The method's own constants as TOML, `key = value` in each line: with them the run file says what a method flew with that nims does
    /// not know.
    fn constants(&self) -> String {
        String::new()
    }
}

/// A copy in a box, with all that was learnt; every `Clone` type has it. The estimator makes one for each cable, at its start.
pub trait CopyToBox {
    /// The copy.
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

/// What motor-io says of one cable in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CableSample {
    /// Control cycle. It grows by one from sample to sample, or by more where samples were lost.
    pub cycle: u64,
    /// Unstretched length as the encoder says, m, finite; `None` where this cycle has no reading.
    pub length_m: Option<f64>,
    /// When the encoder was read, ns on the monotonic clock; without a reading it has no meaning.
    pub sampled_ns: u64,
    /// Velocity that the drive was told at the beginning of this cycle, m/s, finite. It holds until that of the next cycle.
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
    /// From a reading of this or an earlier cycle to this instant, s. Signed: the instant may lie before the reading. A clock that jumped
    /// must not throw the node about: at 250 Hz to 10 Hz no cycle is longer than 0.1 s.
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

/// One cable at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Unstretched length, m.
    pub length_m: f64,
    /// Velocity dL/dt during the present cycle, m/s.
    pub velocity_m_s: f64,
    /// Velocity from which the node's own is computed, m/s; `None`: motor-io's over 50 ms, because one encoder step in one cycle is a
    /// large velocity and a method without memory shows it.
    pub steady_velocity_m_s: Option<f64>,
    /// Standard deviation of the length that comes on top of a reading's own (`sigma_length_m`), m.
    pub sigma_m: f64,
    /// `[φ1, φ2]` of the motor model (18); zeros for a method without it.
    pub phi: [f64; 2],
    /// When the newest reading in it was taken, ns on the monotonic clock.
    pub sampled_ns: u64,
}

/// The numbers of `[estimator]` in the system file that tune a method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// Rows of the sliding window of (19).
    pub eta: usize,
    /// Pull towards `prior`, (m/s)².
    pub ridge: f64,
    /// `[φ1, φ2]` of a window that says nothing.
    pub prior: [f64; 2],
    /// How late the drives follow, delay and lag together, s.
    pub drive_lag_s: f64,
    /// Standard deviation of the acceleration of a line that such a drive does not explain, m/s².
    pub acceleration_sigma_m_s2: f64,
    /// Standard deviation of one reading, m.
    pub reading_sigma_m: f64,
}

impl From<&EstimatorSection> for Parameters {
    fn from(section: &EstimatorSection) -> Self {
        let &EstimatorSection { eta, ridge, prior, drive_lag_s, acceleration_sigma_m_s2, reading_sigma_m, .. } =
            section;
        Self { eta, ridge, prior, drive_lag_s, acceleration_sigma_m_s2, reading_sigma_m }
    }
}

impl Default for Parameters {
    /// As a system file without `[estimator]` has them.
    fn default() -> Self {
        Self::from(&EstimatorSection::default())
    }
}
