//! Which cables were read, and when.

use messages::{CABLES, MotorState};

use crate::cable_estimator::{BRIDGED_CYCLES, CableSample, Measurement};

/// Measurements by cable; `None` where a cable has none.
pub(crate) type Measurements = [Option<Measurement>; CABLES];

/// The cycles in which cables were read last; `None` before the first reading.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Readings([Option<u64>; CABLES]);

impl Readings {
    /// Processes the samples of a cycle; returns which cables were read in it or at most [`BRIDGED_CYCLES`] before.
    pub(crate) fn recent(&mut self, samples: &[CableSample], cycle: u64) -> [bool; CABLES] {
        for (read_cycle, sample) in self.0.iter_mut().zip(samples).filter(|(_, sample)| sample.length_m.is_some()) {
            *read_cycle = Some(sample.cycle);
        }
        self.0.map(|read_cycle| {
            let silent = read_cycle.and_then(|read_cycle| cycle.checked_sub(read_cycle));
            silent.is_some_and(|cycles| cycles <= BRIDGED_CYCLES)
        })
    }

    pub(crate) fn forget(&mut self) {
        *self = Self::default();
    }
}

/// The parts of a sample of the motors, by cable.
pub(crate) fn samples(state: &MotorState) -> [CableSample; CABLES] {
    std::array::from_fn(|i| CableSample {
        cycle: state.header.cycle,
        length_m: Some(state.length_m[i]).filter(|length_m| state.fresh[i] != 0 && length_m.is_finite()),
        sampled_ns: state.sampled_ns[i],
        command_m_s: if state.command_m_s[i].is_finite() { state.command_m_s[i] } else { 0.0 },
    })
}
