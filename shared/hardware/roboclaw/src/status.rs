//! Status of a unit (command 90), in one layout for every firmware.
//!
//! Old firmware answers with 16 bits, new firmware with 32, and the same bit means different things. [`Status`] always holds the
//! layout of new firmware, which has a place for everything old firmware can say.

use drives::DriveStatus;

/// Bits of the answer, decided by the firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StatusWidth {
    /// Old firmware: 16 bits.
    Narrow,
    /// New firmware: 32 bits.
    Wide,
}

impl StatusWidth {
    /// Bytes of the answer without its checksum.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            StatusWidth::Narrow => 2,
            StatusWidth::Wide => 4,
        }
    }
}

/// Conditions of a unit, in the layout of new firmware: errors in the low half, warnings in the high half.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Status(pub u32);

/// (bit of new firmware, bit of old firmware or 0, neutral bit)
const CONDITIONS: [(u32, u16, u32); 26] = [
    (Status::EMERGENCY_STOP, 0x0004, DriveStatus::EMERGENCY_STOP),
    (Status::TEMPERATURE_1, 0x0008, DriveStatus::OVERHEATED),
    (Status::TEMPERATURE_2, 0x0010, DriveStatus::MOTOR_OVERHEATED),
    (Status::MAIN_VOLTAGE_HIGH, 0x0020, DriveStatus::SUPPLY_HIGH),
    (Status::LOGIC_VOLTAGE_HIGH, 0x0040, DriveStatus::LOGIC_SUPPLY_HIGH),
    (Status::LOGIC_VOLTAGE_LOW, 0x0080, DriveStatus::LOGIC_SUPPLY_LOW),
    (Status::DRIVER_1, 0x0100, DriveStatus::STAGE_1),
    (Status::DRIVER_2, 0x0200, DriveStatus::STAGE_2),
    (Status::SPEED_1, 0, DriveStatus::SPEED_1),
    (Status::SPEED_2, 0, DriveStatus::SPEED_2),
    (Status::POSITION_1, 0, DriveStatus::POSITION_1),
    (Status::POSITION_2, 0, DriveStatus::POSITION_2),
    (Status::CURRENT_1, 0, DriveStatus::CURRENT_1),
    (Status::CURRENT_2, 0, DriveStatus::CURRENT_2),
    (Status::UNKNOWN_ERRORS, 0, DriveStatus::OTHER_ERROR),
    (Status::OVER_CURRENT_1, 0x0001, DriveStatus::OVER_CURRENT_1_WARNING),
    (Status::OVER_CURRENT_2, 0x0002, DriveStatus::OVER_CURRENT_2_WARNING),
    (Status::MAIN_VOLTAGE_HIGH_WARNING, 0x0400, DriveStatus::SUPPLY_HIGH_WARNING),
    (Status::MAIN_VOLTAGE_LOW_WARNING, 0x0800, DriveStatus::SUPPLY_LOW_WARNING),
    (Status::TEMPERATURE_1_WARNING, 0x1000, DriveStatus::HOT_WARNING),
    (Status::TEMPERATURE_2_WARNING, 0x2000, DriveStatus::MOTOR_HOT_WARNING),
    (Status::SIGNAL_S4, 0x4000, DriveStatus::INPUT_1),
    (Status::SIGNAL_S5, 0x8000, DriveStatus::INPUT_2),
    (Status::SPEED_LIMIT_WARNING, 0, DriveStatus::SPEED_LIMIT_WARNING),
    (Status::POSITION_LIMIT_WARNING, 0, DriveStatus::POSITION_LIMIT_WARNING),
    (Status::UNKNOWN_WARNINGS, 0, DriveStatus::OTHER_WARNING),
];

#[allow(missing_docs)] // the table above gives the neutral condition of each
impl Status {
    pub const EMERGENCY_STOP: u32 = 0x1;
    pub const TEMPERATURE_1: u32 = 0x2;
    pub const TEMPERATURE_2: u32 = 0x4;
    pub const MAIN_VOLTAGE_HIGH: u32 = 0x8;
    pub const LOGIC_VOLTAGE_HIGH: u32 = 0x10;
    pub const LOGIC_VOLTAGE_LOW: u32 = 0x20;
    pub const DRIVER_1: u32 = 0x40;
    pub const DRIVER_2: u32 = 0x80;
    pub const SPEED_1: u32 = 0x100;
    pub const SPEED_2: u32 = 0x200;
    pub const POSITION_1: u32 = 0x400;
    pub const POSITION_2: u32 = 0x800;
    pub const CURRENT_1: u32 = 0x1000;
    pub const CURRENT_2: u32 = 0x2000;
    pub const OVER_CURRENT_1: u32 = 0x1_0000;
    pub const OVER_CURRENT_2: u32 = 0x2_0000;
    pub const MAIN_VOLTAGE_HIGH_WARNING: u32 = 0x4_0000;
    pub const MAIN_VOLTAGE_LOW_WARNING: u32 = 0x8_0000;
    pub const TEMPERATURE_1_WARNING: u32 = 0x10_0000;
    pub const TEMPERATURE_2_WARNING: u32 = 0x20_0000;
    pub const SIGNAL_S4: u32 = 0x40_0000;
    pub const SIGNAL_S5: u32 = 0x80_0000;
    pub const SPEED_LIMIT_WARNING: u32 = 0x100_0000;
    pub const POSITION_LIMIT_WARNING: u32 = 0x200_0000;
    pub const UNKNOWN_ERRORS: u32 = 0xC000;
    pub const UNKNOWN_WARNINGS: u32 = 0xFC00_0000;
}

impl Status {
    /// The conditions that stop motors: everything in the low half.
    pub const ERRORS: u32 = 0xFFFF;

    /// From the 16 bits of old firmware.
    #[must_use]
    pub fn from_narrow(bits: u16) -> Status {
        Status(CONDITIONS.iter().filter(|(_, narrow, _)| bits & narrow != 0).fold(0, |all, (wide, _, _)| all | wide))
    }

    /// To the 16 bits of old firmware; conditions it does not know are left out.
    #[must_use]
    pub fn to_narrow(self) -> u16 {
        CONDITIONS.iter().filter(|(wide, _, _)| self.0 & wide != 0).fold(0, |all, (_, narrow, _)| all | narrow)
    }

    /// True where one of these bits is set.
    #[must_use]
    pub fn has(self, bits: u32) -> bool {
        self.0 & bits != 0
    }

    /// True where the unit itself has stopped, or soon will.
    #[must_use]
    pub fn is_error(self) -> bool {
        self.has(Status::ERRORS)
    }

    /// The same conditions in neutral bits.
    #[must_use]
    pub fn neutral(self) -> DriveStatus {
        DriveStatus(
            CONDITIONS.iter().filter(|(wide, _, _)| self.0 & wide != 0).fold(0, |all, (_, _, neutral)| all | neutral),
        )
    }
}
