//! Units of moteus.

use config::Wire;
use moteus::codec::Checksums;
use moteus::unit::{Measured, Target, Unit, UnitBus, UnitOptions};
use plant::{MotorInput, Plant};
use serial::Device;

use super::interface::{MOTORS, Readings, Twin, Winch};
use crate::BoxError;
use crate::settings::{PortConfig, UnitConfig};

/// The units of one port.
#[derive(Debug, Clone)]
pub(crate) struct MoteusTwin(UnitBus);

impl MoteusTwin {
    pub(crate) fn new(port: &PortConfig, turnaround_ns: u64) -> Self {
        let unit = |config: &UnitConfig| {
            let options = UnitOptions::new(config.address);
            let second_source = config.second_encoder.unwrap_or(options.second_source);
            let torque_constant_n_m_a = port.torque_constant_n_m_a.unwrap_or(options.torque_constant_n_m_a);
            Unit::new(UnitOptions { turnaround_ns, second_source, torque_constant_n_m_a, ..options })
        };
        let units = port.units.iter().map(unit).collect();
        let checksums = if port.wire == Wire::Usb { Checksums::Absent } else { Checksums::Required };
        Self(UnitBus::new(units, checksums))
    }
}

impl Twin for MoteusTwin {
    fn copy(&self) -> Box<dyn Twin> {
        Box::new(self.clone())
    }

    fn device(&mut self) -> &mut dyn Device {
        &mut self.0
    }

    /// The loops of a calibrated unit follow; their gains are none of the wire's.
    fn commission(&mut self, _: &Plant, _: &[[Option<Winch>; MOTORS]], _: f64) {}

    fn measure(&mut self, unit: usize, readings: &Readings) {
        let measured = Measured {
            counts: readings.counts[0],
            second_counts: readings.second_counts[0],
            second_fails: false,
            speed_counts_s: readings.speeds_counts_s[0],
            current_a: readings.currents_a[0],
            duty: readings.duties[0],
            supply_v: readings.supply_v,
            temperature_c: readings.temperature_c,
            pins: i8::from(readings.stopped),
        };
        self.0.measure(unit, &measured);
    }

    fn target(&self, unit: usize, _: usize) -> MotorInput {
        match self.0.units().get(unit).map(Unit::target) {
            Some(Target::Velocity(counts_s)) => MotorInput::Speed(counts_s),
            Some(Target::Current(current_a)) => MotorInput::Current(current_a),
            Some(Target::Released) | None => MotorInput::RELEASED,
        }
    }

    fn apply_settings(&mut self, _: &mut Plant, _: &[[Option<Winch>; MOTORS]]) -> Result<(), BoxError> {
        Ok(())
    }

    fn reboot(&mut self, unit: usize, for_ns: u64) {
        if let Some(unit) = self.0.units_mut().get_mut(unit) {
            unit.reboot(for_ns);
        }
    }

    fn mute_until(&mut self, unit: usize, until_ns: u64) {
        if let Some(unit) = self.0.units_mut().get_mut(unit) {
            unit.mute_until(until_ns);
        }
    }
}
