//! Whether the computer kept this program, or those that answer it, from running: by the evidence in `motor/input`, and by the clock.
//!
//! What coincides with that is not held against a drive, an estimator or a line: see `computer` and `follow`.

use messages::{SEATS, SLOTS};

/// What one cycle shows. A number that was 0 before was not known.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Evidence {
    /// This program came too late for the tick.
    pub(super) late_tick: bool,
    /// The exchange with the drives before ended so late, because the computer kept this program or the virtual box waiting, that estimator
    /// and controller had no time for an answer.
    pub(super) overrun: bool,
    /// The same, because the drives took so long.
    pub(super) slow_drives: bool,
    /// This program's thread waited for a processor.
    pub(super) waited: bool,
    /// The virtual box left out time for want of a processor.
    pub(super) left_out: bool,
    /// Threads of controllers a, b and estimators a, b waited for a processor.
    pub(super) chain: [bool; SEATS],
}

impl Evidence {
    /// What the drives did not answer in this cycle may be for want of a processor.
    pub fn of_drives(&self) -> bool {
        self.late_tick || self.waited || self.left_out
    }

    /// The drives took so long in the cycle before that nothing could answer to it.
    pub fn slow_drives(&self) -> bool {
        self.slow_drives
    }

    /// What these slots did not answer to the cycle before may be.
    pub fn of_chain(&self, pair: (usize, usize)) -> bool {
        self.late_tick || self.overrun || self.waited_of(pair)
    }

    fn waited_of(&self, (controller, estimator): (usize, usize)) -> bool {
        self.chain[controller] || self.chain[SLOTS + estimator]
    }
}

/// The evidence, cycle by cycle.
#[derive(Debug, Clone)]
pub(super) struct Starved {
    pub(super) now: Evidence,
    pub(super) run_delay_ns: u64,
    pub(super) chain_delay_ns: [u64; SEATS],
    pub(super) box_left_out_ns: u64,
    /// Time that the virtual box left out between this cycle and the one before, s: nothing moved in it.
    pub(super) left_out_s: f64,
    /// Cycles since the last evidence of this program; 0: in this one.
    pub(super) own_age: u32,
    /// The same of this program or the pair in charge.
    pub(super) age: u32,
    /// The last 64 periods, the newest in the lowest bit; 1: evidence of this program or the pair in charge.
    pub(super) recent: u64,
    /// Cycles for which a stop of this cause is still named.
    pub(super) said: u32,
}

impl Default for Starved {
    fn default() -> Self {
        Self {
            now: Evidence::default(),
            run_delay_ns: 0,
            chain_delay_ns: [0; SEATS],
            box_left_out_ns: 0,
            left_out_s: 0.0,
            own_age: u32::MAX,
            age: u32::MAX,
            recent: 0,
            said: 0,
        }
    }
}

impl Starved {
    /// Evidence in this cycle, or in one of so many before it.
    pub(super) fn within(&self, cycles: u32) -> bool {
        self.age <= cycles
    }
}
