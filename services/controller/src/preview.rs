//! The preview law at run time: selects the model of the drives, checks whether it still fits, and computes the weight
//! of the preview law in the command.
//!
//! The command is that of lq-endpoint plus `weight` times the difference of the preview law to it. The weight changes
//! between 0 and 1 in fractions of a second, so that no change of law or model causes a step. It decreases to 0
//!
//! * without a model: none is configured and none identified yet;
//! * while the misfit of the model ([`cable_control::drive_lag`]) is above `misfit_limit`;
//! * while a newly identified model replaces the old one.

mod recorder;

use cable_control::drive_lag::{CommandHistory, DriveLag, Identified, IdentifyError, MisfitMeter, Winch};
use cable_control::preview::{DriveObserver, LeadCommand, LeadFilter, MAX_PREVIEW, PreviewError, PreviewGain};
use cable_robot::{CableVec, MAX_CABLES};
use messages::{MotorAuthority, MotorState, NodeEstimate, SLOTS};
use recorder::Recorder;
use thiserror::Error;

/// Times in which the weight increases from 0 to 1 and decreases from 1 to 0, s. The increase is slower than the lag of
/// slow drives; the decrease is faster than the build-up of an oscillation with a wrong model (a second and more).
const FADE_S: [f64; 2] = [0.4, 0.15];

/// Fraction of the misfit limit below which the model fits again; below 1 to avoid alternating at the limit.
const GOOD_AGAIN: f64 = 0.8;

/// Misfit below which a model is not replaced by a better one.
const GOOD_ENOUGH: f64 = 0.1;

/// Largest relative deviation of a reading interval from the period; with a larger one the machine has stalled.
const JITTER: f64 = 0.3;

/// Speed from which a change of length is no motion but a set length, m/s: the largest limit of a robot file.
const FASTEST_M_S: f64 = 10.0;

/// Settings of the preview law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreviewSettings {
    /// Preview beyond the delay, cycles.
    pub horizon: usize,
    /// Move penalty, s⁴; see [`PreviewGain::new`].
    pub move_penalty_s4: f64,
    /// Delay and lag of the drives, if known in advance.
    pub lag: Option<DriveLag>,
    /// Identify delay and lag while the robot moves.
    pub identify: bool,
    /// Misfit above which lq-endpoint takes over. For slow motion the misfit is the relative error of delay plus lag.
    /// In flights against the plant, the preview law was 1.3 to 3.2 times better with an error of 0.1, and between 1.4
    /// times better and 1.3 times worse with an error of 0.3; the limit is between the two.
    pub misfit_limit: f64,
}

/// A notice for the operator.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum Notice {
    /// A model was identified from the robot's motion.
    #[error(
        "the drives were identified: delay {:.1} ms, lag {:.1} ms, misfit {:.2}",
        .0.lag.delay_s() * 1e3, .0.lag.lag_s() * 1e3, .0.misfit
    )]
    Identified(Identified),
    /// The identification failed.
    #[error("the drives could not be identified: {0}")]
    NotIdentified(IdentifyError),
    /// The best model is not good enough.
    #[error(
        "the drives are not described by a delay and a lag: the misfit of the best pair is {misfit:.2}, above the limit of {limit}; lq-endpoint stays in charge"
    )]
    NoSuchModel {
        /// Misfit of the best model.
        misfit: f64,
        /// The configured limit.
        limit: f64,
    },
    /// The model no longer fits.
    #[error(
        "the drives do not follow their model: the misfit is {misfit:.2}, above the limit of {limit}; lq-endpoint takes over"
    )]
    Misfit {
        /// Present misfit.
        misfit: f64,
        /// The configured limit.
        limit: f64,
    },
    /// The model fits again.
    #[error("the drives follow their model again: the misfit is {misfit:.2}; the preview law takes over")]
    FitsAgain {
        /// Present misfit.
        misfit: f64,
    },
    /// The settings give no law.
    #[error("no preview law: {0}; lq-endpoint stays in charge")]
    NoLaw(PreviewError),
}

impl Notice {
    /// Returns whether the notice is about reduced accuracy.
    pub fn is_warning(&self) -> bool {
        !matches!(self, Self::Identified(_) | Self::FitsAgain { .. })
    }
}

/// The law for one model.
#[derive(Debug, Clone, Copy)]
struct Installed {
    gain: PreviewGain,
    lead: LeadFilter,
    twins: [DriveObserver; SLOTS],
}

/// Encoder readings of the last cycle.
#[derive(Debug, Clone, Copy)]
struct Reading {
    cycle: u64,
    length_m: [f64; MAX_CABLES],
    sampled_ns: [u64; MAX_CABLES],
    /// The lengths as they were last set, m, as bits; and the epoch, which ends even if the same lengths are set again.
    zeroed: ([u64; MAX_CABLES], u32),
}

/// State of the preview law.
#[derive(Debug, Clone)]
pub(crate) struct Preview {
    settings: PreviewSettings,
    cables: usize,
    sent: CommandHistory,
    installed: Option<Installed>,
    pending: Option<DriveLag>,
    meter: MisfitMeter,
    recorder: Recorder,
    last: Option<Reading>,
    weight: f64,
    bad: bool,
    rate: Option<(u64, f64, f64)>,
    ahead_m: Vec<CableVec>,
    /// Cycle and result of the newest preview.
    led: Option<(u64, LeadCommand)>,
    notice: Option<Notice>,
    /// Cycle in which each slot's observer was last corrected: once per cycle, even if the controller wakes up several
    /// times.
    corrected: [u64; SLOTS],
}

impl Preview {
    pub(crate) fn new(settings: PreviewSettings, cables: usize) -> Self {
        Self {
            settings,
            cables,
            sent: CommandHistory::new(),
            installed: None,
            pending: settings.lag,
            meter: MisfitMeter::new(),
            recorder: Recorder::new(),
            last: None,
            weight: 0.0,
            bad: false,
            rate: None,
            ahead_m: vec![CableVec::zeros(cables); MAX_PREVIEW],
            led: None,
            notice: None,
            corrected: [0; SLOTS],
        }
    }

    /// Starts another life of motor-io: cycles and sent commands are reset; the model of the drives remains.
    pub(crate) fn begin_life(&mut self) {
        self.pending = self.pending.or(self.installed.as_ref().map(|installed| installed.gain.lag()));
        self.sent = CommandHistory::new();
        self.recorder.drop_record();
        (self.last, self.rate, self.led) = (None, None, None);
        self.weight = 0.0;
        self.corrected = [0; SLOTS];
    }

    /// Changes the settings. If they change the law, it is replaced like a model: when the weight has decreased to 0.
    pub(crate) fn configure(&mut self, settings: PreviewSettings) {
        let was = std::mem::replace(&mut self.settings, settings);
        let law = |settings: &PreviewSettings| (settings.horizon, settings.move_penalty_s4, settings.lag);
        if law(&was) == law(&settings) {
            return;
        }
        let configured = settings.lag.filter(|_| settings.lag != was.lag);
        let present = self.installed.as_ref().map(|installed| installed.gain.lag());
        self.pending = configured.or(self.pending).or(present);
    }

    /// Returns the newest notice since the last call.
    pub(crate) fn notice(&mut self) -> Option<Notice> {
        self.notice.take()
    }

    /// Returns the weight of the preview law in the command, 0 to 1.
    pub(crate) fn weight(&self) -> f64 {
        self.weight
    }

    pub(crate) fn horizon(&self) -> usize {
        self.settings.horizon
    }

    /// Records the readings and the command of a cycle; `began_ns` is the time when the command was sent.
    pub(crate) fn observe(&mut self, state: &MotorState, authority: &MotorAuthority, began_ns: u64) {
        let (n, period_s, cycle) = (self.cables, authority.period_s, state.header.cycle);
        if !(period_s > 0.0 && period_s < 1.0) || self.last.is_some_and(|last| last.cycle == cycle) {
            return;
        }
        let command_m_s = CableVec::from_array8(&state.command_m_s, n);
        self.sent.record(cycle, &command_m_s);
        self.record_rate(authority);
        let reading_s =
            CableVec::from_fn(n, |i| (state.sampled_ns[i].saturating_sub(began_ns) as f64 * 1e-9).clamp(0.0, period_s));
        let zeroed = (state.zeroed_m.map(f64::to_bits), authority.epoch);
        let now = Reading { cycle, length_m: state.length_m, sampled_ns: state.sampled_ns, zeroed };
        let last = self.last.replace(now);
        let good = |last: &Reading| {
            last.cycle + 1 == cycle
                && last.zeroed == zeroed
                && (0..n).all(|i| {
                    let passed_s = state.sampled_ns[i].saturating_sub(last.sampled_ns[i]) as f64 * 1e-9;
                    let moved_m = state.length_m[i] - last.length_m[i];
                    let moves = moved_m.abs() < FASTEST_M_S * period_s;
                    state.fresh[i] == 1 && (passed_s - period_s).abs() <= JITTER * period_s && moves
                })
        };
        match last.filter(good) {
            Some(last) => {
                let moved_m = CableVec::from_fn(n, |i| state.length_m[i] - last.length_m[i]);
                self.update_misfit(&moved_m, &reading_s, period_s);
                if self.settings.identify {
                    let velocity_m_s = moved_m.map(|moved| moved / period_s);
                    match self.recorder.step(command_m_s, velocity_m_s, &reading_s, period_s) {
                        Some(Ok(found)) => self.consider(found),
                        Some(Err(error)) => self.notice = Some(Notice::NotIdentified(error)),
                        None => {}
                    }
                }
            }
            None => self.recorder.drop_record(),
        }
        self.update_weight(period_s, &reading_s);
    }

    /// Updates the misfit of the model, and whether it still fits.
    fn update_misfit(&mut self, moved_m: &CableVec, reading_s: &CableVec, period_s: f64) {
        let Some(installed) = &self.installed else { return };
        self.meter.record(&installed.gain.lag(), period_s, reading_s, moved_m, &self.sent);
        let Some(misfit) = self.meter.misfit() else { return };
        let limit = self.settings.misfit_limit;
        if !self.bad && misfit > limit {
            self.bad = true;
            self.notice = Some(Notice::Misfit { misfit, limit });
        } else if self.bad && misfit < GOOD_AGAIN * limit {
            self.bad = false;
            self.notice = Some(Notice::FitsAgain { misfit });
        }
    }

    /// Decides whether an identified model replaces the present one.
    fn consider(&mut self, found: Identified) {
        let limit = self.settings.misfit_limit;
        if found.misfit > limit {
            self.notice = Some(Notice::NoSuchModel { misfit: found.misfit, limit });
            return;
        }
        let present = self.installed.as_ref().and_then(|_| self.meter.misfit());
        if self.installed.is_none() || present.is_some_and(|now| now > GOOD_ENOUGH && found.misfit < 0.5 * now) {
            self.pending = Some(found.lag);
            self.notice = Some(Notice::Identified(found));
        }
    }

    /// Updates the weight; installs a pending model when the weight is 0.
    fn update_weight(&mut self, period_s: f64, reading_s: &CableVec) {
        let same_period = self.installed.as_ref().is_none_or(|installed| installed.gain.period_s() == period_s);
        if !same_period {
            self.pending = self.pending.or(self.installed.as_ref().map(|installed| installed.gain.lag()));
        }
        let wanted = self.installed.is_some() && self.pending.is_none() && !self.bad;
        if wanted {
            self.weight = (self.weight + period_s / FADE_S[0]).min(1.0);
        } else {
            self.weight = (self.weight - period_s / FADE_S[1]).max(0.0);
        }
        if self.weight > 0.0 {
            return;
        }
        let Some(lag) = self.pending.take() else { return };
        let PreviewSettings { horizon, move_penalty_s4, .. } = self.settings;
        let built = PreviewGain::new(&lag, period_s, horizon, move_penalty_s4).and_then(|gain| {
            let lead = LeadFilter::new(&lag, period_s, horizon)?;
            Ok(Installed { gain, lead, twins: [DriveObserver::new(&lag, period_s)?; SLOTS] })
        });
        match built {
            Ok(installed) => {
                self.installed = Some(installed);
                self.bad = false;
                self.meter.begin(&lag, period_s, reading_s, &self.sent);
            }
            Err(error) => {
                self.installed = None;
                self.notice = Some(Notice::NoLaw(error));
            }
        }
    }

    /// Records the rate of the plan clock and its change per cycle.
    fn record_rate(&mut self, authority: &MotorAuthority) {
        let (cycle, rate) = (authority.header.cycle, authority.plan_rate);
        let slope = match self.rate {
            Some((before, was, slope)) if before == cycle => {
                self.rate = Some((before, was, slope));
                return;
            }
            Some((before, was, _)) if before + 1 == cycle => rate - was,
            _ => 0.0,
        };
        self.rate = Some((cycle, rate, slope));
    }

    /// Extrapolates the plan clock, with its present ramp, over the previewed cycles. Calls `with` for the end of each:
    /// its index, the plan time in s, and the rate.
    fn plan_ahead(&self, authority: &MotorAuthority, lag: u64, mut with: impl FnMut(usize, f64, f64)) {
        let Some(installed) = &self.installed else { return };
        let (mut rate, target) = (authority.plan_rate, authority.plan_rate_target);
        let slope = self.rate.map_or(0.0, |(_, _, slope)| slope);
        let towards = slope * (target - rate) > 0.0;
        let first = 1 + installed.gain.delay_cycles();
        let mut time_s = authority.plan_time_s;
        for i in 1..=lag as usize + first + installed.gain.horizon() {
            if towards {
                rate = if slope > 0.0 { (rate + slope).min(target) } else { (rate + slope).max(target) };
            }
            time_s += rate * authority.period_s;
            if let Some(j) = i.checked_sub(lag as usize + first + 1) {
                with(j, time_s, rate);
            }
        }
    }

    /// Returns whether the preview of this cycle is computed.
    pub(crate) fn looked_ahead(&self, cycle: u64) -> bool {
        self.led.as_ref().is_some_and(|(of, _)| *of == cycle)
    }

    /// Computes the preview of a cycle: the desired lengths of the previewed cycles, and the motion of the winches that
    /// they need. `lengths` returns the desired lengths for a plan time and a rate.
    pub(crate) fn look_ahead(
        &mut self,
        authority: &MotorAuthority,
        lag: u64,
        mut lengths: impl FnMut(f64, f64) -> CableVec,
    ) {
        self.led = None;
        if self.weight > 0.0 {
            let mut ahead_m = std::mem::take(&mut self.ahead_m);
            self.plan_ahead(authority, lag, |j, time_s, rate| {
                if let Some(place) = ahead_m.get_mut(j) {
                    *place = lengths(time_s, rate);
                }
            });
            self.ahead_m = ahead_m;
            if let Some(installed) = &mut self.installed {
                let (cycle, horizon) = (authority.header.cycle + lag, installed.gain.horizon());
                self.led = Some((cycle, installed.lead.step(cycle, &self.ahead_m[..horizon])));
            }
        }
    }

    /// Corrects the observer of a slot by an estimate, which is of the time `since_s` after the command of its cycle
    /// was sent.
    pub(crate) fn correct(&mut self, slot: usize, estimate: &NodeEstimate, since_s: f64, velocities_m_s: &[f64]) {
        let cycle = estimate.header.cycle;
        if self.sent.newest() == cycle
            && self.corrected.get(slot).is_some_and(|last| *last != cycle)
            && let Some(installed) = &mut self.installed
            && let Some(observer) = installed.twins.get_mut(slot)
        {
            self.corrected[slot] = cycle;
            let n = self.cables;
            let lengths_m = CableVec::from_array8(&estimate.predicted_m, n);
            observer.correct(cycle, since_s, &lengths_m, &velocities_m_s[..n.min(velocities_m_s.len())], &self.sent);
        }
    }

    /// Returns the command of the preview law, m/s, if it has one. `behind_m` is the length error in directions that do
    /// not move the node, which is reduced with the time constant `redundant_s`.
    pub(crate) fn velocity(&self, slot: usize, cycle: u64, behind_m: &CableVec, redundant_s: f64) -> Option<CableVec> {
        let installed = self.installed.as_ref().filter(|_| self.weight > 0.0 && self.sent.newest() == cycle)?;
        let led = self.led.as_ref().filter(|(of, _)| *of == cycle).map(|(_, led)| led)?;
        let winches = installed.twins.get(slot)?.at_next_command(&self.sent);
        let previous = self.sent.delayed(0);
        // The feedback corrects a constant error with `rate` times the error.
        let share = (1.0 / (redundant_s * installed.gain.rate())).min(1.0);
        let u = CableVec::from_fn(self.cables, |i| {
            let (is, wanted) = (winches[i], led.winches[i]);
            let behind_m = (1.0 - share) * behind_m.get(i).copied().unwrap_or(0.0);
            let off = Winch {
                length_m: is.length_m + behind_m - wanted.length_m,
                velocity_m_s: is.velocity_m_s - wanted.velocity_m_s,
            };
            led.command_m_s[i] + installed.gain.correct(off, previous[i] - led.previous_m_s[i])
        });
        u.is_finite().then_some(u)
    }
}
