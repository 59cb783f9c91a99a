//! What a drive unit says of itself at the start, as one text line of motor-io's log.

use serde::Serialize;
use std::fmt;

/// A drive unit as it answered when it was set up.
///
/// ```
/// use robot_state::DriveUnit;
/// let [port, name, firmware] = ["/dev/ttyACM0", "unit 0x80", "v4.2.4"].map(str::to_owned);
/// let unit = DriveUnit { port, name, firmware, watchdog_ms: 100 };
/// assert_eq!(DriveUnit::from_log(&unit.to_string()), Some(unit));
/// assert_eq!(DriveUnit::from_log("/dev/ttyACM0, unit 0x80: no answer"), None);
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct DriveUnit {
    /// Serial port.
    pub port: String,
    /// Name of the unit on its port.
    pub name: String,
    /// Firmware, in the words of the unit.
    pub firmware: String,
    /// Time without a command after which it stops its motors, ms; 0: unknown.
    pub watchdog_ms: u64,
}

const FIRMWARE: &str = ": firmware ";
const WATCHDOG: &str = ", watchdog ";
const UNIT: &str = " ms";

impl fmt::Display for DriveUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { port, name, firmware, watchdog_ms } = self;
        write!(f, "{port}, {name}{FIRMWARE}{firmware}{WATCHDOG}{watchdog_ms}{UNIT}")
    }
}

impl DriveUnit {
    /// Reads the line of the log; `None` for other lines.
    #[must_use]
    pub fn from_log(line: &str) -> Option<Self> {
        let (place, said) = line.split_once(FIRMWARE)?;
        let (port, name) = place.rsplit_once(", ")?;
        let (firmware, watchdog) = said.rsplit_once(WATCHDOG)?;
        let watchdog_ms = watchdog.strip_suffix(UNIT)?.parse().ok()?;
        Some(Self { port: port.into(), name: name.into(), firmware: firmware.into(), watchdog_ms })
    }
}
