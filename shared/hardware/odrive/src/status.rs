//! Errors of the axes in neutral bits.

use drives::DriveStatus;

use crate::codec::error;

/// (bit of an axis' error word, neutral bit of axis 0, of axis 1)
const CONDITIONS: [(u32, u32, u32); 5] = [
    (error::MOTOR, DriveStatus::STAGE_1, DriveStatus::STAGE_2),
    (error::ENCODER, DriveStatus::ENCODER_1, DriveStatus::ENCODER_2),
    (error::CONTROLLER, DriveStatus::SPEED_1, DriveStatus::SPEED_2),
    (error::WATCHDOG, DriveStatus::WATCHDOG, DriveStatus::WATCHDOG),
    (error::EMERGENCY_STOP, DriveStatus::EMERGENCY_STOP, DriveStatus::EMERGENCY_STOP),
];

/// Conditions of a board with these error words of its axes.
#[must_use]
pub fn neutral(errors: [u32; 2]) -> DriveStatus {
    let named = CONDITIONS.iter().fold(0, |all, (bit, _, _)| all | bit);
    let axis = |axis: usize| {
        let other = if errors[axis] & !named != 0 { DriveStatus::OTHER_ERROR } else { 0 };
        CONDITIONS
            .iter()
            .filter(|(bit, _, _)| errors[axis] & bit != 0)
            .fold(other, |all, (_, one, two)| all | [one, two][axis])
    };
    DriveStatus(axis(0) | axis(1))
}
