//! Mode, fault code and pins of a unit in neutral bits.

use drives::DriveStatus;

use crate::codec::Mode;

/// Pin 1 of the second auxiliary port, as an input: the closed contact of a stop button holds it low.
pub const STOP_PIN: i32 = 1;

/// (code of the maker's reference, neutral bit) of what stops the motor.
const FAULTS: [(i32, u32); 11] = [
    (32, DriveStatus::ENCODER_1),
    (33, DriveStatus::STAGE_1),
    (34, DriveStatus::SUPPLY_HIGH),
    (35, DriveStatus::ENCODER_1),
    (38, DriveStatus::OVERHEATED),
    (39, DriveStatus::POSITION_1),
    (40, DriveStatus::SUPPLY_LOW),
    (42, DriveStatus::ENCODER_1),
    (43, DriveStatus::ENCODER_1),
    (44, DriveStatus::STAGE_1),
    (48, DriveStatus::POSITION_1),
];

/// The same of what limits a motor that turns on.
const LIMITS: [(i32, u32); 8] = [
    (96, DriveStatus::SPEED_LIMIT_WARNING),
    (97, DriveStatus::OVER_CURRENT_1_WARNING),
    (98, DriveStatus::SUPPLY_HIGH_WARNING),
    (99, DriveStatus::OVER_CURRENT_1_WARNING),
    (100, DriveStatus::HOT_WARNING),
    (101, DriveStatus::MOTOR_HOT_WARNING),
    (102, DriveStatus::OVER_CURRENT_1_WARNING),
    (103, DriveStatus::POSITION_LIMIT_WARNING),
];

/// Conditions of a unit.
#[must_use]
pub fn neutral(mode: Mode, code: i32, pins: i32) -> DriveStatus {
    let named = |table: &[(i32, u32)], other| {
        table.iter().find(|(number, _)| *number == code).map_or(other, |&(_, neutral)| neutral)
    };
    let stop = if pins & STOP_PIN != 0 { DriveStatus::EMERGENCY_STOP } else { 0 };
    let condition = match mode {
        Mode::FAULT => named(&FAULTS, DriveStatus::OTHER_ERROR),
        Mode::TIMEOUT => DriveStatus::WATCHDOG,
        _ if code == 0 => 0,
        // A code that is left over from a fault which a stop has cleared.
        _ if code < 96 => 0,
        _ => named(&LIMITS, DriveStatus::OTHER_WARNING),
    };
    DriveStatus(stop | condition)
}

/// The same as the unit states it, for the log: mode, code and pins in one byte each.
#[must_use]
pub fn native(mode: Mode, code: i32, pins: i32) -> u32 {
    u32::from(mode.0.cast_unsigned()) | (code as u32 & 0xFF) << 8 | (pins as u32 & 0xFF) << 16
}
