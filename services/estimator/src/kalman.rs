//! One line with a Kalman filter: readings and commands in the order in which they happened.
//!
//! A command is sent at the beginning of a cycle and the encoder read some milliseconds later, so between two readings the
//! drive had the command of the earlier cycle, as far as the filter's few milliseconds are concerned.

use cable_control::length_filter::{FilterSettings, LengthFilter, Verdict};
use messages::MotorState;

use crate::estimator::BRIDGED_CYCLES;
use crate::method::{Found, ahead_s};

/// See the module's text.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    settings: FilterSettings,
    filter: Option<LengthFilter>,
    /// The instant of the filter's state, ns.
    true_ns: u64,
    /// When the newest reading that was taken was taken, ns, and its cycle.
    sampled_ns: u64,
    cycle: u64,
    /// Command sent in the last cycle, m/s.
    command_m_s: f64,
    /// Cycle of the newest reading, taken or not, and the time from the one before to it, ns.
    read_cycle: u64,
    elapsed_ns: u64,
    /// A reading that does not fit is believed at once.
    credulous: bool,
}

impl Line {
    pub(crate) fn new(settings: FilterSettings) -> Self {
        Self {
            settings,
            filter: None,
            true_ns: 0,
            sampled_ns: 0,
            cycle: 0,
            command_m_s: 0.0,
            read_cycle: 0,
            elapsed_ns: 0,
            credulous: false,
        }
    }

    pub(crate) fn retune(&mut self, settings: FilterSettings) {
        self.settings = settings;
        if let Some(filter) = &mut self.filter {
            filter.retune(settings);
        }
    }

    /// Takes the reading of this cycle, if there is one.
    pub(crate) fn read(&mut self, state: &MotorState, i: usize) {
        let (length_m, sampled_ns) = (state.length_m[i], state.sampled_ns[i]);
        if state.fresh[i] != 0 && length_m.is_finite() {
            // After more than what may be bridged, what the drive did in the meantime is not known well enough.
            let silent = state.header.cycle.checked_sub(self.cycle);
            let known = self.filter.filter(|_| silent.is_some_and(|silent| silent <= 2 * BRIDGED_CYCLES));
            let mut filter = known.unwrap_or_else(|| LengthFilter::new(self.settings, length_m));
            let mut verdict = Verdict::BegunAnew;
            let elapsed_ns = sampled_ns.saturating_sub(self.true_ns);
            // After a cycle without a reading, or a machine that stood still, it is the prediction that is doubtful.
            let gap = self.read_cycle.checked_add(1) != Some(state.header.cycle) || elapsed_ns / 2 > self.elapsed_ns;
            (self.read_cycle, self.elapsed_ns) = (state.header.cycle, elapsed_ns);
            if known.is_some() {
                filter.predict(self.command_m_s, elapsed_ns as f64 * 1e-9);
                verdict = filter.read(length_m);
                if verdict == Verdict::Refused && (self.credulous || gap) {
                    (filter, verdict) = (LengthFilter::new(self.settings, length_m), Verdict::BegunAnew);
                }
            }
            self.credulous = false;
            self.filter = Some(filter);
            self.true_ns = if verdict == Verdict::BegunAnew { sampled_ns } else { sampled_ns.max(self.true_ns) };
            if verdict != Verdict::Refused {
                (self.sampled_ns, self.cycle) = (sampled_ns, state.header.cycle);
            }
        }
        self.command_m_s = if state.command_m_s[i].is_finite() { state.command_m_s[i] } else { 0.0 };
    }

    /// The filter's state, carried on to the instant.
    pub(crate) fn at(&self, cycle: u64, instant_ns: u64) -> Option<Found> {
        let mut filter = self.filter?;
        let silent = cycle.checked_sub(self.cycle)?;
        if silent > BRIDGED_CYCLES {
            return None;
        }
        filter.predict(self.command_m_s, ahead_s(instant_ns, self.true_ns, silent));
        let (length_m, velocity_m_s) = (filter.length_m(), filter.velocity_m_s());
        (length_m.is_finite() && velocity_m_s.is_finite()).then_some(Found {
            length_m,
            velocity_m_s,
            steady_m_s: Some(velocity_m_s),
            sigma_m: filter.length_sigma_m(),
            phi: [0.0; 2],
            sampled_ns: self.sampled_ns,
        })
    }

    /// The next reading may be anywhere: the lengths were perhaps given anew.
    pub(crate) fn expect_anything(&mut self) {
        self.credulous = true;
    }

    pub(crate) fn forget(&mut self) {
        *self = Self::new(self.settings);
    }
}
