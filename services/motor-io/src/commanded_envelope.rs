//! Envelope of cable velocities explained by recent commands; motion outside it has another cause.

use crate::settings::CoreConfig;
use messages::CABLES;

/// Decay time constant of past commands in the envelope, s: drives lag by up to 0.16 s.
const EXCUSE_S: f64 = 0.3;
/// Tolerance around the envelope, m/s and share of the limit: encoder steps and overshoot of the drive's loop.
const TOLERANCE_M_S: f64 = 0.03;
const TOLERANCE_SHARE: f64 = 0.25;

/// Velocities explained by recent commands, per cable.
#[derive(Debug, Clone)]
pub struct CommandedEnvelope {
    low_m_s: [f64; CABLES],
    high_m_s: [f64; CABLES],
    /// Cycles for which the drive has held or moved its cable.
    driven: [u32; CABLES],
    keep: f64,
    tolerance_m_s: f64,
    settled_cycles: u32,
}

impl CommandedEnvelope {
    /// No commands so far; no cable is driven.
    #[must_use]
    pub fn new(config: &CoreConfig) -> Self {
        Self {
            low_m_s: [0.0; CABLES],
            high_m_s: [0.0; CABLES],
            driven: [0; CABLES],
            keep: libm::exp(-config.period_s / EXCUSE_S),
            tolerance_m_s: TOLERANCE_M_S + TOLERANCE_SHARE * config.cable_speed_m_s,
            settled_cycles: config.cycles(EXCUSE_S),
        }
    }

    /// Records one cycle: the velocity sent, whether the drive holds or moves the cable, and whether it has replied. A
    /// drive that has not replied may still follow an older command, so the envelope keeps it.
    pub fn record(&mut self, cable: usize, sent_m_s: f64, driven: bool, replied: bool) {
        let keep = if replied { self.keep } else { 1.0 };
        let (low, high) = (self.low_m_s[cable], self.high_m_s[cable]);
        self.low_m_s[cable] = sent_m_s.min(sent_m_s + (low - sent_m_s) * keep);
        self.high_m_s[cable] = sent_m_s.max(sent_m_s + (high - sent_m_s) * keep);
        debug_assert!(
            (self.low_m_s[cable]..=self.high_m_s[cable]).contains(&sent_m_s),
            "the envelope of cable {cable} does not contain its command of {sent_m_s} m/s"
        );
        self.driven[cable] = if driven { self.driven[cable].saturating_add(1) } else { 0 };
    }

    /// Least and largest explained velocity of the cable, m/s.
    #[must_use]
    pub fn velocity_m_s(&self, cable: usize) -> [f64; 2] {
        [self.low_m_s[cable] - self.tolerance_m_s, self.high_m_s[cable] + self.tolerance_m_s]
    }

    /// Range of the average velocity over a time without readings, in which the drive may have been at rest. `None` if
    /// the cable was free recently and may have been moved by hand or by its tension.
    #[must_use]
    pub fn drift_m_s(&self, cable: usize) -> Option<[f64; 2]> {
        let [low, high] = self.velocity_m_s(cable);
        let stood = self.tolerance_m_s;
        (self.driven[cable] > self.settled_cycles).then_some([low.min(-stood), high.max(stood)])
    }
}
