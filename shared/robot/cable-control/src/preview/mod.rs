//! Linear-quadratic preview control of each cable's length with the delay and lag of the winches.
//!
//! The law of section VI-B assumes that the next command acts immediately; with delay and lag it has to be slow to be
//! stable. Here the winch is the model of [`crate::drive_lag`], exactly discretised, and the desired lengths of the
//! next cycles are known. The law minimises
//!
//! Σ (L_j - r_j)² + p (u_j - u_{j-1})² / Ts²
//!
//! over the horizon and the steady ramp that continues it. Commands already sent cannot be changed and only shift the
//! start: the state is predicted over the whole cycles of delay. The remaining problem has the state [L, v, u_prev];
//! the rest of the delay is a part of a cycle during which u_prev still acts. Its Riccati equation is solved once; then
//! a command costs one multiplication per cycle of preview: u = -K x + Σ g_j r_j.
//!
//! The velocity v is not measured (one encoder step in one cycle is a large velocity): a [`DriveObserver`] drives the
//! model with the commands that were actually sent, corrected by the measured lengths.
//!
//! **Two bandwidths.** A feedback fast enough to follow a ramp of speed closely would oscillate with a model error
//! of a tenth. Therefore the known and the measured parts are separate: a [`LeadFilter`] simulates the model along the
//! desired lengths under a fast law, and the feedback, [`PreviewGain::correct`], only brings the winches to the
//! state of the lead.
//!
//! Lengths in m, velocities in m/s, positive pays out; times in s. The law of section VI-B is in [`crate::law`].

mod drive_observer;
mod lead;

pub use drive_observer::DriveObserver;
pub use lead::{LeadCommand, LeadFilter};

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::drive_lag::{CycleModel, DriveLag, LagError, Piece, Winch};
use cable_robot::linalg;

pub use cable_robot::control_bounds::MAX_PREVIEW;

/// Bound of the Riccati iteration, which needs about 20 times the settling time of a step response, in cycles: four
/// seconds at 500 cycles per second.
const MAX_ITERATIONS: usize = 40_000;

/// Error of a law that cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PreviewError {
    /// Period or delay out of range.
    #[error(transparent)]
    Range(#[from] LagError),
    /// Horizon out of range.
    #[error("the preview is {0} cycles; accepted: 2 to {MAX_PREVIEW}")]
    Horizon(usize),
    /// Move penalty out of range.
    #[error("the move penalty is {0} s⁴; accepted: 1e-9 to 1")]
    MovePenalty(f64),
    /// The iteration did not converge.
    #[error("the gains for this delay, lag and move penalty do not settle; give a move penalty nearer to 1e-5 s⁴")]
    NotConverged,
}

/// Model of one cycle with the state [L, v, u_prev]: x' = A x + B u.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cycle {
    a: Matrix3<f64>,
    b: Vector3<f64>,
}

impl Cycle {
    /// Models the part of the delay beyond its whole cycles, then the lag.
    fn new(model: &CycleModel) -> Self {
        let (Piece { h: h1, e: e1, c: c1 }, Piece { h: h2, e: e2, c: c2 }) = (model.before, model.after);
        #[rustfmt::skip]
        let a = Matrix3::new(
            1.0, c1 + e1 * c2, h1 - c1 + (1.0 - e1) * c2,
            0.0, e1 * e2,      (1.0 - e1) * e2,
            0.0, 0.0,          0.0,
        );
        Self { a, b: Vector3::new(h2 - c2, 1.0 - e2, 1.0) }
    }
}

/// Gains of the law for one delay and lag; the same for every cable.
///
/// ```
/// use cable_control::drive_lag::{DriveLag, Winch};
/// use cable_control::preview::PreviewGain;
/// let gain = PreviewGain::new(&DriveLag::new(0.03, 0.04)?, 0.01, 40, 1e-5)?;
/// // The winch is already on the ramp: the command is the speed of the ramp.
/// let winch = Winch { length_m: 0.0, velocity_m_s: 0.2 };
/// let ramp: Vec<f64> = (1..=40).map(|j| 0.2 * 0.01 * f64::from(j)).collect();
/// assert!((gain.command(winch, 0.2, ramp.iter().copied()) - 0.2).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreviewGain {
    lag: DriveLag,
    model: CycleModel,
    period_s: f64,
    /// K.
    state: Vector3<f64>,
    /// g_1..g_H.
    ahead: [f64; MAX_PREVIEW],
    horizon: usize,
}

impl PreviewGain {
    /// Computes the gains for a model of the winches, a control period (s), a preview of 2 to [`MAX_PREVIEW`] cycles
    /// and a move penalty p (s⁴: weight of a squared acceleration of the command relative to a squared length error).
    /// The bandwidth of the law is about p^(-1/4) in rad/s: 18 rad/s for 1e-5.
    pub fn new(lag: &DriveLag, period_s: f64, horizon: usize, move_penalty_s4: f64) -> Result<Self, PreviewError> {
        let model = CycleModel::new(lag, period_s, 0.0)?;
        if !(2..=MAX_PREVIEW).contains(&horizon) {
            return Err(PreviewError::Horizon(horizon));
        }
        if !(1e-9..=1.0).contains(&move_penalty_s4) {
            return Err(PreviewError::MovePenalty(move_penalty_s4));
        }
        let cycle = Cycle::new(&model);
        let r = move_penalty_s4 / (period_s * period_s);
        let (p, k, s) = riccati(&cycle, r).ok_or(PreviewError::NotConverged)?;
        // b_j = C r_j + (A - B K)ᵀ b_{j+1}, u = -K x + Bᵀ b_1 / S: going forward, the row Bᵀ ((A - B K)ᵀ)^(j-1) / S.
        let closed = cycle.a - linalg::outer(&cycle.b, &k);
        let mut row = cycle.b / s;
        let mut ahead = [0.0; MAX_PREVIEW];
        for gain in ahead.iter_mut().take(horizon - 1) {
            *gain = row.x;
            row = closed * row;
        }
        // After the end of the preview the lengths continue with their last velocity: x_ref = [r_H, w, w], w =
        // (r_H - r_{H-1}) / Ts.
        let end = p * row;
        let ramp = (end.y + end.z) / period_s;
        ahead[horizon - 1] += end.x + ramp;
        ahead[horizon - 2] -= ramp;
        Ok(Self { lag: *lag, model, period_s, state: k, ahead, horizon })
    }

    /// Model of the winches.
    pub fn lag(&self) -> DriveLag {
        self.lag
    }

    /// Control period, s.
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Number of whole cycles of delay: the state has to be predicted this far beyond the next command.
    pub fn delay_cycles(&self) -> usize {
        self.model.delay_cycles()
    }

    /// Preview H, cycles.
    pub fn horizon(&self) -> usize {
        self.horizon
    }

    /// K_L / (1 + K_u + K_v): decay rate of a small, lasting length error, 1/s.
    pub fn rate(&self) -> f64 {
        self.state.x / (1.0 + self.state.y + self.state.z)
    }

    /// Correction that the feedback adds to a command, m/s. `off` is the deviation of a winch from its desired
    /// state at the beginning of the cycle in which the command takes effect, `previous_m_s` the deviation of
    /// its previous command.
    pub fn correct(&self, off: Winch, previous_m_s: f64) -> f64 {
        -self.state.dot(&Vector3::new(off.length_m, off.velocity_m_s, previous_m_s))
    }

    /// Command, m/s. `winch` and `previous_m_s` (the previous command) apply at the beginning of the cycle in which
    /// this command takes effect, `ahead_m` are the desired lengths at the ends of that cycle and the following ones;
    /// if the iterator ends early, the last ones continue as a ramp.
    pub fn command(&self, winch: Winch, previous_m_s: f64, ahead_m: impl IntoIterator<Item = f64>) -> f64 {
        let mut u = -self.state.y * winch.velocity_m_s - self.state.z * previous_m_s;
        let mut ahead_m = ahead_m.into_iter();
        let (mut last, mut step) = (winch.length_m, 0.0);
        // The gains of the lengths add up to K_L. Using differences from the present length keeps small errors exact
        // when lengths are large.
        for gain in &self.ahead[..self.horizon] {
            let next = ahead_m.next().unwrap_or(last + step);
            step = next - last;
            last = next;
            u += gain * (next - winch.length_m);
        }
        u
    }
}

/// Steady-state solution: P, K and S = R + Bᵀ P B. Cost C x² + r (u - u_prev)².
fn riccati(cycle: &Cycle, r: f64) -> Option<(Matrix3<f64>, Vector3<f64>, f64)> {
    let Cycle { a, b } = cycle;
    let mut q = Matrix3::zeros();
    q[(0, 0)] = 1.0;
    q[(2, 2)] = r;
    let mut p = q;
    for _ in 0..MAX_ITERATIONS {
        let pb = p * b;
        let s = r + b.dot(&pb);
        let mut h = a.transpose() * pb;
        h.z -= r;
        let k = h / s;
        let next = q + a.transpose() * p * a - linalg::outer(&h, &k);
        let next = (next + next.transpose()) * 0.5;
        let change = (next - p).iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let size = next.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        p = next;
        if !size.is_finite() {
            return None;
        }
        if change <= 1e-13 * size {
            return Some((p, k, s));
        }
    }
    None
}
