//! A control law that knows how late the winches are: linear-quadratic preview control of each cable's length.
//!
//! The law of section VI-B takes the next command as carried out at once; with delay and lag it has to be slow to be
//! stable. Here the winch is the model of [`crate::drive_lag`], exactly discretised, and the desired lengths of the next
//! cycles are known. The law minimises
//!
//! Σ (L_j - r_j)² + p (u_j - u_{j-1})² / Ts²
//!
//! over the horizon and the steady ramp that continues it. Commands that are on their way cannot be changed any more and
//! only shift the start: the state is predicted over the whole cycles of delay, and what is left is a problem in
//! [L, v, u_prev], the rest of the delay being a part of a cycle during which u_prev still acts. Its Riccati equation is
//! solved once; then a command costs one multiplication per cycle of preview: u = -K x + Σ g_j r_j.
//!
//! The velocity v is not measured (one encoder step in one cycle is a large velocity): a [`Twin`] runs the model with
//! the commands that were really sent, corrected by the measured lengths.

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::CableVec;
use crate::MAX_CABLES;
use crate::drive_lag::{CommandHistory, CycleModel, DriveLag, LagError, Piece, Winch};
use crate::linalg;

/// Longest preview, cycles.
pub const MAX_PREVIEW: usize = 200;

/// Bound of the Riccati iteration; it needs about 20 times the time that a step response takes, in cycles.
const MAX_ITERATIONS: usize = 20_000;

/// What is known of a measured length, as a standard deviation, m: half a step of a wheel with 10,000 counts per metre.
const LENGTH_SIGMA_M: f64 = 5e-5;

/// What the model leaves open of a velocity per second of running, m/s: a speed loop that takes 1 % of 0.2 m/s too much
/// or too little through a start of half a second.
const VELOCITY_SIGMA: f64 = 5e-3;

/// A length this far from the twin's is another length (the position was set anew), m.
const LOST_M: f64 = 0.05;

/// Cycles without an estimate that the twin bridges.
const BRIDGED: u64 = 10;

/// A law that cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum PreviewError {
    /// Period or delay out of range.
    #[error(transparent)]
    Range(#[from] LagError),
    /// The horizon.
    #[error("the preview is {0} cycles; accepted: 2 to {MAX_PREVIEW}")]
    Horizon(usize),
    /// The move penalty.
    #[error("the move penalty is {0} s⁴; accepted: 1e-9 to 1")]
    MovePenalty(f64),
    /// The iteration did not end.
    #[error("the gains for this delay, lag and move penalty do not settle; give a move penalty nearer to 1e-5 s⁴")]
    NotConverged,
}

/// One cycle of [L, v, u_prev]: x' = A x + B u.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cycle {
    a: Matrix3<f64>,
    b: Vector3<f64>,
}

impl Cycle {
    /// What is left of the delay after its whole cycles, then the lag.
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
/// use cable_robot::{drive_lag::{DriveLag, Winch}, preview::PreviewGain};
/// let gain = PreviewGain::new(&DriveLag::new(0.03, 0.04)?, 0.01, 40, 1e-5)?;
/// // On a ramp, and on it already: the command is the ramp's own speed.
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
    /// For a model of the winches, a control period (s), a preview of 2 to [`MAX_PREVIEW`] cycles and a move penalty p
    /// (s⁴: what a squared acceleration of the command costs against a squared length error). The law is about as quick
    /// as p^(-1/4) in rad/s: 18 rad/s for 1e-5.
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
        // At the end of the preview the lengths go on as they did last: x_ref = [r_H, w, w], w = (r_H - r_{H-1}) / Ts.
        let end = p * row;
        let ramp = (end.y + end.z) / period_s;
        ahead[horizon - 1] += end.x + ramp;
        ahead[horizon - 2] -= ramp;
        Ok(Self { lag: *lag, model, period_s, state: k, ahead, horizon })
    }

    /// The model it is for.
    pub fn lag(&self) -> DriveLag {
        self.lag
    }

    /// Control period, s.
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Whole cycles of delay: the state has to be predicted over so many beyond the next command.
    pub fn delay_cycles(&self) -> usize {
        self.model.whole()
    }

    /// Preview H, cycles.
    pub fn horizon(&self) -> usize {
        self.horizon
    }

    /// K_L / (1 + K_u + K_v): how fast a small, lasting length error is brought to zero, 1/s.
    pub fn rate(&self) -> f64 {
        self.state.x / (1.0 + self.state.y + self.state.z)
    }

    /// The command, m/s. `winch` and `previous_m_s` (the command before this one) are those at the beginning of the cycle
    /// in which this command takes effect, `ahead_m` the desired lengths at the ends of that cycle and the following
    /// ones; the last one repeats on as a ramp where the iterator ends early.
    pub fn command(&self, winch: Winch, previous_m_s: f64, ahead_m: impl IntoIterator<Item = f64>) -> f64 {
        let mut u = -self.state.y * winch.velocity_m_s - self.state.z * previous_m_s;
        let mut ahead_m = ahead_m.into_iter();
        let (mut last, mut step) = (winch.length_m, 0.0);
        // The gains of the lengths add up to K_L: only differences from the present length count, and large lengths do
        // not drown small errors.
        for gain in &self.ahead[..self.horizon] {
            let next = ahead_m.next().unwrap_or(last + step);
            step = next - last;
            last = next;
            u += gain * (next - winch.length_m);
        }
        u
    }
}

/// Steady solution: P, K and S = R + Bᵀ P B. Cost C x² + r (u - u_prev)².
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

/// Model of all winches, run with the commands that were sent and corrected by measured lengths: a steady Kalman filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twin {
    lag: DriveLag,
    model: CycleModel,
    period_s: f64,
    gain: [f64; 2],
    winches: [Winch; MAX_CABLES],
    /// The cycle at whose beginning `winches` is true.
    cycle: Option<u64>,
}

impl Twin {
    /// Knows the model, not yet the lengths.
    pub fn new(lag: &DriveLag, period_s: f64) -> Result<Self, LagError> {
        let model = CycleModel::new(lag, period_s, 0.0)?;
        let (l2, v2) = (LENGTH_SIGMA_M * LENGTH_SIGMA_M, VELOCITY_SIGMA * VELOCITY_SIGMA * period_s);
        // Filter of [L, v] with L' = L + c v, v' = e v over a cycle; the covariance starts large and settles.
        let whole = Piece::new(period_s, lag.lag_s());
        let (c, e) = (whole.c, whole.e);
        let [mut ll, mut lv, mut vv] = [1.0, 0.0, 1.0];
        let mut gain = [0.0; 2];
        for _ in 0..500 {
            gain = [ll / (ll + l2), lv / (ll + l2)];
            let (l, m, v) = (ll - gain[0] * ll, lv - gain[0] * lv, vv - gain[1] * lv);
            ll = l + 2.0 * c * m + c * c * v + 0.25 * v2 * period_s * period_s;
            lv = e * (m + c * v) + 0.5 * v2 * period_s;
            vv = e * e * v + v2;
        }
        Ok(Self { lag: *lag, model, period_s, gain, winches: [Winch::default(); MAX_CABLES], cycle: None })
    }

    /// Takes the lengths measured in a cycle, m, `reading_s` after its command was sent; `sent` has that command as its
    /// newest. A cycle far from the last one, or lengths far from the twin's, begin anew with `velocities_m_s`.
    pub fn correct(
        &mut self,
        cycle: u64,
        reading_s: f64,
        lengths_m: &[f64],
        velocities_m_s: &[f64],
        sent: &CommandHistory,
    ) {
        let n = lengths_m.len().min(velocities_m_s.len()).min(MAX_CABLES);
        let reading_s = reading_s.clamp(0.0, self.period_s);
        let gap = self.cycle.and_then(|at| cycle.checked_sub(at)).filter(|gap| *gap <= BRIDGED);
        for missed in (1..=gap.unwrap_or(0) as usize).rev() {
            self.advance(missed, sent);
        }
        // From the beginning of the cycle to the reading, part by part.
        let lag_s = self.lag.lag_s();
        let before = Piece::new(reading_s.min(self.model.before.h), lag_s);
        let after = Piece::new(reading_s - before.h, lag_s);
        let (older, newer) = (sent.ago(self.model.whole() + 1), sent.ago(self.model.whole()));
        for i in 0..n {
            let winch = &mut self.winches[i];
            let there = after.step(before.step(*winch, older[i]), newer[i]);
            let beyond = lengths_m[i] - there.length_m;
            if gap.is_some() && beyond.abs() <= LOST_M {
                winch.length_m += self.gain[0] * beyond;
                winch.velocity_m_s += self.gain[1] * beyond;
            } else {
                let v = if velocities_m_s[i].is_finite() { velocities_m_s[i] } else { 0.0 };
                *winch = Winch { length_m: lengths_m[i] - v * reading_s, velocity_m_s: v };
            }
        }
        self.cycle = Some(cycle);
        self.advance(0, sent);
        self.cycle = cycle.checked_add(1);
    }

    /// One cycle on, the one that began with the command of `ago` cycles before the newest.
    fn advance(&mut self, ago: usize, sent: &CommandHistory) {
        let d = self.model.whole() + ago;
        let (older, newer) = (sent.ago(d + 1), sent.ago(d));
        for (i, winch) in self.winches.iter_mut().enumerate() {
            *winch = self.model.step(*winch, older[i], newer[i]);
        }
    }

    /// Where the winches will be at the beginning of the cycle in which the next command takes effect: after
    /// [`Twin::correct`] with the newest reading, the whole cycles of delay on.
    pub fn at_next_command(&self, sent: &CommandHistory) -> [Winch; MAX_CABLES] {
        let mut ahead = *self;
        // The command of `ago` cycles before the newest takes effect in the first of these cycles.
        for ago in (0..self.model.whole()).rev() {
            let (older, newer) = (sent.ago(ago + 1), sent.ago(ago));
            for (i, winch) in ahead.winches.iter_mut().enumerate() {
                *winch = self.model.step(*winch, older[i], newer[i]);
            }
        }
        ahead.winches
    }

    /// Velocities at the beginning of the next cycle, m/s.
    pub fn velocities_m_s(&self, cables: usize) -> CableVec {
        CableVec::from_fn(cables, |i| self.winches[i].velocity_m_s)
    }
}
