//! A Kalman filter on length and velocity of one cable, with readings and commands in chronological order.
//!
//! A command is sent at the start of a cycle, and the encoder is read some milliseconds later. The filter neglects this
//! time: between two readings it uses the command of the earlier cycle.

use cable_control::length_filter::{FilterError, FilterSettings, LengthFilter, Verdict};

use crate::cable_estimator::{BRIDGED_CYCLES, CableEstimator, CableSample, Instant, Measurement, Parameters};

/// Returns the parameters with those that the method does not use at their defaults.
///
/// # Errors
/// A parameter is out of range.
pub(super) fn used(parameters: &Parameters) -> Result<Parameters, FilterError> {
    settings(parameters)?;
    let &Parameters { drive_lag_s, acceleration_sigma_m_s2, reading_sigma_m, .. } = parameters;
    Ok(Parameters { drive_lag_s, acceleration_sigma_m_s2, reading_sigma_m, ..Parameters::default() })
}

/// Creates the estimator of a cable without readings.
pub(super) fn cable(parameters: &Parameters) -> Box<dyn CableEstimator> {
    Box::new(KalmanEstimator::new(settings(parameters).ok()))
}

fn settings(parameters: &Parameters) -> Result<FilterSettings, FilterError> {
    FilterSettings::new(parameters.drive_lag_s, parameters.acceleration_sigma_m_s2, parameters.reading_sigma_m)
}

#[derive(Debug, Clone, Copy)]
struct KalmanEstimator {
    /// `None` for parameters out of range, which [`used`] rejects: such a cable has no result.
    settings: Option<FilterSettings>,
    filter: Option<LengthFilter>,
    /// Time of the filter's state, ns.
    state_ns: u64,
    /// Time of the newest accepted reading, ns.
    sampled_ns: u64,
    /// Cycle of the newest accepted reading.
    cycle: u64,
    /// Command of the last cycle, m/s.
    command_m_s: f64,
    /// Cycle of the newest reading, accepted or not.
    read_cycle: u64,
    /// Time from the reading before the newest one to the newest one, ns.
    elapsed_ns: u64,
    /// Whether the next reading is accepted even if it does not fit.
    accept_any: bool,
}

impl KalmanEstimator {
    fn new(settings: Option<FilterSettings>) -> Self {
        Self {
            settings,
            filter: None,
            state_ns: 0,
            sampled_ns: 0,
            cycle: 0,
            command_m_s: 0.0,
            read_cycle: 0,
            elapsed_ns: 0,
            accept_any: false,
        }
    }

    /// Updates the filter with a reading of this cycle, or rejects the reading.
    fn update(&mut self, settings: FilterSettings, length_m: f64, sample: &CableSample) {
        let &CableSample { cycle, sampled_ns, .. } = sample;
        // After a longer gap, the motion of the drive in between is not known accurately enough.
        let known = self.filter.filter(|_| sample.instant().is_within(2 * BRIDGED_CYCLES, self.cycle));
        let mut filter = known.unwrap_or_else(|| LengthFilter::new(settings, length_m));
        let mut verdict = Verdict::BegunAnew;
        let elapsed_ns = sampled_ns.saturating_sub(self.state_ns);
        // After a cycle without a reading, or a stall of the machine, the prediction is less reliable than the reading.
        let gap = self.read_cycle.checked_add(1) != Some(cycle) || elapsed_ns / 2 > self.elapsed_ns;
        (self.read_cycle, self.elapsed_ns) = (cycle, elapsed_ns);
        if known.is_some() {
            filter.predict(self.command_m_s, elapsed_ns as f64 * 1e-9);
            verdict = filter.read(length_m);
            if verdict == Verdict::Refused && (self.accept_any || gap) {
                (filter, verdict) = (LengthFilter::new(settings, length_m), Verdict::BegunAnew);
            }
        }
        self.accept_any = false;
        self.filter = Some(filter);
        self.state_ns = if verdict == Verdict::BegunAnew { sampled_ns } else { sampled_ns.max(self.state_ns) };
        if verdict != Verdict::Refused {
            (self.sampled_ns, self.cycle) = (sampled_ns, cycle);
        }
    }
}

impl CableEstimator for KalmanEstimator {
    fn read(&mut self, sample: &CableSample) {
        if let (Some(settings), Some(length_m)) = (self.settings, sample.length_m) {
            self.update(settings, length_m, sample);
        }
        self.command_m_s = sample.command_m_s;
    }

    /// Extrapolates the filter's state to the instant; `None` if too many consecutive readings were rejected.
    fn at(&self, instant: &Instant) -> Option<Measurement> {
        let mut filter = self.filter?;
        if !instant.bridges(self.cycle) {
            return None;
        }
        filter.predict(self.command_m_s, instant.ahead_of_s(self.state_ns, self.cycle));
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
        self.accept_any = true;
    }

    fn retune(&mut self, parameters: &Parameters) {
        let Ok(settings) = settings(parameters) else { return };
        self.settings = Some(settings);
        if let Some(filter) = &mut self.filter {
            filter.retune(settings);
        }
    }
}
