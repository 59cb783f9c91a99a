//! Conditions of a drive unit, in one layout for every family.

use std::fmt;

/// Conditions of a unit as bits. These are the values of `status` in `motor/state` and `motor/input`, so a bit never changes its meaning.
///
/// Bits 0 to 15 and 26 to 28 are errors, at which a drive stops or soon will; the others are warnings and inputs. The layout is a
/// superset of that of the first supported family: in run files recorded before other families existed the bits mean the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DriveStatus(pub u32);

const CONDITIONS: [(u32, &str); 29] = [
    (DriveStatus::EMERGENCY_STOP, "emergency stop"),
    (DriveStatus::OVERHEATED, "board too hot"),
    (DriveStatus::MOTOR_OVERHEATED, "motor or second temperature sensor too hot"),
    (DriveStatus::SUPPLY_HIGH, "main supply too high"),
    (DriveStatus::LOGIC_SUPPLY_HIGH, "logic supply too high"),
    (DriveStatus::LOGIC_SUPPLY_LOW, "logic supply too low"),
    (DriveStatus::STAGE_1, "motor 1 driver fault"),
    (DriveStatus::STAGE_2, "motor 2 driver fault"),
    (DriveStatus::SPEED_1, "motor 1 does not follow its speed"),
    (DriveStatus::SPEED_2, "motor 2 does not follow its speed"),
    (DriveStatus::POSITION_1, "motor 1 does not follow its position"),
    (DriveStatus::POSITION_2, "motor 2 does not follow its position"),
    (DriveStatus::CURRENT_1, "motor 1 current error"),
    (DriveStatus::CURRENT_2, "motor 2 current error"),
    (DriveStatus::SUPPLY_LOW, "main supply too low"),
    (DriveStatus::OTHER_ERROR, "another error"),
    (DriveStatus::OVER_CURRENT_1_WARNING, "motor 1 over-current warning"),
    (DriveStatus::OVER_CURRENT_2_WARNING, "motor 2 over-current warning"),
    (DriveStatus::SUPPLY_HIGH_WARNING, "main supply high"),
    (DriveStatus::SUPPLY_LOW_WARNING, "main supply low"),
    (DriveStatus::HOT_WARNING, "board hot"),
    (DriveStatus::MOTOR_HOT_WARNING, "motor or second temperature sensor hot"),
    (DriveStatus::INPUT_1, "auxiliary input 1 active"),
    (DriveStatus::INPUT_2, "auxiliary input 2 active"),
    (DriveStatus::SPEED_LIMIT_WARNING, "speed limit reached"),
    (DriveStatus::POSITION_LIMIT_WARNING, "position limit reached"),
    (DriveStatus::ENCODER_1, "motor 1 encoder failed"),
    (DriveStatus::ENCODER_2, "motor 2 encoder failed"),
    (DriveStatus::WATCHDOG, "watchdog expired"),
];

#[allow(missing_docs)] // the table above has the words
impl DriveStatus {
    pub const EMERGENCY_STOP: u32 = 1 << 0;
    pub const OVERHEATED: u32 = 1 << 1;
    pub const MOTOR_OVERHEATED: u32 = 1 << 2;
    pub const SUPPLY_HIGH: u32 = 1 << 3;
    pub const LOGIC_SUPPLY_HIGH: u32 = 1 << 4;
    pub const LOGIC_SUPPLY_LOW: u32 = 1 << 5;
    pub const STAGE_1: u32 = 1 << 6;
    pub const STAGE_2: u32 = 1 << 7;
    pub const SPEED_1: u32 = 1 << 8;
    pub const SPEED_2: u32 = 1 << 9;
    pub const POSITION_1: u32 = 1 << 10;
    pub const POSITION_2: u32 = 1 << 11;
    pub const CURRENT_1: u32 = 1 << 12;
    pub const CURRENT_2: u32 = 1 << 13;
    pub const SUPPLY_LOW: u32 = 1 << 14;
    /// An error that has no bit of its own; the native status has it.
    pub const OTHER_ERROR: u32 = 1 << 15;
    pub const OVER_CURRENT_1_WARNING: u32 = 1 << 16;
    pub const OVER_CURRENT_2_WARNING: u32 = 1 << 17;
    pub const SUPPLY_HIGH_WARNING: u32 = 1 << 18;
    pub const SUPPLY_LOW_WARNING: u32 = 1 << 19;
    pub const HOT_WARNING: u32 = 1 << 20;
    pub const MOTOR_HOT_WARNING: u32 = 1 << 21;
    pub const INPUT_1: u32 = 1 << 22;
    pub const INPUT_2: u32 = 1 << 23;
    pub const SPEED_LIMIT_WARNING: u32 = 1 << 24;
    pub const POSITION_LIMIT_WARNING: u32 = 1 << 25;
    pub const ENCODER_1: u32 = 1 << 26;
    pub const ENCODER_2: u32 = 1 << 27;
    pub const WATCHDOG: u32 = 1 << 28;
    /// A warning that has no bit of its own; the native status has it.
    pub const OTHER_WARNING: u32 = 1 << 31;
}

impl DriveStatus {
    /// Conditions at which a drive stops its motors or soon will.
    pub const ERRORS: u32 = 0xFFFF | DriveStatus::ENCODER_1 | DriveStatus::ENCODER_2 | DriveStatus::WATCHDOG;

    /// True where one of these bits is set.
    #[must_use]
    pub const fn has(self, bits: u32) -> bool {
        self.0 & bits != 0
    }

    /// The conditions that stop motors, without the others.
    #[must_use]
    pub const fn errors(self) -> DriveStatus {
        DriveStatus(self.0 & DriveStatus::ERRORS)
    }

    /// The conditions in words.
    pub fn conditions(self) -> impl Iterator<Item = &'static str> {
        let named = CONDITIONS.iter().fold(0, |all, (bit, _)| all | bit);
        let other = (self.0 & !named != 0).then_some("another warning");
        CONDITIONS.iter().filter(move |(bit, _)| self.0 & bit != 0).map(|&(_, words)| words).chain(other)
    }
}

impl fmt::Display for DriveStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0 {
            return f.write_str("in order");
        }
        for (index, words) in self.conditions().enumerate() {
            write!(f, "{}{words}", if index == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}
