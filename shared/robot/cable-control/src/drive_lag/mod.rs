//! Delay and lag of a winch: a pure delay, then a first-order lag, τ v' = u(t - delay) - v and L' = v, with u held over
//! each control cycle. Provides exact time steps, identification of both numbers from a record of commands and measured
//! velocities, and a running measure of the quality of a model.
//!
//! The paper's model (18) is this one at ten cycles per second, where delay and lag together take one or two cycles. At
//! a hundred, the delay alone takes several, and a predictive law has to include it.
//!
//! **Misfit** is the measure of quality: the RMS length residual of the model, divided by the RMS residual of the
//! assumption that commands act immediately. For slow motion, delay and lag together shift the lengths by (delay + lag)
//! v, so a model whose sum is wrong by 30 % has a misfit of about 0.3; 0 is perfect, 1 no better than no model.
//!
//! ```
//! use cable_control::drive_lag::DriveLag;
//! let winch = DriveLag::new(0.030, 0.040)?;
//! assert_eq!(winch.delay_s() + winch.lag_s(), 0.070);
//! # Ok::<(), cable_control::drive_lag::LagError>(())
//! ```

mod history;
mod identify;
mod misfit;

pub use history::CommandHistory;
pub use identify::{Identified, IdentifyError, LEAST_EXCITATION_M, LagFit, MAX_RECORD, MIN_RECORD, Record, identify};
pub use misfit::MisfitMeter;

use thiserror::Error;

/// Longest delay and longest lag, s. Slower winches are not suitable for a robot.
pub const MAX_DELAY_S: f64 = 0.5;

/// Longest delay in cycles, including a partial cycle: [`MAX_DELAY_S`] at 500 cycles per second.
pub const MAX_DELAY_CYCLES: usize = 251;

/// Delay and lag of a winch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveLag {
    delay_s: f64,
    lag_s: f64,
}

/// Error: a delay, a lag or a period out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("{what} is {value}; accepted: {accepted}")]
pub struct LagError {
    /// Name of the quantity.
    pub what: &'static str,
    /// Value of the quantity.
    pub value: f64,
    /// Accepted values.
    pub accepted: &'static str,
}

impl DriveLag {
    /// Builds a model from delay and lag, each 0 to [`MAX_DELAY_S`] seconds.
    pub fn new(delay_s: f64, lag_s: f64) -> Result<Self, LagError> {
        for (what, value) in [("the delay", delay_s), ("the lag", lag_s)] {
            if !(0.0..=MAX_DELAY_S).contains(&value) {
                return Err(LagError { what, value, accepted: "0 to 0.5 s" });
            }
        }
        Ok(Self { delay_s, lag_s })
    }

    /// Time from a command to its first effect, s.
    pub fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// Time constant of the speed after the delay, s.
    pub fn lag_s(&self) -> f64 {
        self.lag_s
    }

    /// Delay and lag together, s: the time by which the winch lags behind a ramp.
    pub fn total_s(&self) -> f64 {
        self.delay_s + self.lag_s
    }

    /// Multiplies both times by the same factor, within the accepted range.
    pub fn scaled(&self, factor: f64) -> Self {
        let scaled = |v: f64| if factor >= 0.0 { (v * factor).min(MAX_DELAY_S) } else { v };
        Self { delay_s: scaled(self.delay_s), lag_s: scaled(self.lag_s) }
    }
}

/// State of a winch: cable paid out, m, and its velocity, m/s.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Winch {
    /// Length, m, from any origin.
    pub length_m: f64,
    /// Velocity, m/s.
    pub velocity_m_s: f64,
}

/// A time interval with constant input, with the coefficients of the lag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Piece {
    /// Duration h, s.
    pub(crate) h: f64,
    /// exp(-h / τ).
    pub(crate) e: f64,
    /// τ (1 - exp(-h / τ)), s.
    pub(crate) c: f64,
}

impl Piece {
    pub(crate) fn new(h: f64, lag_s: f64) -> Self {
        if h <= 0.0 {
            return Self { h: 0.0, e: 1.0, c: 0.0 };
        }
        // Below a microsecond the lag is negligible, and the division could overflow the exponent.
        let e = if lag_s > 1e-6 { libm::exp(-h / lag_s) } else { 0.0 };
        Self { h, e, c: lag_s * (1.0 - e) }
    }

    /// The exact solution for a constant input, m/s.
    pub(crate) fn step(&self, winch: Winch, input_m_s: f64) -> Winch {
        let beyond = winch.velocity_m_s - input_m_s;
        Winch {
            length_m: winch.length_m + input_m_s * self.h + beyond * self.c,
            velocity_m_s: input_m_s + beyond * self.e,
        }
    }
}

/// Exact model of one control cycle of a winch: during the first part the command of `whole` + 1 cycles ago still acts,
/// during the rest the one of `whole` cycles ago.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleModel {
    whole: usize,
    pub(crate) before: Piece,
    pub(crate) after: Piece,
}

impl CycleModel {
    /// Builds the model for cycles of `period_s` that begin `early_s` (0 to a period) before their command is sent: 0
    /// for cycles from command to command, period minus reading time for cycles from reading to reading.
    pub fn new(lag: &DriveLag, period_s: f64, early_s: f64) -> Result<Self, LagError> {
        if !(period_s > 0.0 && period_s <= 1.0) {
            return Err(LagError { what: "the period", value: period_s, accepted: "above 0, at most 1 s" });
        }
        if !(0.0..=period_s).contains(&early_s) {
            return Err(LagError { what: "the head start", value: early_s, accepted: "0 to one period" });
        }
        let late_s = lag.delay_s + early_s;
        let whole = (late_s / period_s).floor();
        if !(whole < MAX_DELAY_CYCLES as f64) {
            return Err(LagError { what: "the delay in cycles", value: whole, accepted: "below 251" });
        }
        let rest_s = (late_s - whole * period_s).clamp(0.0, period_s);
        let (before, after) = (Piece::new(rest_s, lag.lag_s), Piece::new(period_s - rest_s, lag.lag_s));
        Ok(Self { whole: whole as usize, before, after })
    }

    /// Number of whole cycles of delay.
    pub fn delay_cycles(&self) -> usize {
        self.whole
    }

    /// Advances by one cycle with the commands of `whole` + 1 and of `whole` cycles ago, m/s.
    pub fn step(&self, winch: Winch, older_m_s: f64, newer_m_s: f64) -> Winch {
        self.after.step(self.before.step(winch, older_m_s), newer_m_s)
    }
}
