//! What the machine needs of the units of a port.

use std::fmt;

use plant::{MotorInput, Plant};
use serial::Device;

use crate::BoxError;

/// Motors of a unit.
pub(crate) const MOTORS: usize = 2;

/// Winch of a motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Winch {
    pub(crate) cable: usize,
    /// -1 where the count falls as cable pays out.
    pub(crate) sign: f64,
    /// The same of the second encoder.
    pub(crate) second_sign: f64,
}

/// What the sensors of a unit measure. Per motor, positive is the direction in which its count rises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Readings {
    pub(crate) counts: [i64; MOTORS],
    /// Of the second encoders of the same cables.
    pub(crate) second_counts: [i64; MOTORS],
    pub(crate) speeds_counts_s: [f64; MOTORS],
    pub(crate) currents_a: [f64; MOTORS],
    pub(crate) duties: [f64; MOTORS],
    pub(crate) supply_v: f64,
    pub(crate) temperature_c: f64,
    /// The stop button at the unit is pressed.
    pub(crate) stopped: bool,
}

/// Virtual units of one family on one port. Units are counted from 0.
pub(crate) trait Twin: fmt::Debug + Send {
    /// A copy with the same state.
    fn copy(&self) -> Box<dyn Twin>;

    /// The units as the far end of a wire.
    fn device(&mut self) -> &mut dyn Device;

    /// Tunes the units to the plant, as an installer would.
    fn commission(&mut self, plant: &Plant, winches: &[[Option<Winch>; MOTORS]], current_limit_a: f64);

    /// Sets what a unit measures.
    fn measure(&mut self, unit: usize, readings: &Readings);

    /// What a unit gives a motor, in the direction in which its count rises.
    fn target(&self, unit: usize, motor: usize) -> MotorInput;

    /// Copies settings that a program has changed to the plant.
    ///
    /// # Errors
    /// The plant rejects them.
    fn apply_settings(&mut self, plant: &mut Plant, winches: &[[Option<Winch>; MOTORS]]) -> Result<(), BoxError>;

    /// The unit loses its supply for a while.
    fn reboot(&mut self, unit: usize, for_ns: u64);

    /// The unit's answers are dropped until then.
    fn mute_until(&mut self, unit: usize, until_ns: u64);

    /// These units, if they are RoboClaws.
    fn roboclaws(&self) -> &[roboclaw::unit::Unit] {
        &[]
    }
}
