//! Settings that each drive family accepts, and the time that it needs on the wire.

use std::ops::RangeInclusive;

crate::choice! {
    /// The drive families that motor-io has a driver for.
    pub enum DriveProtocol {
        /// RoboClaw packet serial.
        Roboclaw = "roboclaw",
    }
}

/// Properties of a drive family that configuration depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveFamily {
    /// Baud rates.
    pub bauds: &'static [u32],
    /// Addresses of units.
    pub addresses: RangeInclusive<u8>,
    /// The same in messages.
    pub addresses_in_words: &'static str,
    /// Shortest and longest watchdog time, s.
    pub watchdog_s: [f64; 2],
    /// Step of watchdog times, s.
    pub watchdog_step_s: f64,
    /// Bytes of one cycle on the wire for a unit, with answers.
    pub unit_bytes: f64,
    /// Exchanges of one cycle for a unit.
    pub unit_exchanges: f64,
    /// Bytes of the one slow reading of a cycle.
    pub slow_bytes: f64,
}

/// Cost of an exchange besides its bytes on a native serial port, s: unit and host together.
const TURNAROUND_S: f64 = 0.000_3;

impl DriveFamily {
    /// Time of one cycle on a native serial port with so many units, s.
    #[must_use]
    pub fn cycle_s(&self, units: usize, baud: u32) -> f64 {
        let units = units as f64;
        (units * self.unit_bytes + self.slow_bytes) * 10.0 / f64::from(baud)
            + (units * self.unit_exchanges + 1.0) * TURNAROUND_S
    }
}

/// The default is the family that was supported first.
impl Default for DriveProtocol {
    fn default() -> Self {
        DriveProtocol::Roboclaw
    }
}

impl DriveProtocol {
    /// Properties of this family.
    #[must_use]
    pub const fn family(self) -> DriveFamily {
        match self {
            DriveProtocol::Roboclaw => DriveFamily {
                // The rates that the units' set-up program offers.
                bauds: &[2400, 9600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800],
                addresses: 0x80..=0x87,
                addresses_in_words: "128 to 135 (0x80 to 0x87)",
                // A byte of tenths; 0 switches the watchdog off.
                watchdog_s: [0.1, 25.5],
                watchdog_step_s: 0.1,
                // Speeds, encoders, currents.
                unit_bytes: 13.0 + 12.0 + 8.0,
                unit_exchanges: 3.0,
                slow_bytes: 8.0,
            },
        }
    }
}
