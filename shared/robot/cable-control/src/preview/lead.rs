//! Commands with which the modelled winches follow the desired lengths, and the resulting states.

use super::{PreviewError, PreviewGain};
use crate::drive_lag::{DriveLag, Winch};
use cable_robot::{CableVec, MAX_CABLES};

/// Move penalty of the lead, s⁴. The lead does not react to measurements, so its bandwidth is limited only by the
/// control cycle: at 56 rad/s, a ramp of speed that starts at 0.3 m/s² has an error of 0.3 / 56², 0.1 mm.
const MOVE_PENALTY_S4: f64 = 1e-7;

/// Distance from the desired lengths beyond which the lead restarts on them, m: the lengths have jumped, and the
/// feedback has to bring the winches there.
const JUMP_M: f64 = 5e-3;

/// Reference of the winches in the cycle in which the next command takes effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeadCommand {
    /// Desired states at its beginning.
    pub winches: [Winch; MAX_CABLES],
    /// The previous command, m/s.
    pub previous_m_s: CableVec,
    /// Command that keeps the winches on the desired lengths, m/s.
    pub command_m_s: CableVec,
}

/// Simulates the model along the desired lengths under a fast preview law.
///
/// The known part of the motion is followed as closely as the drives allow, independent of the bandwidth of the
/// feedback, which the accuracy of the model limits.
///
/// ```
/// use cable_robot::CableVec;
/// use cable_control::drive_lag::DriveLag;
/// use cable_control::preview::LeadFilter;
/// let mut lead = LeadFilter::new(&DriveLag::new(0.03, 0.04)?, 0.01, 40)?;
/// // A ramp of 0.2 m/s: its speed is the command, and the winch runs on it.
/// let wanted = |cycle: u64| 6.0 + 0.002 * cycle as f64;
/// for cycle in 1..100 {
///     let ahead: Vec<CableVec> = (1..=40).map(|j| CableVec::repeat(1, wanted(cycle + j))).collect();
///     let led = lead.step(cycle, &ahead);
///     assert!((led.command_m_s[0] - 0.2).abs() < 1e-6 && (led.winches[0].length_m - wanted(cycle)).abs() < 1e-6);
/// }
/// # Ok::<(), cable_control::preview::PreviewError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeadFilter {
    gain: PreviewGain,
    /// Cycle and result of the last step.
    last: Option<(u64, LeadCommand)>,
}

impl LeadFilter {
    /// Builds a lead for a model of the winches, a control period (s) and a preview of 2 to
    /// [`super::MAX_PREVIEW`] cycles.
    pub fn new(lag: &DriveLag, period_s: f64, horizon: usize) -> Result<Self, PreviewError> {
        Ok(Self { gain: PreviewGain::new(lag, period_s, horizon, MOVE_PENALTY_S4)?, last: None })
    }

    /// Advances to a cycle. `ahead_m` are the desired lengths at the end of the cycle in which the command takes effect
    /// and of the following ones, at least two and as many as the preview is long. The same cycle again returns the
    /// same result; after a gap, or if the desired lengths have jumped, the lead restarts on them.
    pub fn step(&mut self, cycle: u64, ahead_m: &[CableVec]) -> LeadCommand {
        let (Some(first), Some(second)) = (ahead_m.first(), ahead_m.get(1)) else {
            return LeadCommand {
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
            // Also true for NaN.
            !((first[i] - there_m).abs() <= JUMP_M)
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
        let led = LeadCommand { winches, previous_m_s, command_m_s };
        self.last = Some((cycle, led));
        led
    }
}
