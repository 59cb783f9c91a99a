//! Answers to questions.

use super::Controller;
use crate::codec::{Answer, COUNTS_PER_PULSE, FULL_SPEED, Name, Numbers, fault, numbers};

/// Internal voltage, V times ten, and 5 V output, mV.
const INTERNAL: [i32; 2] = [135, 4980];

/// Bits of `?FS`: motors without power, a motor that stands.
const POWER_OFF: i32 = 8;

impl Controller {
    /// The answer to a question; `None` for one that the controller does not have.
    pub(super) fn read(&self, name: Name, channel: Option<u8>) -> Option<Answer<'static>> {
        let measured = &self.measured;
        let tenths = |value: f64| (value * 10.0).round() as i32;
        let thousandths = |value: f64| (value * f64::from(FULL_SPEED)).round() as i32;
        let rpm = |motor: usize| {
            let turns_s = measured.speeds_counts_s[motor] / (f64::from(self.settings.pulses[motor]) * COUNTS_PER_PULSE);
            (turns_s * 60.0).round() as i32
        };
        // The counters have 32 bits and wrap.
        let counts = |motor: usize| (measured.counts[motor] - self.zeros[motor]) as i32;
        let applied = if self.expired { [0; 2] } else { self.commands };
        let values: Numbers = match name {
            Name::Firmware => return Some(Answer::Text(name, self.options.firmware)),
            Name::Model => return Some(Answer::Text(name, self.options.model)),
            Name::Variable => {
                let variable = usize::from(channel?).checked_sub(1)?;
                return Some(Answer::Numbers(name, numbers(&[*self.variables.get(variable)?])));
            }
            Name::Amps => numbers(&measured.currents_a.map(tenths)),
            Name::Counts => numbers(&[counts(0), counts(1)]),
            Name::Command => numbers(&self.commands),
            Name::Faults => numbers(&[self.faults.cast_signed()]),
            Name::MotorFaults => numbers(&self.motor_faults.map(u32::cast_signed)),
            Name::Status => numbers(&[if self.faults & fault::EMERGENCY_STOP != 0 { POWER_OFF } else { 0 }]),
            Name::Applied => numbers(&applied),
            Name::Power => numbers(&measured.duties.map(thousandths)),
            Name::Speed => numbers(&[rpm(0), rpm(1)]),
            Name::Volts => numbers(&[INTERNAL[0], tenths(measured.supply_v), INTERNAL[1]]),
            Name::Watchdog => numbers(&[self.settings.watchdog_ms.cast_signed()]),
            Name::Mode => numbers(&self.settings.modes),
            Name::MaxRpm => numbers(&self.settings.max_rpm),
            Name::Pulses => numbers(&self.settings.pulses),
            Name::EchoOff => numbers(&[i32::from(!self.settings.echo)]),
        };
        let Some(channel) = channel else { return Some(Answer::Numbers(name, values)) };
        let value = *values.get(usize::from(channel).checked_sub(1)?)?;
        Some(Answer::Numbers(name, numbers(&[value])))
    }
}
