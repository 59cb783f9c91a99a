//! Units of RoboClaw.

use plant::{MotorInput, Plant, SpeedGains};
use roboclaw::codec::{Motor, Pid, Write};
use roboclaw::unit::{Measured, Target, Unit, UnitBus, UnitOptions};
use roboclaw::{Packet, Status};
use serial::{Device, WireQueue};

use super::interface::{self, Readings, Twin, Winch};
use crate::BoxError;
use crate::settings::{PortConfig, UnitConfig};

/// One in the 16.16 fixed-point gains on the wire.
const FIXED_POINT: f64 = 65_536.0;

/// Share of the current limit from which a unit warns.
const WARN_AT: f64 = 0.95;

/// Least current limit, A, the resolution of the setting: with 0 a motor could not move.
const MIN_CURRENT_A: f64 = 0.01;

const MOTORS: [Motor; interface::MOTORS] = [Motor::One, Motor::Two];

/// The units of one port.
#[derive(Debug, Clone)]
pub(crate) struct RoboclawTwin {
    bus: UnitBus,
    /// Settings that the plant has, to detect changes by a program.
    applied: Vec<[(Pid, f64); 2]>,
}

impl RoboclawTwin {
    pub(crate) fn new(port: &PortConfig, turnaround_ns: u64) -> Self {
        let units = port.units.iter().map(|unit| unit_of(unit, turnaround_ns)).collect();
        Self { bus: UnitBus::new(units), applied: Vec::new() }
    }
}

impl Twin for RoboclawTwin {
    fn copy(&self) -> Box<dyn Twin> {
        Box::new(self.clone())
    }

    fn device(&mut self) -> &mut dyn Device {
        &mut self.bus
    }

    /// Tunes the units over the bus, and stores the settings in them.
    fn commission(&mut self, plant: &Plant, winches: &[[Option<Winch>; interface::MOTORS]], current_limit_a: f64) {
        let mut unread = WireQueue::new(0);
        let mut tell = |bus: &mut UnitBus, packet: Packet| {
            for &byte in packet.iter() {
                bus.receive(0, byte, &mut unread);
            }
        };
        for (unit, winches) in winches.iter().enumerate() {
            let address = self.bus.units()[unit].address();
            for (winch, motor) in winches.iter().zip(MOTORS) {
                let Some(winch) = winch else { continue };
                tell(&mut self.bus, Write::VelocityPid(motor, pid_of(plant.gains(winch.cable))).encode(address));
                let centiamps = (current_limit_a * 100.0).round() as u32;
                tell(&mut self.bus, Write::MaxCurrent(motor, centiamps).encode(address));
            }
            tell(&mut self.bus, Write::Save.encode(address));
        }
        let settings = |unit: &Unit| MOTORS.map(|motor| (unit.velocity_pid(motor), unit.max_current_a(motor)));
        self.applied = self.bus.units().iter().map(settings).collect();
    }

    fn measure(&mut self, unit: usize, readings: &Readings) {
        let mut measured = Measured {
            counts: readings.counts,
            speeds_counts_s: readings.speeds_counts_s,
            currents_a: readings.currents_a,
            duties: readings.duties,
            supply_v: readings.supply_v,
            temperature_c: readings.temperature_c,
            ..Measured::default()
        };
        if readings.stopped {
            measured.status.0 |= Status::EMERGENCY_STOP;
        }
        for (motor, current_a) in readings.currents_a.into_iter().enumerate() {
            let limit_a = self.applied[unit][motor].1;
            if current_a.abs() > WARN_AT * limit_a {
                measured.status.0 |= [Status::OVER_CURRENT_1, Status::OVER_CURRENT_2][motor];
            }
        }
        self.bus.measure(unit, &measured);
    }

    fn target(&self, unit: usize, motor: usize) -> MotorInput {
        match self.bus.units()[unit].target(MOTORS[motor]) {
            Target::Speed(speed) => MotorInput::Speed(speed),
            Target::Duty(duty) => MotorInput::Duty(duty),
        }
    }

    fn apply_settings(
        &mut self,
        plant: &mut Plant,
        winches: &[[Option<Winch>; interface::MOTORS]],
    ) -> Result<(), BoxError> {
        for ((unit, winches), applied) in self.bus.units().iter().zip(winches).zip(&mut self.applied) {
            for (winch, motor) in winches.iter().zip(MOTORS) {
                let Some(Winch { cable, .. }) = *winch else { continue };
                let settings = (unit.velocity_pid(motor), unit.max_current_a(motor));
                if settings != applied[motor.index()] {
                    applied[motor.index()] = settings;
                    plant.set_gains(cable, gains_of(settings.0))?;
                    plant.set_current_limit(cable, settings.1.max(MIN_CURRENT_A))?;
                }
            }
        }
        Ok(())
    }

    fn reboot(&mut self, unit: usize, for_ns: u64) {
        if let Some(unit) = self.bus.units_mut().get_mut(unit) {
            unit.reboot(for_ns);
        }
    }

    fn mute_until(&mut self, unit: usize, until_ns: u64) {
        if let Some(unit) = self.bus.units_mut().get_mut(unit) {
            unit.mute_until(until_ns);
        }
    }

    fn roboclaws(&self) -> &[Unit] {
        self.bus.units()
    }
}

fn unit_of(config: &UnitConfig, turnaround_ns: u64) -> Unit {
    Unit::new(UnitOptions { turnaround_ns, ..UnitOptions::new(config.address) })
}

fn pid_of(gains: SpeedGains) -> Pid {
    let fixed = |gain: f64| (gain * FIXED_POINT).round() as u32;
    Pid {
        p: fixed(gains.p),
        i: fixed(gains.i),
        d: fixed(gains.d),
        counts_s_at_full_duty: gains.full_speed_counts_s.round() as u32,
    }
}

fn gains_of(pid: Pid) -> SpeedGains {
    SpeedGains {
        p: f64::from(pid.p) / FIXED_POINT,
        i: f64::from(pid.i) / FIXED_POINT,
        d: f64::from(pid.d) / FIXED_POINT,
        // A unit accepts any number; 0 would divide by zero.
        full_speed_counts_s: f64::from(pid.counts_s_at_full_duty.max(1)),
    }
}
