//! What the suite does to virtual units.

use drives::{AXES, Command};
use serial::Device;

/// The virtual units of a wire, as the suite operates them. Units and motors are counted from 0.
pub trait VirtualUnits: Device {
    /// Sets what the sensors of a unit measure: counts since the start of the simulation, from which the unit derives
    /// its own register, and motor currents in A.
    fn measure(&mut self, unit: usize, counts: [i64; AXES], currents_a: [f64; AXES]);

    /// Sets what the second encoder of the unit's one cable measures; only of a family with [`crate::Family::SECOND`].
    fn measure_second(&mut self, _unit: usize, _counts: i64) {}

    /// What the unit does with a motor at present: [`Command::Release`] also where an error stops it.
    fn drive(&self, unit: usize, motor: usize) -> Command;

    /// The supply of a unit fails for `down_ns`. Then the unit starts with its counts at zero and its default watchdog.
    fn restart(&mut self, unit: usize, down_ns: u64);

    /// Withholds all answers of a unit, which still executes commands.
    fn mute(&mut self, unit: usize, muted: bool);

    /// Presses or releases the emergency stop at a unit's own input.
    fn press_stop(&mut self, unit: usize, pressed: bool);

    /// From now on the unit acknowledges a new watchdog time but keeps this one, ms.
    fn keep_watchdog(&mut self, unit: usize, kept_ms: u32);
}
