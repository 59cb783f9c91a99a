//! Observer of the winches: a model driven by the commands that were sent and corrected by measured lengths.

use crate::drive_lag::{CommandHistory, CycleModel, DriveLag, LagError, Piece, Winch};
use cable_robot::rate::lasting;
use cable_robot::{CableVec, MAX_CABLES};

/// Standard deviation of a measured length, m: half a step of a wheel with 10,000 counts per metre.
const LENGTH_SIGMA_M: f64 = 5e-5;

/// Model error of a velocity per second of running, m/s: a speed loop with an error of 1 % of 0.2 m/s during a
/// start of half a second.
const VELOCITY_SIGMA: f64 = 5e-3;

/// A measured length farther than this from the observed one means that the position was re-zeroed, m.
const JUMP_M: f64 = 0.05;

/// Number of cycles without an estimate that the observer bridges; at more than 250 Hz, as long.
const BRIDGED_CYCLES: u32 = 10;

/// Model of all winches, driven by the commands that were sent and corrected by measured lengths: a
/// steady-state Kalman filter.
///
/// ```
/// use cable_robot::CableVec;
/// use cable_control::drive_lag::{CommandHistory, CycleModel, DriveLag, Winch};
/// use cable_control::preview::DriveObserver;
/// let lag = DriveLag::new(0.03, 0.04)?;
/// let (drive, mut observer) = (CycleModel::new(&lag, 0.01, 0.01)?, DriveObserver::new(&lag, 0.01)?);
/// let (mut sent, mut winch) = (CommandHistory::new(), Winch { length_m: 6.0, velocity_m_s: 0.0 });
/// for cycle in 1..100 {
///     sent.record(cycle, &CableVec::repeat(1, if cycle < 50 { 0.0 } else { 0.2 }));
///     winch = drive.step(winch, sent.delayed(drive.delay_cycles() + 1)[0], sent.delayed(drive.delay_cycles())[0]);
///     // Read when the command is sent, in steps of 0.1 mm.
///     let read = CableVec::repeat(1, (winch.length_m * 1e4).round() * 1e-4);
///     observer.correct(cycle, 0.0, &read, &CableVec::repeat(1, 0.0), &sent);
/// }
/// assert!((observer.velocities_m_s(1)[0] - 0.2).abs() < 0.01);
/// // The next command takes effect after three cycles of delay and the cycle in which it is sent.
/// let there = observer.at_next_command(&sent)[0];
/// assert!((there.length_m - (winch.length_m + 4.0 * 0.2 * 0.01)).abs() < 2e-4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveObserver {
    lag: DriveLag,
    model: CycleModel,
    period_s: f64,
    gain: [f64; 2],
    winches: [Winch; MAX_CABLES],
    /// Cycle at whose beginning `winches` is valid.
    cycle: Option<u64>,
}

impl DriveObserver {
    /// Builds an observer of unknown lengths.
    pub fn new(lag: &DriveLag, period_s: f64) -> Result<Self, LagError> {
        let model = CycleModel::new(lag, period_s, 0.0)?;
        let (l2, v2) = (LENGTH_SIGMA_M * LENGTH_SIGMA_M, VELOCITY_SIGMA * VELOCITY_SIGMA * period_s);
        // Filter of [L, v] with L' = L + c v, v' = e v over a cycle; the covariance starts large and converges.
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

    /// Corrects the model by the lengths measured in a cycle, m, `reading_s` after its command was sent; `sent` has
    /// that command as its newest. A cycle far from the last one, or lengths far from the observed ones, restart the
    /// observer with `velocities_m_s`.
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
        let bridged = u64::from(lasting(BRIDGED_CYCLES, self.period_s));
        let gap = self.cycle.and_then(|at| cycle.checked_sub(at)).filter(|gap| *gap <= bridged);
        for missed in (1..=gap.unwrap_or(0) as usize).rev() {
            self.advance(missed, sent);
        }
        // Advance from the beginning of the cycle to the reading, piece by piece.
        let lag_s = self.lag.lag_s();
        let before = Piece::new(reading_s.min(self.model.before.h), lag_s);
        let after = Piece::new(reading_s - before.h, lag_s);
        let (older, newer) = (sent.delayed(self.model.delay_cycles() + 1), sent.delayed(self.model.delay_cycles()));
        for i in 0..n {
            let winch = &mut self.winches[i];
            let there = after.step(before.step(*winch, older[i]), newer[i]);
            let beyond = lengths_m[i] - there.length_m;
            if gap.is_some() && beyond.abs() <= JUMP_M {
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

    /// Advances by one cycle, the one that begins with the command sent `ago` cycles before the newest.
    fn advance(&mut self, ago: usize, sent: &CommandHistory) {
        let d = self.model.delay_cycles() + ago;
        let (older, newer) = (sent.delayed(d + 1), sent.delayed(d));
        for (i, winch) in self.winches.iter_mut().enumerate() {
            *winch = self.model.step(*winch, older[i], newer[i]);
        }
    }

    /// Predicted state at the beginning of the cycle in which the next command takes effect: after
    /// [`DriveObserver::correct`] with the newest reading, advanced by the whole cycles of delay.
    pub fn at_next_command(&self, sent: &CommandHistory) -> [Winch; MAX_CABLES] {
        let mut ahead = *self;
        // The command sent `ago` cycles before the newest takes effect in the first of these cycles.
        for ago in (0..self.model.delay_cycles()).rev() {
            let (older, newer) = (sent.delayed(ago + 1), sent.delayed(ago));
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
