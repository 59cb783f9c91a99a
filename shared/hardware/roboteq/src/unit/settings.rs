//! Properties and settings of a virtual controller.

use crate::codec::{AXES, Name, mode};

/// Watchdog of the factory, ms.
const FACTORY_WATCHDOG_MS: u32 = 1000;
/// Longest watchdog time, ms.
const MAX_WATCHDOG_MS: i32 = 65_000;
/// Operating modes: open loop to speed by position.
const MODES: i32 = 6;

/// Properties of a virtual controller, with the settings that are saved in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerOptions {
    /// Name for faults; the protocol has no address.
    pub address: u8,
    /// Firmware as `?FID` states it.
    pub firmware: &'static str,
    /// Control unit and model as `?TRN` states them.
    pub model: &'static str,
    /// Saved operating modes.
    pub modes: [i32; AXES],
    /// Saved speed of a command of 1000, turns per minute.
    pub max_rpm: [i32; AXES],
    /// Saved pulses of the encoders per turn.
    pub pulses: [i32; AXES],
    /// Time from a line's last byte to the first of the answer, ns.
    pub turnaround_ns: u64,
}

impl ControllerOptions {
    /// A controller whose motors are in closed-loop speed mode.
    #[must_use]
    pub fn new(address: u8) -> ControllerOptions {
        ControllerOptions {
            address,
            firmware: "Roboteq v1.6 RCB500 05/01/2016",
            model: "RCB500:HDC2460",
            modes: [mode::CLOSED_SPEED; AXES],
            max_rpm: [3000; AXES],
            pulses: [500; AXES],
            // Assumed; it is not published.
            turnaround_ns: 150_000,
        }
    }
}

/// Settings of a virtual controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// Received bytes are sent back.
    pub echo: bool,
    /// Time without a command after which the motors stop, ms; 0: never.
    pub watchdog_ms: u32,
    /// Operating modes.
    pub modes: [i32; AXES],
    /// Speed of a command of 1000, turns per minute.
    pub max_rpm: [i32; AXES],
    /// Pulses of the encoders per turn.
    pub pulses: [i32; AXES],
}

impl Settings {
    /// The settings after a start.
    pub(super) fn of(options: &ControllerOptions) -> Settings {
        Settings {
            echo: true,
            watchdog_ms: FACTORY_WATCHDOG_MS,
            modes: options.modes,
            max_rpm: options.max_rpm,
            pulses: options.pulses,
        }
    }

    /// Sets a setting; `None` for one that cannot be set so.
    pub(super) fn set(
        &mut self,
        name: Name,
        channel: Option<u8>,
        value: i32,
        kept_watchdog_ms: Option<u32>,
    ) -> Option<()> {
        let of_channel = |places: &mut [i32; AXES]| {
            let place = places.get_mut(usize::from(channel?).checked_sub(1)?)?;
            *place = value;
            Some(())
        };
        match (name, channel) {
            (Name::EchoOff, None) if (0..=1).contains(&value) => self.echo = value == 0,
            (Name::Watchdog, None) if (0..=MAX_WATCHDOG_MS).contains(&value) => {
                self.watchdog_ms = kept_watchdog_ms.unwrap_or(value.unsigned_abs());
            }
            (Name::Mode, Some(_)) if (0..=MODES).contains(&value) => return of_channel(&mut self.modes),
            (Name::MaxRpm, Some(_)) if value > 0 => return of_channel(&mut self.max_rpm),
            (Name::Pulses, Some(_)) if value > 0 => return of_channel(&mut self.pulses),
            _ => return None,
        }
        Some(())
    }
}
