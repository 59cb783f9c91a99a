//! The paper's method for one cable, step 1 of its section VI: extrapolates the last reading with the motor model (18),
//! which is identified at run time.

use cable_control::length_filter::FilterError;
use cable_control::motor_model::PhiModel;

use crate::cable_estimator::{CableEstimator, CableSample, Instant, Measurement, Parameters};

/// Standard deviation of a predicted displacement, as a fraction of it: depending on the run, the error with the model
/// (18) is 0.2 to 0.8 of the error without prediction.
const PREDICTION_SIGMA: f64 = 0.5;

/// Velocity above which a change of length is not a motion, m/s: the operator has set the length. Twice the highest
/// cable speed limit of a robot file.
const JUMP_M_S: f64 = 20.0;

/// Returns the parameters with those that the method does not use at their defaults. Never fails: the model limits its
/// parameters itself.
pub(super) fn used(parameters: &Parameters) -> Result<Parameters, FilterError> {
    let &Parameters { eta, ridge, prior, .. } = parameters;
    Ok(Parameters { eta, ridge, prior, ..Parameters::default() })
}

/// Creates the estimator of a cable without readings.
pub(super) fn cable(parameters: &Parameters) -> Box<dyn CableEstimator> {
    Box::new(PhiEstimator::new(parameters))
}

#[derive(Debug, Clone, Copy)]
struct PhiEstimator {
    phi: PhiModel,
    /// Length at `sampled_ns`, m; `None` before the first reading.
    length_m: Option<f64>,
    sampled_ns: u64,
    /// Cycle of that reading.
    cycle: u64,
    /// Estimated velocity v̂ of the cable during the present cycle, m/s.
    velocity_m_s: f64,
    /// Command of the last cycle, m/s.
    command_m_s: f64,
}

impl PhiEstimator {
    fn new(parameters: &Parameters) -> Self {
        let phi = PhiModel::new(parameters.eta, parameters.ridge, parameters.prior);
        Self { phi, length_m: None, sampled_ns: 0, cycle: 0, velocity_m_s: 0.0, command_m_s: 0.0 }
    }
}

impl CableEstimator for PhiEstimator {
    /// Updates the motor model with the effect of the last command.
    fn read(&mut self, sample: &CableSample) {
        if let Some(length_m) = sample.length_m {
            let elapsed_s = sample.sampled_ns.saturating_sub(self.sampled_ns) as f64 * 1e-9;
            match self.length_m {
                Some(before_m)
                    if self.cycle + 1 == sample.cycle
                        && elapsed_s > 0.0
                        && (length_m - before_m).abs() <= JUMP_M_S * elapsed_s =>
                {
                    self.phi.update(self.command_m_s, (length_m - before_m) / elapsed_s);
                }
                _ => self.phi.forget_window(),
            }
            (self.length_m, self.sampled_ns, self.cycle) = (Some(length_m), sample.sampled_ns, sample.cycle);
        }
        self.command_m_s = sample.command_m_s;
        self.velocity_m_s = self.phi.predict(self.command_m_s);
    }

    /// Extrapolates the last reading to the instant.
    fn at(&self, instant: &Instant) -> Option<Measurement> {
        let moved_m = self.velocity_m_s * instant.ahead_of_s(self.sampled_ns, self.cycle);
        Some(Measurement {
            length_m: self.length_m? + moved_m,
            velocity_m_s: self.velocity_m_s,
            steady_velocity_m_s: None,
            sigma_m: PREDICTION_SIGMA * moved_m,
            phi: self.phi.phi(),
            sampled_ns: self.sampled_ns,
        })
    }

    /// Drops the reading; the motor model remains.
    fn forget(&mut self) {
        self.length_m = None;
        self.velocity_m_s = 0.0;
        self.command_m_s = 0.0;
    }

    fn retune(&mut self, parameters: &Parameters) {
        self.phi.retune(parameters.eta, parameters.ridge, parameters.prior);
    }
}
