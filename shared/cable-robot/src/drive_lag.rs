//! How late a winch follows: a pure delay, then a first-order lag, τ v' = u(t - delay) - v and L' = v, with u held over
//! each control cycle. Exact steps of it, its two numbers from a record of commands and measured velocities, and a
//! running measure of how well a model fits.
//!
//! The paper's model (18) is this one at ten cycles a second, where delay and lag fall into one or two cycles. At a
//! hundred, the delay alone is several, and a law that looks ahead has to know it.
//!
//! **Misfit** is the measure used throughout: the RMS of what the model leaves unexplained of the lengths, over the RMS
//! of what is left when commands are taken as carried out at once. For slow motion a delay and a lag together shift the
//! lengths by (delay + lag) v, so a model whose sum is 30 % off has a misfit of about 0.3; 0 is perfect, 1 no better
//! than no model.

use thiserror::Error;

use crate::{CableVec, MAX_CABLES};

/// Longest delay and longest lag, s. A winch slower than that is no drive for a robot.
pub const MAX_DELAY_S: f64 = 0.5;

/// Longest delay in cycles, the part of a cycle included.
pub const MAX_DELAY_CYCLES: usize = 126;

/// Shortest record that [`identify`] takes, cycles.
pub const MIN_RECORD: usize = 20;

/// Longest record, cycles: bounds the time that one pass takes.
pub const MAX_RECORD: usize = 512;

/// What a record has to leave unexplained without a model, RMS, m: three steps of an encoder of 10,000 counts per metre.
pub const LEAST_EXCITATION_M: f64 = 3e-4;

/// The same for a cycle to count for the running misfit, m: there is no offset to remove there.
const LEAST_MOTION_M: f64 = 1e-3;

/// Passes of the fit; it needs four to ten.
const MAX_PASSES: u32 = 40;

/// Delay and lag of a winch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveLag {
    delay_s: f64,
    lag_s: f64,
}

/// A delay, a lag or a period out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("{what} is {value}; accepted: {accepted}")]
pub struct LagError {
    /// Which.
    pub what: &'static str,
    /// Its value.
    pub value: f64,
    /// What is accepted.
    pub accepted: &'static str,
}

impl DriveLag {
    /// Both in seconds, 0 to [`MAX_DELAY_S`].
    pub fn new(delay_s: f64, lag_s: f64) -> Result<Self, LagError> {
        for (what, value) in [("the delay", delay_s), ("the lag", lag_s)] {
            if !(0.0..=MAX_DELAY_S).contains(&value) {
                return Err(LagError { what, value, accepted: "0 to 0.5 s" });
            }
        }
        Ok(Self { delay_s, lag_s })
    }

    /// Time from a command to the first effect, s.
    pub fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// Time constant with which the speed then follows, s.
    pub fn lag_s(&self) -> f64 {
        self.lag_s
    }

    /// Delay and lag together: how far behind a ramp the winch runs, s.
    pub fn total_s(&self) -> f64 {
        self.delay_s + self.lag_s
    }

    /// Both times the same factor, inside the accepted range.
    pub fn scaled(&self, factor: f64) -> Self {
        let scaled = |v: f64| if factor >= 0.0 { (v * factor).min(MAX_DELAY_S) } else { v };
        Self { delay_s: scaled(self.delay_s), lag_s: scaled(self.lag_s) }
    }
}

/// Line paid out, m, and its velocity, m/s.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Winch {
    /// Length, m, from wherever it is counted.
    pub length_m: f64,
    /// Velocity, m/s.
    pub velocity_m_s: f64,
}

/// A time during which the input stays, with what the lag makes of it.
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
        // Below a microsecond it is no lag, and the division would overflow in the exponent.
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

/// One control cycle of a winch, exactly: for a part of it the command of `whole` + 1 cycles ago still acts, for the rest
/// the one of `whole` cycles ago.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleModel {
    whole: usize,
    pub(crate) before: Piece,
    pub(crate) after: Piece,
}

impl CycleModel {
    /// For cycles of `period_s` that begin `early_s` (0 to a period) before their command is sent: 0 for cycles from
    /// command to command, period less reading offset for cycles from reading to reading.
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
            return Err(LagError { what: "the delay in cycles", value: whole, accepted: "below 126" });
        }
        let rest_s = (late_s - whole * period_s).clamp(0.0, period_s);
        let (before, after) = (Piece::new(rest_s, lag.lag_s), Piece::new(period_s - rest_s, lag.lag_s));
        Ok(Self { whole: whole as usize, before, after })
    }

    /// Whole cycles of delay.
    pub fn whole(&self) -> usize {
        self.whole
    }

    /// One cycle on, with the commands of `whole` + 1 and of `whole` cycles ago, m/s.
    pub fn step(&self, winch: Winch, older_m_s: f64, newer_m_s: f64) -> Winch {
        self.after.step(self.before.step(winch, older_m_s), newer_m_s)
    }
}

/// What [`identify`] works on: consecutive cycles. They may begin in the midst of motion if as many are ignored as it takes
/// until what was commanded before the record has died away.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record<'a> {
    /// Control period, s.
    pub period_s: f64,
    /// When in a cycle each cable is read, s after the commands were sent, 0 to a period.
    pub reading_s: CableVec,
    /// Commands of each cycle, m/s; before the first they are taken to have been the first.
    pub commands_m_s: &'a [CableVec],
    /// Mean velocity of each cable from the reading of the cycle before to this cycle's, m/s.
    pub velocities_m_s: &'a [CableVec],
    /// Cycles at the beginning of which only the commands count; 0 for a record that begins at rest.
    pub ignored: usize,
}

/// A delay and a lag, and how good they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Identified {
    /// The model.
    pub lag: DriveLag,
    /// See the module's text: 0 perfect, 1 no better than no model.
    pub misfit: f64,
    /// What the model leaves unexplained of the lengths, RMS, m.
    pub residual_m: f64,
    /// The same without a model, RMS, m: how much there was to explain.
    pub naive_m: f64,
}

/// A record that says nothing.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum IdentifyError {
    /// Lengths of the lists.
    #[error(
        "a record of {cycles} cycles with {velocities} velocities; give as many of both, {MIN_RECORD} beyond the ignored ones to {MAX_RECORD}"
    )]
    WrongCount {
        /// Cycles with a command.
        cycles: usize,
        /// Cycles with velocities.
        velocities: usize,
    },
    /// Numbers that are none, or cables missing.
    #[error("cycle {cycle} of the record has a value that is missing or not finite; record again")]
    NotFinite {
        /// Which, from 0.
        cycle: usize,
    },
    /// Period or reading out of range.
    #[error(transparent)]
    Range(#[from] LagError),
    /// Too little motion.
    #[error(
        "the record has too little motion: delay and lag move the lengths by {naive_m:.5} m, and {LEAST_EXCITATION_M} m are needed; jog or fly from rest"
    )]
    NotExcited {
        /// RMS of what there is to explain, m.
        naive_m: f64,
    },
    /// The fit does not settle.
    #[error("delay and lag do not settle within {MAX_PASSES} passes; record a motion with clearer starts and stops")]
    NotConverged,
}

/// The step test: delay and lag (the same for all cables) from commands and measured velocities, by least squares on the
/// lengths, each with its own unknown origin. A jog or the start of a motion is enough.
///
/// Velocities are summed up to lengths first: encoder steps are white in the length and ten times louder in its
/// differences. Nothing is allocated.
///
/// ```
/// use cable_robot::{CableVec, drive_lag::{CycleModel, DriveLag, Record, Winch, identify}};
/// let truth = DriveLag::new(0.03, 0.05)?;
/// let (period_s, reading_s) = (0.01, 0.004);
/// // A jog: 0.05 m/s for a second.
/// let commands: Vec<CableVec> = (0..150).map(|k| CableVec::repeat(1, if (5..105).contains(&k) { 0.05 } else { 0.0 })).collect();
/// let model = CycleModel::new(&truth, period_s, period_s - reading_s)?;
/// let mut winch = Winch::default();
/// let velocities: Vec<CableVec> = (0..150usize).map(|k| {
///     let command = |ago: usize| commands[k.saturating_sub(ago)][0];
///     let next = model.step(winch, command(model.whole() + 1), command(model.whole()));
///     let mean = (next.length_m - winch.length_m) / period_s;
///     winch = next;
///     CableVec::repeat(1, mean)
/// }).collect();
/// let record = Record { period_s, reading_s: CableVec::repeat(1, reading_s), commands_m_s: &commands, velocities_m_s: &velocities, ignored: 0 };
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

/// [`identify`] in passes, each short enough for one control cycle (about three simulations of the record).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LagFit {
    /// Delay and lag, s.
    at: [f64; 2],
    cost: f64,
    damping: f64,
    naive: f64,
    passes: u32,
}

/// Step of the numerical derivatives, s: small against any delay, large against rounding of lengths.
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
            // The naive length is ahead by (delay + lag) v.
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

    /// One damped Gauss-Newton step; the result once it has settled.
    pub fn pass(&mut self, record: &Record<'_>) -> Result<Option<Identified>, IdentifyError> {
        self.passes += 1;
        if self.passes > MAX_PASSES {
            return Err(IdentifyError::NotConverged);
        }
        let [mut dd, mut dl, mut ll, mut gd, mut gl] = [0.0; 5];
        let [delay, lag] = self.at;
        let base = DriveLag { delay_s: delay, lag_s: lag };
        // One-sided at the upper end, so that a probe is a model too.
        let side = |v: f64| if v + PROBE_S > MAX_DELAY_S { -PROBE_S } else { PROBE_S };
        let (hd, hl) = (side(delay), side(lag));
        for cable in 0..record.reading_s.len() {
            let mut is = Runs::new(
                record,
                cable,
                &[base, DriveLag { delay_s: delay + hd, ..base }, DriveLag { lag_s: lag + hl, ..base }],
            )?;
            let mut mean = [Spread::default(); 3];
            is.each(record, cable, |_, e| {
                for (mean, e) in mean.iter_mut().zip(e) {
                    mean.add(*e);
                }
            });
            let mut is = is.again();
            is.each(record, cable, |_, e| {
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
            // A record that does not tell the two apart: share alike.
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

/// Sum, sum of squares and count.
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

    /// Sum of squares about the mean.
    fn square(&self) -> f64 {
        (self.squares - self.sum * self.mean()).max(0.0)
    }
}

/// Models of one cable run side by side through a record: measured less modelled length in each cycle.
struct Runs<const N: usize> {
    models: [CycleModel; N],
}

impl<const N: usize> Runs<N> {
    fn new(record: &Record<'_>, cable: usize, lags: &[DriveLag; N]) -> Result<Self, LagError> {
        let early_s = record.period_s - record.reading_s[cable];
        let mut models = [CycleModel::new(&lags[0], record.period_s, early_s)?; N];
        for (model, lag) in models.iter_mut().zip(lags) {
            *model = CycleModel::new(lag, record.period_s, early_s)?;
        }
        Ok(Self { models })
    }

    fn again(&self) -> Self {
        Self { models: self.models }
    }

    fn each(&mut self, record: &Record<'_>, cable: usize, mut with: impl FnMut(usize, &[f64; N])) {
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
    Runs::new(record, cable, &[*lag])?.each(record, cable, |k, e| with(k, e[0]));
    Ok(())
}

/// Sum over cables of the squares of what is left about each cable's own origin, m².
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

/// Commands of the last cycles, by cycle number. A cycle that was not noted had the command of the one before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommandHistory {
    ring: [CableVec; MAX_DELAY_CYCLES + 2],
    newest: u64,
    kept: usize,
}

impl CommandHistory {
    /// Nothing was commanded yet.
    pub fn new() -> Self {
        Self { ring: [CableVec::zeros(MAX_CABLES); MAX_DELAY_CYCLES + 2], newest: 0, kept: 0 }
    }

    /// The command that was sent in a cycle, m/s. An older cycle than the newest begins anew.
    pub fn note(&mut self, cycle: u64, command_m_s: &CableVec) {
        let len = self.ring.len();
        let command =
            CableVec::from_fn(MAX_CABLES, |i| command_m_s.get(i).copied().filter(|v| v.is_finite()).unwrap_or(0.0));
        if self.kept == 0 || cycle <= self.newest || cycle - self.newest > len as u64 {
            (self.newest, self.kept) = (cycle, 0);
        }
        let before = self.ago(0);
        let from = if self.kept == 0 { cycle } else { self.newest + 1 };
        for missing in from..cycle {
            self.ring[(missing % len as u64) as usize] = before;
        }
        self.ring[(cycle % len as u64) as usize] = command;
        self.kept = (self.kept + (cycle + 1 - from) as usize).min(len);
        self.newest = cycle;
    }

    /// The newest cycle noted.
    pub fn newest(&self) -> u64 {
        self.newest
    }

    /// The command of `cycles` before the newest, m/s; the oldest known, or zeros.
    pub fn ago(&self, cycles: usize) -> CableVec {
        if self.kept == 0 {
            return CableVec::zeros(MAX_CABLES);
        }
        let back = cycles.min(self.kept - 1) as u64;
        self.ring[((self.newest - back) % self.ring.len() as u64) as usize]
    }
}

impl Default for CommandHistory {
    fn default() -> Self {
        Self::new()
    }
}

/// Time over which lengths are compared, s: longer than any lag, shorter than a move.
const WASHOUT_S: f64 = 1.0;

/// Time of motion that counts for the misfit, s.
const MEMORY_S: f64 = 1.5;

/// The misfit of a model while the robot moves.
///
/// Lengths of model, no model and measurement are compared after a high-pass of a second, so that neither the origin of
/// the lengths nor a slow drift (line settling on the drum) counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MisfitMeter {
    winch: [Winch; MAX_CABLES],
    model: [f64; MAX_CABLES],
    naive: [f64; MAX_CABLES],
    model_power: f64,
    naive_power: f64,
}

impl MisfitMeter {
    /// Has seen nothing.
    pub fn new() -> Self {
        Self {
            winch: [Winch::default(); MAX_CABLES],
            model: [0.0; MAX_CABLES],
            naive: [0.0; MAX_CABLES],
            model_power: 0.0,
            naive_power: 0.0,
        }
    }

    /// Begins anew for a model, in the midst of motion: the model runs through the commands that are known.
    pub fn begin(&mut self, lag: &DriveLag, period_s: f64, reading_s: &[f64], sent: &CommandHistory) {
        *self = Self::new();
        for (i, (winch, reading_s)) in self.winch.iter_mut().zip(reading_s).enumerate() {
            let early_s = (period_s - reading_s).clamp(0.0, period_s);
            let Ok(model) = CycleModel::new(lag, period_s, early_s) else { return };
            let command = |ago: usize| sent.ago(ago)[i];
            winch.velocity_m_s = command(MAX_DELAY_CYCLES + 1);
            for ago in (0..MAX_DELAY_CYCLES).rev() {
                *winch = model.step(*winch, command(ago + model.whole() + 1), command(ago + model.whole()));
            }
            winch.length_m = 0.0;
        }
    }

    /// One cycle: what each cable moved by from the last reading to this one, m, taken `reading_s` after the newest
    /// command of the history. Ranges that make no model count for nothing.
    pub fn note(&mut self, lag: &DriveLag, period_s: f64, reading_s: &[f64], moved_m: &[f64], sent: &CommandHistory) {
        let none = DriveLag { delay_s: 0.0, lag_s: 0.0 };
        let keep = 1.0 - (period_s / WASHOUT_S).clamp(0.0, 1.0);
        let (mut model, mut naive) = (0.0, 0.0);
        let n = moved_m.len().min(reading_s.len()).min(MAX_CABLES);
        for i in 0..n {
            let early_s = (period_s - reading_s[i]).clamp(0.0, period_s);
            let cycle = |lag| CycleModel::new(lag, period_s, early_s);
            let (Ok(with), Ok(without)) = (cycle(lag), cycle(&none)) else { return };
            let command = |ago: usize| sent.ago(ago)[i];
            let before = self.winch[i];
            let after = with.step(before, command(with.whole() + 1), command(with.whole()));
            let at_once = without.step(Winch::default(), command(without.whole() + 1), command(without.whole()));
            if !moved_m[i].is_finite() {
                return;
            }
            self.model[i] = keep * self.model[i] + moved_m[i] - (after.length_m - before.length_m);
            self.naive[i] = keep * self.naive[i] + moved_m[i] - at_once.length_m;
            self.winch[i] = Winch { length_m: 0.0, velocity_m_s: after.velocity_m_s };
            model += self.model[i] * self.model[i];
            naive += self.naive[i] * self.naive[i];
        }
        // Standstill says nothing and makes nothing forgotten.
        if naive >= LEAST_MOTION_M * LEAST_MOTION_M {
            let forget = 1.0 - (period_s / MEMORY_S).clamp(0.0, 1.0);
            self.model_power = forget * self.model_power + model;
            self.naive_power = forget * self.naive_power + naive;
        }
    }

    /// The misfit of the last motion; `None` as long as too little has moved (the equivalent of five cycles with 2 mm).
    pub fn misfit(&self) -> Option<f64> {
        let enough = 5.0 * 4.0 * LEAST_MOTION_M * LEAST_MOTION_M;
        (self.naive_power >= enough).then(|| (self.model_power / self.naive_power).sqrt())
    }
}

impl Default for MisfitMeter {
    fn default() -> Self {
        Self::new()
    }
}
