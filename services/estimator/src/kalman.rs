//! One cable with a Kalman filter on length and velocity: readings and commands in the order in which they happened.
//!
//! A command is sent at the beginning of a cycle and the encoder read some milliseconds later, so between two readings the
//! drive had the command of the earlier cycle, as far as the filter's few milliseconds are concerned.

use cable_control::length_filter::{FilterError, FilterSettings, LengthFilter, Verdict};

use crate::cable_estimator::{BRIDGED_CYCLES, CableEstimator, CableSample, Instant, Measurement, Parameters};

/// Those of its parameters that it uses, and the defaults of the others.
///
/// # Errors
/// One that is out of range.
pub(crate) fn used(parameters: &Parameters) -> Result<Parameters, FilterError> {
    settings(parameters)?;
    let &Parameters { drive_lag_s, acceleration_sigma_m_s2, reading_sigma_m, .. } = parameters;
    Ok(Parameters { drive_lag_s, acceleration_sigma_m_s2, reading_sigma_m, ..Parameters::default() })
}

/// A cable of which nothing is known yet.
pub(crate) fn cable(parameters: &Parameters) -> Box<dyn CableEstimator> {
    Box::new(KalmanEstimator::new(settings(parameters).ok()))
}

fn settings(parameters: &Parameters) -> Result<FilterSettings, FilterError> {
    FilterSettings::new(parameters.drive_lag_s, parameters.acceleration_sigma_m_s2, parameters.reading_sigma_m)
}

/// See the module's text.
#[derive(Debug, Clone, Copy)]
struct KalmanEstimator {
    /// `None` for parameters out of range, which [`used`] refuses: such a cable is never known.
    settings: Option<FilterSettings>,
    filter: Option<LengthFilter>,
    /// The instant of the filter's state, ns.
    true_ns: u64,
    /// When the newest reading that was taken was taken, ns, and its cycle.
    sampled_ns: u64,
    cycle: u64,
    /// Command sent in the last cycle, m/s.
    command_m_s: f64,
    /// Cycle of the newest reading, taken or not, and the time from the one before to it, ns.
    read_cycle: u64,
    elapsed_ns: u64,
    /// A reading that does not fit is believed at once.
    credulous: bool,
}

impl KalmanEstimator {
    fn new(settings: Option<FilterSettings>) -> Self {
        Self {
            settings,
            filter: None,
            true_ns: 0,
            sampled_ns: 0,
            cycle: 0,
            command_m_s: 0.0,
            read_cycle: 0,
            elapsed_ns: 0,
            credulous: false,
        }
    }

    /// Takes a reading of this cycle, or refuses it.
    fn take(&mut self, settings: FilterSettings, length_m: f64, sample: &CableSample) {
        let &CableSample { cycle, sampled_ns, .. } = sample;
        // After more than what may be bridged, what the drive did in the meantime is not known well enough.
        let silent = cycle.checked_sub(self.cycle);
        let known = self.filter.filter(|_| silent.is_some_and(|silent| silent <= 2 * BRIDGED_CYCLES));
        let mut filter = known.unwrap_or_else(|| LengthFilter::new(settings, length_m));
        let mut verdict = Verdict::BegunAnew;
        let elapsed_ns = sampled_ns.saturating_sub(self.true_ns);
        // After a cycle without a reading, or a machine that stood still, it is the prediction that is doubtful.
        let gap = self.read_cycle.checked_add(1) != Some(cycle) || elapsed_ns / 2 > self.elapsed_ns;
        (self.read_cycle, self.elapsed_ns) = (cycle, elapsed_ns);
        if known.is_some() {
            filter.predict(self.command_m_s, elapsed_ns as f64 * 1e-9);
            verdict = filter.read(length_m);
            if verdict == Verdict::Refused && (self.credulous || gap) {
                (filter, verdict) = (LengthFilter::new(settings, length_m), Verdict::BegunAnew);
            }
        }
        self.credulous = false;
        self.filter = Some(filter);
        self.true_ns = if verdict == Verdict::BegunAnew { sampled_ns } else { sampled_ns.max(self.true_ns) };
        if verdict != Verdict::Refused {
            (self.sampled_ns, self.cycle) = (sampled_ns, cycle);
        }
    }
}

impl CableEstimator for KalmanEstimator {
    fn read(&mut self, sample: &CableSample) {
        if let (Some(settings), Some(length_m)) = (self.settings, sample.length_m) {
            self.take(settings, length_m, sample);
        }
        self.command_m_s = sample.command_m_s;
    }

    /// The filter's state, carried on to the instant; `None` if too many readings in a row were refused.
    fn at(&self, instant: &Instant) -> Option<Measurement> {
        let mut filter = self.filter?;
        if instant.cycle.checked_sub(self.cycle)? > BRIDGED_CYCLES {
            return None;
        }
        filter.predict(self.command_m_s, instant.ahead_of_s(self.true_ns, self.cycle));
        let velocity_m_s = filter.velocity_m_s();
        Some(Measurement {
            length_m: filter.length_m(),
            velocity_m_s,
            steady_velocity_m_s: Some(velocity_m_s),
            sigma_m: filter.length_sigma_m(),
            phi: [0.0; 2],
            sampled_ns: self.sampled_ns,
        })
    }

    fn forget(&mut self) {
        *self = Self::new(self.settings);
    }

    fn expect_anything(&mut self) {
        self.credulous = true;
    }

    fn retune(&mut self, parameters: &Parameters) {
        let Ok(settings) = settings(parameters) else { return };
        self.settings = Some(settings);
        if let Some(filter) = &mut self.filter {
            filter.retune(settings);
        }
    }
}
