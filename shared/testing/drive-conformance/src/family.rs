//! What a family supplies to the suite.

use drives::{CountBound, DriveBus};
use serial::Pipe;

use crate::clockwork::Clockwork;
use crate::virtual_units::VirtualUnits;

/// Watchdog that the suite configures, ms.
pub const WATCHDOG_MS: u32 = 300;

/// Bound of the counts that the suite configures: three times the speed at which the clockwork counts.
pub const BOUND: CountBound = CountBound { counts_s: 3_000_000.0, margin: 0.0 };

/// A drive family under test.
pub trait Family {
    /// Its virtual units.
    type Units: VirtualUnits;
    /// Its driver.
    type Bus: DriveBus;

    /// Baud of the wire.
    const BAUD: u32;
    /// Connected motors of a unit, 1 or 2.
    const MOTORS: usize;
    /// Units on one port, 2; 1 for a protocol without addresses. Cases about another unit of the port are then left
    /// out.
    const UNITS: usize = 2;
    /// Longest time from a question to the end of waiting for its answer, ns.
    const ANSWER_NS: u64;
    /// Questions and answers that the command and the counts of one unit take.
    const EXCHANGES: u32 = 1;
    /// Smallest difference of speeds that its commands can express, counts per second.
    const SPEED_STEP_COUNTS_S: f64 = 1.0;
    /// Steps up to the highest speed that its commands can express.
    const SPEED_STEPS: u32 = u32::MAX;
    /// Width of the unit's counter, bits.
    const COUNTER_BITS: u32 = 32;
    /// The counter continues at its smallest number after its largest; false: it stays at its largest.
    const COUNTER_WRAPS: bool = true;

    /// The bus runs inline while nothing is left to do between cycles, and must then end every call by its deadline.
    const INLINE: bool = false;

    /// Its units have a second encoder here, which counts a part of what the first one does, backwards.
    const SECOND: bool = false;
    /// Counts of a step of its reading.
    const SECOND_STEP: i64 = 1;

    /// So many units with their defaults, just switched on.
    fn units(count: usize) -> Self::Units;

    /// A driver of so many units that has sent nothing yet, with [`WATCHDOG_MS`] and [`BOUND`].
    fn bus(pipe: Pipe<Clockwork<Self::Units>>, count: usize) -> Self::Bus;

    /// The driver's port.
    fn pipe(bus: &mut Self::Bus) -> &mut Pipe<Clockwork<Self::Units>>;
}
