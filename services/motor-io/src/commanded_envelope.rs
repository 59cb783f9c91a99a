//! What a line may do by what was commanded of its drive lately: anything beyond that has another cause.

use crate::settings::CoreConfig;
use messages::CABLES;

/// Time constant with which an old command stops being an envelope for motion: drives lag by up to 0.16 s.
const EXCUSE_S: f64 = 0.3;
/// Velocity beyond what commands envelope, m/s and share of the limit: encoder steps and overshoot of the drive's loop.
const TOLERANCE_M_S: f64 = 0.03;
const TOLERANCE_SHARE: f64 = 0.25;

/// The velocities that commands of the recent past envelope, line by line.
#[derive(Debug, Clone)]
pub struct CommandedEnvelope {
    low_m_s: [f64; CABLES],
    high_m_s: [f64; CABLES],
    /// Cycles for which the drive has held or moved its line.
    driven: [u32; CABLES],
    keep: f64,
    tolerance_m_s: f64,
    settled_cycles: u32,
}

impl CommandedEnvelope {
    /// Nothing was commanded yet, and nothing is driven.
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

    /// One cycle: what was sent, whether the drive holds or moves the line at all, and whether it has replied. One that has not may still
    /// follow an older command, so that none of them is forgotten.
    pub fn note(&mut self, cable: usize, sent_m_s: f64, driven: bool, replied: bool) {
        let keep = if replied { self.keep } else { 1.0 };
        let (low, high) = (self.low_m_s[cable], self.high_m_s[cable]);
        self.low_m_s[cable] = sent_m_s.min(sent_m_s + (low - sent_m_s) * keep);
        self.high_m_s[cable] = sent_m_s.max(sent_m_s + (high - sent_m_s) * keep);
        self.driven[cable] = if driven { self.driven[cable].saturating_add(1) } else { 0 };
    }

    /// Least and largest velocity of the line that is still explained, m/s.
    #[must_use]
    pub fn velocity_m_s(&self, cable: usize) -> [f64; 2] {
        [self.low_m_s[cable] - self.tolerance_m_s, self.high_m_s[cable] + self.tolerance_m_s]
    }

    /// The same of a length that was not read all the time: a drive may have stood still meanwhile. None where the line was free not
    /// long ago, and hands or its own pull may have moved it.
    #[must_use]
    pub fn drift_m_s(&self, cable: usize) -> Option<[f64; 2]> {
        let [low, high] = self.velocity_m_s(cable);
        let stood = self.tolerance_m_s;
        (self.driven[cable] > self.settled_cycles).then_some([low.min(-stood), high.max(stood)])
    }
}
