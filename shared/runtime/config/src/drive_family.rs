//! Settings that each drive family accepts.

use crate::DriveProtocol;
use std::ops::RangeInclusive;

/// Accepted settings of a drive family.
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
}

/// The first family that there was.
impl Default for DriveProtocol {
    fn default() -> Self {
        DriveProtocol::Roboclaw
    }
}

impl DriveProtocol {
    /// Accepted settings of this family.
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
            },
        }
    }
}
