//! Evidence of a computer that kept motor-io, or the processes that answer it, from running.
//!
//! The evidence is in `motor/input` and in the clock. What coincides with it is not held against a drive, an estimator
//! or a cable: see `computer` and `follow`.

use messages::{ROLE_SLOTS, SLOTS};

/// Evidence of one cycle. A counter that was 0 before was unknown.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Evidence {
    /// motor-io began late.
    pub(super) late_tick: bool,
    /// The previous exchange with the drives ended too late for an answer, because the computer delayed motor-io or the
    /// virtual motor box.
    pub(super) overrun: bool,
    /// The previous exchange ended too late for an answer, because the drives were slow.
    pub(super) slow_drives: bool,
    /// motor-io's thread waited for a processor.
    pub(super) waited: bool,
    /// The virtual motor box left out time because it had no processor.
    pub(super) left_out: bool,
    /// Threads of controllers a, b and estimators a, b waited for a processor.
    pub(super) chain: [bool; ROLE_SLOTS],
}

impl Evidence {
    /// True if a missing answer of the drives in this cycle can be due to the computer.
    pub fn of_drives(&self) -> bool {
        self.late_tick || self.waited || self.left_out
    }

    /// True if the drives were too slow in the previous cycle for anything to answer to it.
    pub fn slow_drives(&self) -> bool {
        self.slow_drives
    }

    /// True if a missing answer of these slots to the previous cycle can be due to the computer.
    pub fn of_chain(&self, pair: (usize, usize)) -> bool {
        self.late_tick || self.overrun || self.waited_of(pair)
    }

    fn waited_of(&self, (controller, estimator): (usize, usize)) -> bool {
        self.chain[controller] || self.chain[SLOTS + estimator]
    }
}

/// Evidence over time.
#[derive(Debug, Clone)]
pub(super) struct Starved {
    pub(super) now: Evidence,
    pub(super) run_delay_ns: u64,
    pub(super) chain_delay_ns: [u64; ROLE_SLOTS],
    pub(super) box_left_out_ns: u64,
    /// Time that the virtual motor box left out since the previous cycle, s: nothing moved in it.
    pub(super) left_out_s: f64,
    /// Cycles since the last evidence of motor-io itself; 0: in this one.
    pub(super) own_age: u32,
    /// Cycles since the last evidence of motor-io or the pair in charge.
    pub(super) age: u32,
    /// The last 128 periods, 256 ms at 500 Hz, the newest in the lowest bit; 1: evidence of motor-io or the pair in
    /// charge.
    pub(super) recent: u128,
    /// Cycles for which the cause of a stop is still shown.
    pub(super) named_cycles: u32,
}

impl Default for Starved {
    fn default() -> Self {
        Self {
            now: Evidence::default(),
            run_delay_ns: 0,
            chain_delay_ns: [0; ROLE_SLOTS],
            box_left_out_ns: 0,
            left_out_s: 0.0,
            own_age: u32::MAX,
            age: u32::MAX,
            recent: 0,
            named_cycles: 0,
        }
    }
}

impl Starved {
    /// Returns true if there was evidence within this many cycles.
    pub(super) fn within(&self, cycles: u32) -> bool {
        self.age <= cycles
    }
}
