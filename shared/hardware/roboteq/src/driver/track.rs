//! The counters so far, and where their motion leads.

use crate::codec::AXES;

/// Motion older than this leads nowhere, ns.
const OLD_NS: u64 = 500_000_000;

/// The counts so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Track {
    /// Counters of the controller at the last accepted sample.
    pub(super) raw: Option<[i32; AXES]>,
    /// Speeds between the last two, counts per nanosecond.
    pub(super) pace: Option<[f64; AXES]>,
    /// The last sample was beyond the bound and was held back.
    pub(super) held_back: bool,
    /// Counters where the motion seems to have changed abruptly, and their time, ns.
    pub(super) abrupt: Option<([i32; AXES], u64)>,
}

impl Track {
    /// Motion that is expected in this time.
    pub(super) fn ahead(&self, passed_ns: u64) -> Option<[i32; AXES]> {
        let pace = self.pace.filter(|_| passed_ns < OLD_NS)?;
        Some(pace.map(|pace| (pace * passed_ns as f64).round() as i32))
    }

    /// Forgets a controller that has restarted: its counters continue nothing.
    pub(super) fn forget(&mut self) {
        *self = Track::default();
    }
}
