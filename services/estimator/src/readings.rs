//! Which cables were read, and when.

use messages::{CABLES, MotorState};

use crate::cable_estimator::{CableSample, Instant, Measurement};

/// Measurements by cable; `None` where a cable has none.
pub(crate) type Measurements = [Option<Measurement>; CABLES];

/// Cycle of the last reading of each cable; `None` before the first one.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Readings([Option<u64>; CABLES]);

impl Readings {
    /// Processes the samples of a cycle; returns which cables were read in it, or so shortly before its instant that a
    /// method bridges the time ([`Instant::bridges`]).
    #[inline]
    pub(crate) fn recent(&mut self, samples: &[CableSample], instant: &Instant) -> [bool; CABLES] {
        for (read, sample) in self.0.iter_mut().zip(samples).filter(|(_, sample)| sample.length_m.is_some()) {
            *read = Some(sample.cycle);
        }
        self.0.map(|read| read.is_some_and(|cycle| instant.bridges(cycle)))
    }

    pub(crate) fn forget(&mut self) {
        *self = Self::default();
    }
}

/// The parts of a sample of the motors, by cable; `period_s` is that of the cycle.
#[inline]
pub(crate) fn samples(state: &MotorState, period_s: f64) -> [CableSample; CABLES] {
    std::array::from_fn(|i| CableSample {
        cycle: state.header.cycle,
        length_m: Some(state.length_m[i]).filter(|length_m| state.fresh[i] != 0 && length_m.is_finite()),
        sampled_ns: state.sampled_ns[i],
        command_m_s: if state.command_m_s[i].is_finite() { state.command_m_s[i] } else { 0.0 },
        period_s,
    })
}
