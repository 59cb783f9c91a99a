//! The commands under which winches as modelled would run along the desired lengths, and how they would run.

use super::{PreviewError, PreviewGain};
use crate::drive_lag::{DriveLag, Winch};
use cable_robot::{CableVec, MAX_CABLES};

/// Move penalty of the lead, s⁴. It answers to no measurement, so it may be as quick as a control cycle lets it be: at
/// 56 rad/s a ramp of speed that begins at 0.3 m/s² is cut by 0.3 / 56², 0.1 mm.
const MOVE_PENALTY_S4: f64 = 1e-7;

/// Farther than this from the desired lengths the lead begins anew on them, m: they have jumped, and bringing the winches
/// there is the business of the feedback.
const LOST_M: f64 = 5e-3;

/// What the winches are to do in the cycle in which the next command takes effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Led {
    /// Where they should be at its beginning.
    pub winches: [Winch; MAX_CABLES],
    /// The command before it, m/s.
    pub previous_m_s: CableVec,
    /// The command that keeps them on the desired lengths, m/s.
    pub command_m_s: CableVec,
}

/// Runs the model along the desired lengths by itself, under a quick preview law.
///
/// What is known beforehand is thereby followed as closely as the drives allow, whatever the quickness of the feedback,
/// which has to stay below what the model is good for.
///
/// ```
/// use cable_robot::CableVec;
/// use cable_control::drive_lag::DriveLag;
/// use cable_control::preview::Lead;
/// let mut lead = Lead::new(&DriveLag::new(0.03, 0.04)?, 0.01, 40)?;
/// // A ramp of 0.2 m/s: its own speed is the command, and the winch runs on it.
/// let wanted = |cycle: u64| 6.0 + 0.002 * cycle as f64;
/// for cycle in 1..100 {
///     let ahead: Vec<CableVec> = (1..=40).map(|j| CableVec::repeat(1, wanted(cycle + j))).collect();
///     let led = lead.step(cycle, &ahead);
///     assert!((led.command_m_s[0] - 0.2).abs() < 1e-6 && (led.winches[0].length_m - wanted(cycle)).abs() < 1e-6);
/// }
/// # Ok::<(), cable_control::preview::PreviewError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lead {
    gain: PreviewGain,
    /// The cycle of the last step and what came out.
    last: Option<(u64, Led)>,
}

impl Lead {
    /// For a model of the winches, a control period (s) and a preview of 2 to [`super::MAX_PREVIEW`] cycles.
    pub fn new(lag: &DriveLag, period_s: f64, horizon: usize) -> Result<Self, PreviewError> {
        Ok(Self { gain: PreviewGain::new(lag, period_s, horizon, MOVE_PENALTY_S4)?, last: None })
    }

    /// The next cycle. `ahead_m` are the desired lengths at the end of the cycle in which the command takes effect and of
    /// the following ones, at least two and as many as the preview is long. The same cycle again gives the same; after a
    /// gap, or where the desired lengths have jumped, the lead begins on them.
    pub fn step(&mut self, cycle: u64, ahead_m: &[CableVec]) -> Led {
        let (Some(first), Some(second)) = (ahead_m.first(), ahead_m.get(1)) else {
            return Led {
                winches: Default::default(),
                previous_m_s: CableVec::zeros(0),
                command_m_s: CableVec::zeros(0),
            };
        };
        let n = first.len();
        let period_s = self.gain.period_s();
        let (mut winches, mut previous_m_s) = match self.last {
            Some((at, led)) if at == cycle => (led.winches, led.previous_m_s),
            Some((at, led)) if at + 1 == cycle && led.command_m_s.len() == n => {
                let mut next = led.winches;
                for (i, winch) in next.iter_mut().enumerate().take(n) {
                    *winch = self.gain.model.step(*winch, led.previous_m_s[i], led.command_m_s[i]);
                }
                (next, led.command_m_s)
            }
            _ => ([Winch { length_m: f64::INFINITY, velocity_m_s: 0.0 }; MAX_CABLES], CableVec::zeros(n)),
        };
        let lost = (0..n).any(|i| {
            let there_m = winches[i].length_m + period_s * winches[i].velocity_m_s;
            // Also true for what is not a number.
            !((first[i] - there_m).abs() <= LOST_M)
        });
        if lost {
            for (i, winch) in winches.iter_mut().enumerate().take(n) {
                let step_m = second[i] - first[i];
                *winch = Winch { length_m: first[i] - step_m, velocity_m_s: step_m / period_s };
            }
            previous_m_s = CableVec::from_fn(n, |i| winches[i].velocity_m_s);
        }
        let command_m_s =
            CableVec::from_fn(n, |i| self.gain.command(winches[i], previous_m_s[i], ahead_m.iter().map(|at| at[i])));
        let led = Led { winches, previous_m_s, command_m_s };
        self.last = Some((cycle, led));
        led
    }
}
