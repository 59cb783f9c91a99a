//! History of commands over the longest delay.

use super::MAX_DELAY_CYCLES;
use cable_robot::{CableVec, MAX_CABLES};

/// Commands of the last cycles, m/s, by cycle number. A cycle without an entry has the command of the previous cycle.
///
/// ```
/// use cable_robot::CableVec;
/// use cable_control::drive_lag::CommandHistory;
/// let mut sent = CommandHistory::new();
/// sent.record(7, &CableVec::repeat(3, 0.1));
/// sent.record(9, &CableVec::repeat(3, 0.2)); // cycle 8 was skipped: the drives kept their command
/// assert_eq!((sent.delayed(0)[0], sent.delayed(1)[0], sent.delayed(2)[0]), (0.2, 0.1, 0.1));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommandHistory {
    ring: [CableVec; MAX_DELAY_CYCLES + 2],
    newest: u64,
    kept: usize,
}

impl CommandHistory {
    /// An empty history: all commands are 0.
    pub fn new() -> Self {
        Self { ring: [CableVec::zeros(MAX_CABLES); MAX_DELAY_CYCLES + 2], newest: 0, kept: 0 }
    }

    /// Records the command sent in a cycle, m/s. A cycle older than the newest restarts the history.
    pub fn record(&mut self, cycle: u64, command_m_s: &CableVec) {
        let len = self.ring.len();
        let command =
            CableVec::from_fn(MAX_CABLES, |i| command_m_s.get(i).copied().filter(|v| v.is_finite()).unwrap_or(0.0));
        if self.kept == 0 || cycle <= self.newest || cycle - self.newest > len as u64 {
            (self.newest, self.kept) = (cycle, 0);
        }
        let before = self.delayed(0);
        let from = if self.kept == 0 { cycle } else { self.newest + 1 };
        for missing in from..cycle {
            self.ring[(missing % len as u64) as usize] = before;
        }
        self.ring[(cycle % len as u64) as usize] = command;
        self.kept = (self.kept + (cycle + 1 - from) as usize).min(len);
        self.newest = cycle;
    }

    /// Newest recorded cycle.
    pub fn newest(&self) -> u64 {
        self.newest
    }

    /// Command sent `cycles` before the newest, m/s; before the oldest known cycle, the oldest known command, or zeros.
    pub fn delayed(&self, cycles: usize) -> CableVec {
        if self.kept == 0 {
            return CableVec::zeros(MAX_CABLES);
        }
        let back = cycles.min(self.kept - 1) as u64;
        self.ring[((self.newest - back) % self.ring.len() as u64) as usize]
    }
}

impl Default for CommandHistory {
    fn default() -> Self {
        Self::new()
    }
}
