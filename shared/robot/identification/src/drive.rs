//! Delay and lag of a drive, from commands and lengths.

use nalgebra::{Matrix2, Vector2};

use crate::linear::{PARTS, Spread, part_of};
use crate::record::{IdentifyError, Record};
use crate::response::{Response, Simulated};
use crate::value::Value;

/// What the models leave out, as standard deviations that are added to those of the record. Measured with flights in
/// drawn worlds, in which backlash, stiction and the drum's layers act (`tests/tests/lockstep/identify.rs`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelError {
    /// Delay and lag together, s: when a command and a reading truly act within a cycle.
    pub total_s: f64,
    /// Split of them, s: friction, and the shape of the speed loop.
    pub split_s: f64,
    /// Frequency of the speed loop, as a share.
    pub loop_share: f64,
    /// Motor and load, as a share of each value.
    pub motor_share: f64,
    /// Resistance, as a share.
    pub resistance_share: f64,
}

/// See [`ModelError`].
pub const MODEL: ModelError =
    ModelError { total_s: 0.0012, split_s: 0.002, loop_share: 0.1, motor_share: 0.04, resistance_share: 0.01 };

/// Duration of a block, s, in which the mean of the lengths is free: slip and creep are slower.
const BLOCK_S: f64 = 2.0;
/// Frequency of a speed loop whose split is compared with that of an infinite one, where it cannot be measured, rad/s.
const TYPICAL_LOOP_RAD_S: f64 = 60.0;
const LONGEST_S: f64 = 0.5;
const PROBE_S: f64 = 1e-4;
const MAX_PASSES: usize = 40;
/// A step below which the fit has settled, s.
const SETTLED_S: f64 = 1e-6;

/// Delay and lag of a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// From a command to its first effect, s.
    pub delay_s: Value,
    /// Time constant after the delay, s.
    pub lag_s: Value,
    /// Both together, s: much better known than each.
    pub total_s: Value,
    /// Frequency of the speed loop behind the lag, rad/s; `None`: not measured, and the split is as uncertain.
    pub loop_rad_s: Option<Value>,
    /// Root mean square of the lengths that remain, m.
    pub residual_m: f64,
}

/// A fit, and what the record does at it.
pub(crate) struct Fitted {
    pub drive: Drive,
    pub simulated: Simulated,
    pub blocks: Blocks,
}

/// Blocks of flown cycles.
pub(crate) struct Blocks(pub Vec<std::ops::Range<usize>>);

impl Blocks {
    fn of(record: &Record) -> Self {
        let long = ((BLOCK_S / record.period_s).round() as usize).max(10);
        let starts = (0..record.len() / long).map(|block| block * long..(block + 1) * long);
        Self(starts.filter(|block| record.is_flown[block.clone()].iter().all(|flown| *flown)).collect())
    }

    /// Subtracts the mean of each block, and returns what is left of all blocks one after the other.
    pub fn centred(&self, value: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut out = Vec::new();
        for block in &self.0 {
            let mean = block.clone().map(&value).sum::<f64>() / block.len() as f64;
            out.extend(block.clone().map(|k| value(k) - mean));
        }
        out
    }
}

/// Residuals of the lengths and their derivatives by delay, lag and the loop's frequency.
struct Linearised {
    residuals: Vec<f64>,
    by: [Vec<f64>; 3],
}

fn simulate(record: &Record, at: Vector2<f64>, loop_rad_s: f64) -> Simulated {
    Response { delay_s: at[0], lag_s: at[1], loop_rad_s }.simulate(record)
}

fn residuals(record: &Record, blocks: &Blocks, simulated: &Simulated) -> Vec<f64> {
    blocks.centred(|k| record.length_m[k] - simulated.length_m[k])
}

fn square(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum()
}

impl Linearised {
    fn of(record: &Record, blocks: &Blocks, at: Vector2<f64>, loop_rad_s: f64) -> Self {
        let here = residuals(record, blocks, &simulate(record, at, loop_rad_s));
        let by = |to: Vector2<f64>, frequency: f64, step: f64| {
            let there = residuals(record, blocks, &simulate(record, to, frequency));
            there.iter().zip(&here).map(|(there, here)| (there - here) / step).collect::<Vec<f64>>()
        };
        let by_loop =
            if loop_rad_s.is_finite() { by(at, loop_rad_s * 1.01, loop_rad_s * 0.01) } else { vec![0.0; here.len()] };
        let by = [
            by(at + Vector2::new(PROBE_S, 0.0), loop_rad_s, PROBE_S),
            by(at + Vector2::new(0.0, PROBE_S), loop_rad_s, PROBE_S),
            by_loop,
        ];
        Self { residuals: here, by }
    }

    /// Normal equations without a part, if the loop's frequency is off by `off`.
    fn normal(&self, without: Option<usize>, off: f64) -> (Matrix2<f64>, Vector2<f64>) {
        let (mut matrix, mut vector) = (Matrix2::zeros(), Vector2::zeros());
        for (k, residual) in self.residuals.iter().enumerate() {
            if Some(part_of(k, self.residuals.len())) == without {
                continue;
            }
            let row = Vector2::new(self.by[0][k], self.by[1][k]);
            matrix += row * row.transpose();
            vector -= row * (residual + self.by[2][k] * off);
        }
        (matrix, vector)
    }

    /// Gauss-Newton step. Without a lag both times have the same effect, and the step is one of the delay alone.
    fn step(&self, without: Option<usize>, off: f64) -> Option<Vector2<f64>> {
        let (matrix, vector) = self.normal(without, off);
        let delay_s = vector[0] / matrix[(0, 0)];
        let together = matrix.cholesky().map(|solver| solver.solve(&vector)).filter(|step| step.amax() < LONGEST_S);
        together.or_else(|| delay_s.is_finite().then(|| Vector2::new(delay_s, 0.0)))
    }

    /// Damped step from `at` that keeps both times at 0 or above.
    fn bounded_step(&self, at: Vector2<f64>, damping: f64) -> Option<Vector2<f64>> {
        let (mut matrix, vector) = self.normal(None, 0.0);
        matrix[(0, 0)] *= 1.0 + damping;
        matrix[(1, 1)] *= 1.0 + damping;
        let step = matrix.cholesky()?.solve(&vector);
        for (bound, free) in [(0, 1), (1, 0)] {
            if at[bound] + step[bound] < 0.0 {
                // The other time alone, with this one at its bound.
                let mut held = Vector2::zeros();
                held[bound] = -at[bound];
                held[free] = (vector[free] - matrix[(free, bound)] * held[bound]) / matrix[(free, free)];
                return Some(held);
            }
        }
        Some(step)
    }
}

/// Minimises the squares from there.
fn minimise(
    record: &Record,
    blocks: &Blocks,
    from: Vector2<f64>,
    loop_rad_s: f64,
) -> Result<Vector2<f64>, IdentifyError> {
    let (mut at, mut damping) = (from, 1e-3);
    let mut cost = square(&residuals(record, blocks, &simulate(record, at, loop_rad_s)));
    for _ in 0..MAX_PASSES {
        let linear = Linearised::of(record, blocks, at, loop_rad_s);
        loop {
            let step = linear.bounded_step(at, damping).ok_or(IdentifyError::NotDetermined)?;
            let to = (at + step).map(|time_s| time_s.clamp(0.0, LONGEST_S));
            let there = square(&residuals(record, blocks, &simulate(record, to, loop_rad_s)));
            if there <= cost {
                let moved = (to - at).amax();
                (at, cost, damping) = (to, there, damping * 0.3);
                if moved < SETTLED_S {
                    return Ok(at);
                }
                break;
            }
            if damping > 1e6 {
                // No step is better: this is the minimum as far as numbers resolve it.
                return Ok(at);
            }
            damping *= 5.0;
        }
    }
    // The bottom of a flat valley: the deviations say how flat.
    Ok(at)
}

/// Fits delay and lag, with a speed loop behind them if its frequency is known.
pub(crate) fn fit(record: &Record, frequency: Option<&Spread>) -> Result<Fitted, IdentifyError> {
    let blocks = Blocks::of(record);
    if blocks.0.len() < PARTS {
        return Err(IdentifyError::Short { cycles: blocks.0.iter().map(std::ops::Range::len).sum() });
    }
    let loop_rad_s = frequency.map_or(f64::INFINITY, |frequency| frequency.all);
    let at = minimise(record, &blocks, Vector2::new(0.03, 0.03), loop_rad_s)?;
    let linear = Linearised::of(record, &blocks, at, loop_rad_s);
    let without = |part: Option<usize>| {
        let off = match (frequency, part) {
            (Some(frequency), Some(part)) => frequency.without[part] - frequency.all,
            _ => 0.0,
        };
        Some(at + linear.step(part, off)?)
    };
    let spread = |of: &dyn Fn(Vector2<f64>) -> f64| {
        Spread::of(|part| without(part).map(of)).ok_or(IdentifyError::NotDetermined).map(|spread| spread.sigma())
    };
    // A loop that is faster or slower than assumed moves the split, and not the sum.
    let split = match frequency {
        Some(frequency) => linear.step(None, MODEL.loop_share * frequency.all),
        None => Some(minimise(record, &blocks, at, TYPICAL_LOOP_RAD_S)? - at),
    };
    let split = split.ok_or(IdentifyError::NotDetermined)?;
    let sigma = |jackknife: f64, moved: f64| (jackknife.powi(2) + moved.powi(2) + MODEL.split_s.powi(2)).sqrt();
    let simulated = simulate(record, at, loop_rad_s);
    let rest = residuals(record, &blocks, &simulated);
    let drive = Drive {
        delay_s: Value { value: at[0], sigma: sigma(spread(&|at| at[0])?, split[0]) },
        lag_s: Value { value: at[1], sigma: sigma(spread(&|at| at[1])?, split[1]) },
        total_s: Value { value: at.sum(), sigma: (spread(&|at| at.sum())?.powi(2) + MODEL.total_s.powi(2)).sqrt() },
        loop_rad_s: frequency.map(|frequency| Value {
            value: frequency.all,
            sigma: (frequency.sigma().powi(2) + (MODEL.loop_share * frequency.all).powi(2)).sqrt(),
        }),
        residual_m: (square(&rest) / rest.len() as f64).sqrt(),
    };
    Ok(Fitted { drive, simulated, blocks })
}
