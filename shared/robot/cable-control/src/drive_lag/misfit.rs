//! Misfit of a drive model, measured while the robot moves.

use super::{CommandHistory, CycleModel, DriveLag, MAX_DELAY_CYCLES, Winch};
use cable_robot::MAX_CABLES;

/// Smallest length residual without a model, m, for a cycle to count for the running misfit. It is larger than that of
/// a record because no offset is removed.
const LEAST_MOTION_M: f64 = 1e-3;

/// Time constant of the high-pass over lengths, s: longer than any lag, shorter than a move.
const WASHOUT_S: f64 = 1.0;

/// Time constant over which motion counts for the misfit, s.
const MEMORY_S: f64 = 1.5;

/// Running misfit of a model while the robot moves.
///
/// Lengths of the model, without a model, and measured are compared after a high-pass of one second, so that neither
/// the length offset nor a slow drift (cable settling on the drum) contributes.
///
/// ```
/// use cable_robot::CableVec;
/// use cable_control::drive_lag::{CommandHistory, CycleModel, DriveLag, MisfitMeter, Winch};
/// let (truth, wrong) = (DriveLag::new(0.05, 0.05)?, DriveLag::new(0.03, 0.04)?);
/// let drive = CycleModel::new(&truth, 0.01, 0.01)?;
/// let (mut right, mut off) = (MisfitMeter::new(), MisfitMeter::new());
/// let (mut sent, mut winch) = (CommandHistory::new(), Winch::default());
/// for cycle in 1..200 {
///     sent.record(cycle, &CableVec::repeat(1, if cycle % 80 < 40 { 0.2 } else { 0.0 }));
///     let next = drive.step(winch, sent.delayed(drive.delay_cycles() + 1)[0], sent.delayed(drive.delay_cycles())[0]);
///     let moved = [next.length_m - winch.length_m];
///     winch = next;
///     right.record(&truth, 0.01, &[0.0], &moved, &sent);
///     off.record(&wrong, 0.01, &[0.0], &moved, &sent);
/// }
/// // 0 is perfect; a model with 30 % less delay and lag has a misfit of about 0.3.
/// assert!(right.misfit().is_some_and(|misfit| misfit < 0.01));
/// assert!(off.misfit().is_some_and(|misfit| (0.2..0.4).contains(&misfit)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MisfitMeter {
    winch: [Winch; MAX_CABLES],
    model: [f64; MAX_CABLES],
    naive: [f64; MAX_CABLES],
    model_power: f64,
    naive_power: f64,
}

impl MisfitMeter {
    /// A meter without data.
    pub fn new() -> Self {
        Self {
            winch: [Winch::default(); MAX_CABLES],
            model: [0.0; MAX_CABLES],
            naive: [0.0; MAX_CABLES],
            model_power: 0.0,
            naive_power: 0.0,
        }
    }

    /// Restarts the meter for a model, possibly during motion: simulates the model along the known commands.
    pub fn begin(&mut self, lag: &DriveLag, period_s: f64, reading_s: &[f64], sent: &CommandHistory) {
        *self = Self::new();
        for (i, (winch, reading_s)) in self.winch.iter_mut().zip(reading_s).enumerate() {
            let early_s = (period_s - reading_s).clamp(0.0, period_s);
            let Ok(model) = CycleModel::new(lag, period_s, early_s) else { return };
            let command = |ago: usize| sent.delayed(ago)[i];
            winch.velocity_m_s = command(MAX_DELAY_CYCLES + 1);
            for ago in (0..MAX_DELAY_CYCLES).rev() {
                *winch =
                    model.step(*winch, command(ago + model.delay_cycles() + 1), command(ago + model.delay_cycles()));
            }
            winch.length_m = 0.0;
        }
    }

    /// Records one cycle: the length change of each cable between the last reading and this one, m, taken `reading_s`
    /// after the newest command of the history. Values outside the range of a model are ignored.
    pub fn record(&mut self, lag: &DriveLag, period_s: f64, reading_s: &[f64], moved_m: &[f64], sent: &CommandHistory) {
        let none = DriveLag { delay_s: 0.0, lag_s: 0.0 };
        let keep = 1.0 - (period_s / WASHOUT_S).clamp(0.0, 1.0);
        let (mut model, mut naive) = (0.0, 0.0);
        let n = moved_m.len().min(reading_s.len()).min(MAX_CABLES);
        for i in 0..n {
            let early_s = (period_s - reading_s[i]).clamp(0.0, period_s);
            let cycle = |lag| CycleModel::new(lag, period_s, early_s);
            let (Ok(with), Ok(without)) = (cycle(lag), cycle(&none)) else { return };
            let command = |ago: usize| sent.delayed(ago)[i];
            let before = self.winch[i];
            let after = with.step(before, command(with.delay_cycles() + 1), command(with.delay_cycles()));
            let at_once =
                without.step(Winch::default(), command(without.delay_cycles() + 1), command(without.delay_cycles()));
            if !moved_m[i].is_finite() {
                return;
            }
            self.model[i] = keep * self.model[i] + moved_m[i] - (after.length_m - before.length_m);
            self.naive[i] = keep * self.naive[i] + moved_m[i] - at_once.length_m;
            self.winch[i] = Winch { length_m: 0.0, velocity_m_s: after.velocity_m_s };
            model += self.model[i] * self.model[i];
            naive += self.naive[i] * self.naive[i];
        }
        // Standstill contains no information and must not discard any.
        if naive >= LEAST_MOTION_M * LEAST_MOTION_M {
            let forget = 1.0 - (period_s / MEMORY_S).clamp(0.0, 1.0);
            self.model_power = forget * self.model_power + model;
            self.naive_power = forget * self.naive_power + naive;
        }
    }

    /// Misfit of the last motion; `None` until enough has moved (the equivalent of five cycles with 2 mm).
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
