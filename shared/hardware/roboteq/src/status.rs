//! Flags of a controller in neutral bits.

use drives::DriveStatus;

use crate::codec::{AXES, fault, motor_fault};

/// (bit of `?FF`, neutral bits)
const FAULTS: [(u32, u32); 8] = [
    (fault::OVERHEAT, DriveStatus::OVERHEATED),
    (fault::OVER_VOLTAGE, DriveStatus::SUPPLY_HIGH),
    (fault::UNDER_VOLTAGE, DriveStatus::SUPPLY_LOW),
    // It does not say of which motor.
    (fault::SHORT, DriveStatus::STAGE_1 | DriveStatus::STAGE_2),
    (fault::EMERGENCY_STOP, DriveStatus::EMERGENCY_STOP),
    (fault::SENSOR, DriveStatus::OTHER_ERROR),
    (fault::MOSFET, DriveStatus::STAGE_1 | DriveStatus::STAGE_2),
    (fault::DEFAULT_SETTINGS, DriveStatus::OTHER_ERROR),
];

/// (bit of `?FM`, neutral bit of motor 1, of motor 2)
const MOTOR_FAULTS: [(u32, u32, u32); 7] = [
    (motor_fault::AMPS_LIMIT, DriveStatus::OVER_CURRENT_1_WARNING, DriveStatus::OVER_CURRENT_2_WARNING),
    (motor_fault::STALL, DriveStatus::SPEED_1, DriveStatus::SPEED_2),
    (motor_fault::LOOP_ERROR, DriveStatus::SPEED_1, DriveStatus::SPEED_2),
    (motor_fault::SAFETY_STOP, DriveStatus::OTHER_ERROR, DriveStatus::OTHER_ERROR),
    (motor_fault::FORWARD_LIMIT, DriveStatus::POSITION_LIMIT_WARNING, DriveStatus::POSITION_LIMIT_WARNING),
    (motor_fault::REVERSE_LIMIT, DriveStatus::POSITION_LIMIT_WARNING, DriveStatus::POSITION_LIMIT_WARNING),
    (motor_fault::AMPS_TRIGGER, DriveStatus::CURRENT_1, DriveStatus::CURRENT_2),
];

/// Conditions of a controller with these flags of its own and of its motors.
#[must_use]
pub fn neutral(faults: u32, motors: [u32; AXES]) -> DriveStatus {
    let mut all = 0;
    let mut named = 0;
    for (bit, neutral) in FAULTS {
        named |= bit;
        all |= if faults & bit != 0 { neutral } else { 0 };
    }
    for (bit, one, two) in MOTOR_FAULTS {
        all |= if motors[0] & bit != 0 { one } else { 0 };
        all |= if motors[1] & bit != 0 { two } else { 0 };
    }
    DriveStatus(if faults & !named != 0 { all | DriveStatus::OTHER_ERROR } else { all })
}
