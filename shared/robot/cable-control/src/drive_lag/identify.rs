//! The step test: identifies delay and lag from a record of commands and measured velocities by least squares.

use thiserror::Error;

use super::{CycleModel, DriveLag, LagError, MAX_DELAY_S, Winch};
use cable_robot::CableVec;

/// Shortest record accepted by [`identify`], cycles.
pub const MIN_RECORD: usize = 20;

/// Longest record, cycles; bounds the duration of one pass. A second and a half at 500 cycles per second, which is what
/// the controller records.
pub const MAX_RECORD: usize = 768;

/// Smallest RMS residual without a model, m, that a record must have: three steps of an encoder with
/// 10,000 counts per metre.
pub const LEAST_EXCITATION_M: f64 = 3e-4;

/// Largest number of passes of the fit, which needs four to ten.
const MAX_PASSES: u32 = 40;

/// Input of [`identify`]: consecutive cycles. A record may start during motion if `ignored` covers the time until the
/// effect of earlier commands has decayed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record<'a> {
    /// Control period, s.
    pub period_s: f64,
    /// Time at which each cable is read, s after the commands of the cycle were sent, 0 to a period.
    pub reading_s: CableVec,
    /// Commands of each cycle, m/s; before the first cycle the first command is assumed.
    pub commands_m_s: &'a [CableVec],
    /// Mean velocity of each cable between the reading of the previous cycle and that of this cycle, m/s.
    pub velocities_m_s: &'a [CableVec],
    /// Number of initial cycles of which only the commands are used; 0 for a record that starts at rest.
    pub ignored: usize,
}

/// Identified delay and lag with their quality.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Identified {
    /// Model.
    pub lag: DriveLag,
    /// [Misfit](crate::drive_lag): 0 is perfect, 1 no better than no model.
    pub misfit: f64,
    /// RMS residual of the lengths with the model, m.
    pub residual_m: f64,
    /// RMS residual of the lengths without a model, m: the excitation of the record.
    pub naive_m: f64,
}

/// Why a record does not identify a model.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum IdentifyError {
    /// Lengths of the lists out of range.
    #[error(
        "the record has {cycles} commands and {velocities} velocities; give the same number of both, {MIN_RECORD} after the ignored ones to {MAX_RECORD}"
    )]
    WrongCount {
        /// Number of cycles with a command.
        cycles: usize,
        /// Number of cycles with velocities.
        velocities: usize,
    },
    /// A value that is not finite, or a wrong number of cables.
    #[error("cycle {cycle} of the record has a value that is missing or not finite; record again")]
    NotFinite {
        /// Index of the cycle, from 0.
        cycle: usize,
    },
    /// Period or reading time out of range.
    #[error(transparent)]
    Range(#[from] LagError),
    /// Not enough motion.
    #[error(
        "the record has too little motion: delay and lag change the lengths by {naive_m:.5} m, and {LEAST_EXCITATION_M} m are needed; jog, or start a motion from rest"
    )]
    NotExcited {
        /// RMS effect of delay and lag on the lengths, m.
        naive_m: f64,
    },
    /// The fit does not converge.
    #[error("delay and lag do not settle within {MAX_PASSES} passes; record a motion with clearer starts and stops")]
    NotConverged,
}

/// Identifies delay and lag (the same for all cables) from commands and measured velocities by least squares on the
/// lengths; each cable has its own unknown length offset. A jog or the start of a motion is sufficient.
///
/// Velocities are integrated to lengths first, because the quantisation noise of encoders is white in the length and
/// ten times larger in its differences. Nothing is allocated.
///
/// ```
/// use cable_robot::CableVec;
/// use cable_control::drive_lag::{CycleModel, DriveLag, Record, Winch, identify};
/// let truth = DriveLag::new(0.03, 0.05)?;
/// let (period_s, reading_s) = (0.01, 0.004);
/// // A jog: 0.05 m/s for a second.
/// let jog = |k| CableVec::repeat(1, if (5..105).contains(&k) { 0.05 } else { 0.0 });
/// let commands: Vec<CableVec> = (0..150).map(jog).collect();
/// let model = CycleModel::new(&truth, period_s, period_s - reading_s)?;
/// let mut winch = Winch::default();
/// let velocities: Vec<CableVec> = (0..150usize).map(|k| {
///     let command = |ago: usize| commands[k.saturating_sub(ago)][0];
///     let next = model.step(winch, command(model.delay_cycles() + 1), command(model.delay_cycles()));
///     let mean = (next.length_m - winch.length_m) / period_s;
///     winch = next;
///     CableVec::repeat(1, mean)
/// }).collect();
/// let record = Record {
///     period_s,
///     reading_s: CableVec::repeat(1, reading_s),
///     commands_m_s: &commands,
///     velocities_m_s: &velocities,
///     ignored: 0,
/// };
/// let found = identify(&record)?;
/// assert!((found.lag.delay_s() - 0.03).abs() < 1e-4 && (found.lag.lag_s() - 0.05).abs() < 1e-4);
/// assert!(found.misfit < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn identify(record: &Record<'_>) -> Result<Identified, IdentifyError> {
    let mut fit = LagFit::new(record)?;
    for _ in 0..MAX_PASSES {
        if let Some(found) = fit.pass(record)? {
            return Ok(found);
        }
    }
    Err(IdentifyError::NotConverged)
}

/// [`identify`] in passes that each fit into one control cycle (about three simulations of the record).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LagFit {
    /// Delay and lag, s.
    at: [f64; 2],
    cost: f64,
    damping: f64,
    naive: f64,
    passes: u32,
}

/// Step of the numerical derivatives, s: small relative to any delay, large relative to the rounding of lengths.
const PROBE_S: f64 = 1e-5;

impl LagFit {
    /// Checks the record and starts from the mean shift between commands and lengths.
    pub fn new(record: &Record<'_>) -> Result<Self, IdentifyError> {
        let (cycles, velocities) = (record.commands_m_s.len(), record.velocities_m_s.len());
        if cycles != velocities || cycles < record.ignored.saturating_add(MIN_RECORD) || cycles > MAX_RECORD {
            return Err(IdentifyError::WrongCount { cycles, velocities });
        }
        let n = record.reading_s.len();
        let good = |v: &CableVec| v.len() == n && n > 0 && v.is_finite() && v.max_abs() < 1e3;
        if let Some(cycle) = (0..cycles).find(|k| !(good(&record.commands_m_s[*k]) && good(&record.velocities_m_s[*k])))
        {
            return Err(IdentifyError::NotFinite { cycle });
        }
        let none = DriveLag { delay_s: 0.0, lag_s: 0.0 };
        let (mut naive, mut along, mut square) = (0.0, 0.0, 0.0);
        for cable in 0..n {
            let mut speeds = Spread::default();
            let mut residuals = Spread::default();
            let mut both = 0.0;
            residual(record, cable, &none, |k, e| {
                let u = record.commands_m_s[k][cable];
                speeds.add(u);
                residuals.add(e);
                both += u * e;
            })?;
            naive += residuals.square();
            // Without a model the length is ahead by (delay + lag) v.
            along -= both - speeds.sum * residuals.sum / speeds.count;
            square += speeds.square();
        }
        let naive_m = (naive / (n * (cycles - record.ignored)) as f64).sqrt();
        if !(naive_m >= LEAST_EXCITATION_M && square > 0.0) {
            return Err(IdentifyError::NotExcited { naive_m });
        }
        let half = (0.5 * along / square).clamp(0.0, MAX_DELAY_S);
        let mut fit = Self { at: [half, half.max(PROBE_S)], cost: 0.0, damping: 1e-3, naive, passes: 0 };
        fit.cost = cost(record, &fit.at)?;
        Ok(fit)
    }

    /// Performs one damped Gauss-Newton step; returns the result after convergence.
    pub fn pass(&mut self, record: &Record<'_>) -> Result<Option<Identified>, IdentifyError> {
        self.passes += 1;
        if self.passes > MAX_PASSES {
            return Err(IdentifyError::NotConverged);
        }
        let [mut dd, mut dl, mut ll, mut gd, mut gl] = [0.0; 5];
        let [delay, lag] = self.at;
        let base = DriveLag { delay_s: delay, lag_s: lag };
        // One-sided at the upper end, so that the probe is a valid model too.
        let side = |v: f64| if v + PROBE_S > MAX_DELAY_S { -PROBE_S } else { PROBE_S };
        let (hd, hl) = (side(delay), side(lag));
        for cable in 0..record.reading_s.len() {
            let mut is = Simulations::new(
                record,
                cable,
                &[base, DriveLag { delay_s: delay + hd, ..base }, DriveLag { lag_s: lag + hl, ..base }],
            )?;
            let mut mean = [Spread::default(); 3];
            is.for_each_cycle(record, cable, |_, e| {
                for (mean, e) in mean.iter_mut().zip(e) {
                    mean.add(*e);
                }
            });
            let mut is = is.restarted();
            is.for_each_cycle(record, cable, |_, e| {
                let e0 = e[0] - mean[0].mean();
                let d = (e[1] - mean[1].mean() - e0) / hd;
                let l = (e[2] - mean[2].mean() - e0) / hl;
                dd += d * d;
                dl += d * l;
                ll += l * l;
                gd += d * e0;
                gl += l * e0;
            });
        }
        let (a, b) = (dd * (1.0 + self.damping), ll * (1.0 + self.damping));
        let det = a * b - dl * dl;
        let step = if det > 1e-14 * a * b {
            [-(b * gd - dl * gl) / det, -(a * gl - dl * gd) / det]
        } else {
            // If the record does not separate delay from lag, change both equally.
            let both = -(gd + gl) / (dd + 2.0 * dl + ll).max(f64::MIN_POSITIVE);
            [both, both]
        };
        let next =
            [(delay + step[0]).clamp(0.0, MAX_DELAY_S - PROBE_S), (lag + step[1]).clamp(0.0, MAX_DELAY_S - PROBE_S)];
        let moved = (next[0] - delay).abs() + (next[1] - lag).abs();
        let there = cost(record, &next)?;
        let settled = moved < 1e-6 || (there <= self.cost && self.cost - there <= 1e-9 * self.cost);
        if there <= self.cost {
            (self.at, self.cost, self.damping) = (next, there, (0.1 * self.damping).max(1e-9));
        } else {
            self.damping = (10.0 * self.damping).max(1e-6);
            if self.damping < 1e9 && moved >= 1e-6 {
                return Ok(None);
            }
        }
        if !(settled || self.damping >= 1e9) {
            return Ok(None);
        }
        let count = (record.reading_s.len() * (record.commands_m_s.len() - record.ignored)) as f64;
        let lag = DriveLag::new(self.at[0], self.at[1])?;
        let (residual_m, naive_m) = ((self.cost / count).sqrt(), (self.naive / count).sqrt());
        Ok(Some(Identified { lag, misfit: (self.cost / self.naive).sqrt(), residual_m, naive_m }))
    }
}

/// Sum, sum of squares and number of values.
#[derive(Debug, Clone, Copy, Default)]
struct Spread {
    sum: f64,
    squares: f64,
    count: f64,
}

impl Spread {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.squares += value * value;
        self.count += 1.0;
    }

    fn mean(&self) -> f64 {
        if self.count > 0.0 { self.sum / self.count } else { 0.0 }
    }

    /// Sum of squared deviations from the mean.
    fn square(&self) -> f64 {
        (self.squares - self.sum * self.mean()).max(0.0)
    }
}

/// Simulation of several models of one cable along a record: measured minus modelled length in each cycle.
struct Simulations<const N: usize> {
    models: [CycleModel; N],
}

impl<const N: usize> Simulations<N> {
    fn new(record: &Record<'_>, cable: usize, lags: &[DriveLag; N]) -> Result<Self, LagError> {
        let early_s = record.period_s - record.reading_s[cable];
        let mut models = [CycleModel::new(&lags[0], record.period_s, early_s)?; N];
        for (model, lag) in models.iter_mut().zip(lags) {
            *model = CycleModel::new(lag, record.period_s, early_s)?;
        }
        Ok(Self { models })
    }

    fn restarted(&self) -> Self {
        Self { models: self.models }
    }

    fn for_each_cycle(&mut self, record: &Record<'_>, cable: usize, mut with: impl FnMut(usize, &[f64; N])) {
        let commands = record.commands_m_s;
        let start = Winch { length_m: 0.0, velocity_m_s: commands[0][cable] };
        let mut winches = [start; N];
        let mut measured = 0.0;
        for k in 0..commands.len() {
            measured += record.velocities_m_s[k][cable] * record.period_s;
            let mut residuals = [0.0; N];
            for i in 0..N {
                let model = &self.models[i];
                let newer = commands[k.saturating_sub(model.whole)][cable];
                let older = commands[k.saturating_sub(model.whole + 1)][cable];
                winches[i] = model.step(winches[i], older, newer);
                residuals[i] = measured - winches[i].length_m;
            }
            if k >= record.ignored {
                with(k, &residuals);
            }
        }
    }
}

fn residual(
    record: &Record<'_>,
    cable: usize,
    lag: &DriveLag,
    mut with: impl FnMut(usize, f64),
) -> Result<(), LagError> {
    Simulations::new(record, cable, &[*lag])?.for_each_cycle(record, cable, |k, e| with(k, e[0]));
    Ok(())
}

/// Sum over cables of the squared length residuals about each cable's own offset, m².
fn cost(record: &Record<'_>, at: &[f64; 2]) -> Result<f64, LagError> {
    let lag = DriveLag { delay_s: at[0], lag_s: at[1] };
    let mut sum = 0.0;
    for cable in 0..record.reading_s.len() {
        let mut spread = Spread::default();
        residual(record, cable, &lag, |_, e| spread.add(e))?;
        sum += spread.square();
    }
    Ok(sum)
}
