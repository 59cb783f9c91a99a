//! Readings that change slowly, as far as they are sure.

use super::filter::{Middle, Steady};
use crate::codec::{AXES, Name};

/// The question of each cycle besides that for faults. Currents change fastest.
const ROTATION: [Name; 8] =
    [Name::Amps, Name::Power, Name::Amps, Name::MotorFaults, Name::Amps, Name::Volts, Name::Amps, Name::Watchdog];

/// Readings that are not yet sure.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Flags {
    pub(super) faults: Steady<i32>,
    pub(super) motors: Steady<[i32; AXES]>,
    pub(super) watchdog: Steady<i32>,
    pub(super) amps: Middle<AXES>,
    pub(super) power: Middle<AXES>,
    pub(super) volts: Middle<3>,
    /// Flags that are.
    pub(super) sure: u32,
    pub(super) sure_motors: [u32; AXES],
    /// Questions asked.
    turn: usize,
}

impl Flags {
    /// The question of the next cycle.
    pub(super) fn question(&mut self) -> Name {
        self.turn += 1;
        ROTATION[self.turn % ROTATION.len()]
    }

    /// Records the time of the watchdog; true where the one before was the same.
    pub(super) fn time_is(&mut self, time_ms: i32) -> bool {
        self.watchdog.read(time_ms).is_some()
    }
}
