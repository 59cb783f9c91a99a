//! The paper's method for one line: step 1 of its section VI.

use cable_control::motor_model::PhiModel;
use messages::MotorState;

use crate::estimator::BRIDGED_CYCLES;
use crate::method::{Found, ahead_s};

/// Share of a predicted displacement that counts as its standard deviation: the model (18) leaves 0.2 to 0.8 of the
/// error of not predicting at all, depending on the run.
const PREDICTION_SIGMA: f64 = 0.5;

/// Faster than any winch, m/s: a line that seems to be was given another length. Twice the highest cable speed limit of a robot file.
const JUMP_M_S: f64 = 20.0;

/// See the module's text.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
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

impl Line {
    pub(crate) fn new(eta: usize, ridge: f64, prior: [f64; 2]) -> Self {
        let phi = PhiModel::new(eta, ridge, prior);
        Self { phi, length_m: None, sampled_ns: 0, cycle: 0, velocity_m_s: 0.0, command_m_s: 0.0 }
    }

    pub(crate) fn retune(&mut self, eta: usize, ridge: f64, prior: [f64; 2]) {
        self.phi.retune(eta, ridge, prior);
    }

    /// Takes the reading of this cycle, if there is one, and teaches the motor model what the last command did.
    pub(crate) fn read(&mut self, state: &MotorState, i: usize) {
        let (length_m, sampled_ns) = (state.length_m[i], state.sampled_ns[i]);
        if state.fresh[i] != 0 && length_m.is_finite() {
            let elapsed_s = sampled_ns.saturating_sub(self.sampled_ns) as f64 * 1e-9;
            match self.length_m {
                Some(before_m)
                    if self.cycle + 1 == state.header.cycle
                        && elapsed_s > 0.0
                        && (length_m - before_m).abs() <= JUMP_M_S * elapsed_s =>
                {
                    self.phi.update(self.command_m_s, (length_m - before_m) / elapsed_s);
                }
                _ => self.phi.forget_window(),
            }
            (self.length_m, self.sampled_ns, self.cycle) = (Some(length_m), sampled_ns, state.header.cycle);
        }
        self.command_m_s = if state.command_m_s[i].is_finite() { state.command_m_s[i] } else { 0.0 };
        self.velocity_m_s = self.phi.predict(self.command_m_s);
    }

    /// The last reading, carried on to the instant.
    pub(crate) fn at(&self, cycle: u64, instant_ns: u64) -> Option<Found> {
        let length_m = self.length_m?;
        let silent = cycle.checked_sub(self.cycle)?;
        if silent > BRIDGED_CYCLES {
            return None;
        }
        let moved_m = self.velocity_m_s * ahead_s(instant_ns, self.sampled_ns, silent);
        let length_m = length_m + moved_m;
        length_m.is_finite().then_some(Found {
            length_m,
            velocity_m_s: self.velocity_m_s,
            steady_m_s: None,
            sigma_m: PREDICTION_SIGMA * moved_m,
            phi: self.phi.phi(),
            sampled_ns: self.sampled_ns,
        })
    }

    /// What was learnt of the winch stays.
    pub(crate) fn forget(&mut self) {
        self.length_m = None;
        self.velocity_m_s = 0.0;
        self.command_m_s = 0.0;
    }
}
