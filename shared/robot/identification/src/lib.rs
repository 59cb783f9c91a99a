//! Drives, motors and load of a robot, from a record of commands, encoders, currents and duties in flight.
//!
//! Smooth motion determines the sum of delay and lag of a drive well and their split badly: the speed loop behind the
//! lag bends the response by the same amount as a different split. The speed loop is therefore measured first, in
//! three steps that are linear in their unknowns, over windows of a tenth of a second:
//!
//! 1. `supply duty = resistance current + force constant velocity` gives the motor's constants;
//! 2. `force constant current = inertia acceleration + load + friction`, with load and friction in proportion to the
//!    tensions of the robot's model, gives inertia, friction, and the share of the modelled load that truly hangs;
//! 3. `duty = .. + g (commanded - measured length)` gives the integral gain `g` of the loop, and with the above its
//!    frequency `w² = force constant supply g / (resistance inertia)`.
//!
//! Delay and lag then follow from the lengths by least squares, with the loop `(2 w s + w²) / (s + w)²` behind them.
//!
//! Standard deviations are those of a jackknife over parts of the record, which includes that neighbouring residuals
//! are alike, and what simple models leave out ([`MODEL`]).
//!
//! Invariants: no I/O, no clock; the same record gives the same numbers.
#![forbid(unsafe_code)]

mod drive;
mod linear;
mod motor;
mod record;
mod response;
mod value;

pub use drive::{Drive, MODEL, ModelError};
pub use motor::Motor;
pub use record::{IdentifyError, LEAST_CYCLES, MOVING_M_S, Record};
pub use value::Value;

/// What a record says of one cable.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// Delay and lag.
    pub drive: Drive,
    /// Motor, load and friction; `None` if currents, duties or the supply were not recorded.
    pub motor: Option<Motor>,
}

/// Identifies drive and motor of one cable.
///
/// # Errors
/// The record is too short, is not finite, or has too little motion.
pub fn identify(record: &Record) -> Result<Identified, IdentifyError> {
    record.check()?;
    let rough = drive::fit(record, None)?;
    let motor = motor::fit(record, &rough);
    let frequency = motor.as_ref().and_then(|found| found.loop_rad_s.as_ref());
    let drive = match frequency {
        Some(frequency) => drive::fit(record, Some(frequency))?,
        None => rough,
    };
    Ok(Identified { drive: drive.drive, motor: motor.map(|found| found.motor) })
}
