//! Controllers of Roboteq.

use plant::{MotorInput, Plant};
use roboteq::codec::COUNTS_PER_PULSE;
use roboteq::unit::{Controller, ControllerOptions, Measured, Target};
use serial::{Device, WireQueue};

use super::interface::{MOTORS, Readings, Twin, Winch};
use crate::BoxError;
use crate::settings::PortConfig;

/// Pulses of an encoder per turn.
const PULSES: i32 = 256;

/// The controller of one port.
#[derive(Debug, Clone)]
pub(crate) struct RoboteqTwin(Vec<Controller>);

impl RoboteqTwin {
    pub(crate) fn new(port: &PortConfig, turnaround_ns: u64) -> Self {
        let controller =
            |address| Controller::new(ControllerOptions { turnaround_ns, ..ControllerOptions::new(address) });
        // One at most: the protocol has no addresses.
        Self(port.units.iter().take(1).map(|config| controller(config.address)).collect())
    }
}

impl Device for RoboteqTwin {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.0.iter_mut().for_each(|controller| controller.receive(now_ns, byte, reply));
    }

    fn advance(&mut self, now_ns: u64) {
        self.0.iter_mut().for_each(|controller| controller.advance(now_ns));
    }
}

impl Twin for RoboteqTwin {
    fn copy(&self) -> Box<dyn Twin> {
        Box::new(self.clone())
    }

    fn device(&mut self) -> &mut dyn Device {
        self
    }

    /// Sets the encoders and the speeds of full commands. The loops of a tuned controller follow; their gains are none
    /// of the wire's.
    fn commission(&mut self, plant: &Plant, winches: &[[Option<Winch>; MOTORS]], _: f64) {
        for (controller, winches) in self.0.iter_mut().zip(winches) {
            for (motor, winch) in winches.iter().enumerate() {
                let Some(winch) = winch else { continue };
                let turns_s = plant.gains(winch.cable).full_speed_counts_s / (f64::from(PULSES) * COUNTS_PER_PULSE);
                let settings = controller.settings_mut();
                (settings.pulses[motor], settings.max_rpm[motor]) = (PULSES, (turns_s * 60.0).ceil().max(1.0) as i32);
            }
            controller.save();
        }
    }

    fn measure(&mut self, unit: usize, readings: &Readings) {
        let measured = Measured {
            counts: readings.counts,
            speeds_counts_s: readings.speeds_counts_s,
            currents_a: readings.currents_a,
            duties: readings.duties,
            supply_v: readings.supply_v,
            stopped: readings.stopped,
        };
        if let Some(controller) = self.0.get_mut(unit) {
            controller.measure(&measured);
        }
    }

    fn target(&self, unit: usize, motor: usize) -> MotorInput {
        match self.0.get(unit).map(|controller| controller.target(motor)) {
            Some(Target::Velocity(counts_s)) => MotorInput::Speed(counts_s),
            Some(Target::Duty(share)) => MotorInput::Duty(share),
            Some(Target::Released) | None => MotorInput::RELEASED,
        }
    }

    fn apply_settings(&mut self, _: &mut Plant, _: &[[Option<Winch>; MOTORS]]) -> Result<(), BoxError> {
        Ok(())
    }

    fn reboot(&mut self, unit: usize, for_ns: u64) {
        if let Some(controller) = self.0.get_mut(unit) {
            controller.reboot(for_ns);
        }
    }

    fn mute_until(&mut self, unit: usize, until_ns: u64) {
        if let Some(controller) = self.0.get_mut(unit) {
            controller.mute_until(until_ns);
        }
    }
}
