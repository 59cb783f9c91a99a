//! The counts so far.

use drives::Track;

use crate::codec::AXES;

/// The counts so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counted {
    /// Counters of the controller at the last accepted sample.
    pub(super) raw: Option<[i32; AXES]>,
    /// Where their motion leads.
    pub(super) motion: Track,
    /// The last sample was beyond the bound and was held back.
    pub(super) held_back: bool,
}

impl Counted {
    /// Forgets a controller that has restarted: its counters continue nothing.
    pub(super) fn forget(&mut self) {
        *self = Counted::default();
    }
}
