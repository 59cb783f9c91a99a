//! The paper's method for one cable: step 1 of its section VI. A reading is taken as it is and carried on with the motor model (18), learnt
//! while it runs.

use cable_control::length_filter::FilterError;
use cable_control::motor_model::PhiModel;

use crate::cable_estimator::{CableEstimator, CableSample, Instant, Measurement, Parameters};

/// Share of a predicted displacement that counts as its standard deviation: the model (18) leaves 0.2 to 0.8 of the
/// error of not predicting at all, depending on the run.
const PREDICTION_SIGMA: f64 = 0.5;

/// Faster than any winch, m/s: a line that seems to be was given another length. Twice the highest cable speed limit of a robot file.
const JUMP_M_S: f64 = 20.0;

/// Those of its parameters that it uses, and the defaults of the others. All are in range: the model limits them itself.
pub(crate) fn used(parameters: &Parameters) -> Result<Parameters, FilterError> {
    let &Parameters { eta, ridge, prior, .. } = parameters;
    Ok(Parameters { eta, ridge, prior, ..Parameters::default() })
}

/// A cable of which nothing is known yet.
pub(crate) fn cable(parameters: &Parameters) -> Box<dyn CableEstimator> {
    Box::new(PhiEstimator::new(parameters))
}

/// See the module's text.
#[derive(Debug, Clone, Copy)]
struct PhiEstimator {
    phi: PhiModel,
    /// Length at `sampled_ns`, m; `None` before the first reading.
    length_m: Option<f64>,
    sampled_ns: u64,
    /// Cycle of that reading.
    cycle: u64,
    /// Estimate v̂ of the cable's velocity during the present cycle, m/s.
    velocity_m_s: f64,
    /// Command sent in the last cycle, m/s.
    command_m_s: f64,
}

impl PhiEstimator {
    fn new(parameters: &Parameters) -> Self {
        let phi = PhiModel::new(parameters.eta, parameters.ridge, parameters.prior);
        Self { phi, length_m: None, sampled_ns: 0, cycle: 0, velocity_m_s: 0.0, command_m_s: 0.0 }
    }
}

impl CableEstimator for PhiEstimator {
    /// Teaches the motor model what the last command did.
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

    /// The last reading, carried on to the instant.
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

    /// What was learnt of the winch stays.
    fn forget(&mut self) {
        self.length_m = None;
        self.velocity_m_s = 0.0;
        self.command_m_s = 0.0;
    }

    fn retune(&mut self, parameters: &Parameters) {
        self.phi.retune(parameters.eta, parameters.ridge, parameters.prior);
    }
}
