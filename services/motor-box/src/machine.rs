//! Drive units and the physics they turn, without a clock.

use plant::{MotorInput, Plant, SpeedGains};
use roboclaw::codec::{Motor, Pid, Write};
use roboclaw::unit::{Measured, Target, Unit, UnitBus, UnitOptions};
use roboclaw::{Packet, Status};
use serial::{Device, WireQueue};

use crate::BoxError;
use crate::fault::BoxFault;
use crate::settings::{BoxConfig, UnitConfig};

/// Longest time for which the drives keep one target, ns: ramps and watchdogs are evaluated this often.
const STEP_NS: u64 = 5_000_000;

/// One in the 16.16 fixed-point gains on the wire.
const FIXED_POINT: f64 = 65_536.0;

/// Share of the current limit from which a unit warns.
const WARN_AT: f64 = 0.95;

/// Least current limit, A, the resolution of the setting: with 0 a motor could not move.
const MIN_CURRENT_A: f64 = 0.01;

const MOTORS: [Motor; 2] = [Motor::One, Motor::Two];

/// Board temperature, degrees Celsius: a closed box on a mild day.
const BOARD_C: f64 = 31.0;

/// Winch of a motor.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Winch {
    cable: usize,
    /// -1 where the count falls as cable pays out.
    sign: f64,
}

/// Units on one serial port.
#[derive(Debug, Clone)]
struct Bank {
    bus: UnitBus,
    winches: Vec<[Option<Winch>; 2]>,
    /// State of each unit's stop button; true: pressed.
    stopped: Vec<bool>,
    /// Settings that the plant has, to detect changes by a program.
    applied: Vec<[(Pid, f64); 2]>,
}

/// All units of the box and the plant; time is an argument.
///
/// The machine carries the units' targets to the plant and the plant's readings to the units; neither depends on the
/// other.
#[derive(Debug, Clone)]
pub struct Machine {
    plant: Plant,
    banks: Vec<Bank>,
    inputs: Vec<MotorInput>,
    now_ns: u64,
}

impl Machine {
    /// Creates a machine at rest at time 0, motors released, the speed loops tuned to motors and encoders.
    ///
    /// # Errors
    /// The plant rejects its configuration.
    pub fn new(config: &BoxConfig) -> Result<Self, BoxError> {
        let plant = Plant::new(config.plant.clone())?;
        let inputs = vec![MotorInput::RELEASED; plant.cable_count()];
        let banks = config
            .ports
            .iter()
            .map(|port| {
                let winches: Vec<[Option<Winch>; 2]> = port
                    .units
                    .iter()
                    .map(|unit| {
                        unit.cables.map(|cable| {
                            cable.map(|cable| Winch { cable, sign: if config.reversed[cable] { -1.0 } else { 1.0 } })
                        })
                    })
                    .collect();
                let units = port.units.iter().map(|unit| unit_of(unit, config.turnaround_ns)).collect();
                let stopped = vec![false; port.units.len()];
                let mut bank = Bank { bus: UnitBus::new(units), applied: Vec::new(), winches, stopped };
                bank.commission(&plant, config.plant.motor.current_limit_a);
                bank
            })
            .collect();
        let mut machine = Self { plant, banks, inputs, now_ns: 0 };
        machine.measure();
        machine.apply_targets()?;
        Ok(machine)
    }

    /// The physics, which is the truth.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Units on a port.
    pub fn units(&self, port: usize) -> &[Unit] {
        self.banks.get(port).map_or(&[], |bank| bank.bus.units())
    }

    /// Time that the machine has reached, ns.
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Advances to `now_ns`; a time in the past has no effect.
    ///
    /// # Errors
    /// The plant rejects numbers that are not finite; no configuration causes that.
    pub fn advance(&mut self, now_ns: u64) -> Result<(), BoxError> {
        while self.now_ns < now_ns {
            let step_ns = (now_ns - self.now_ns).min(STEP_NS);
            self.plant.step(step_ns as f64 * 1e-9, &self.inputs)?;
            self.now_ns += step_ns;
            self.measure();
            for bank in &mut self.banks {
                bank.bus.advance(self.now_ns);
            }
            self.apply_targets()?;
        }
        Ok(())
    }

    /// Receives a byte on a port at `at_ns`; the answer goes onto `answer`.
    ///
    /// # Errors
    /// As [`Machine::advance`].
    pub fn receive(&mut self, port: usize, at_ns: u64, byte: u8, answer: &mut WireQueue) -> Result<(), BoxError> {
        self.advance(at_ns)?;
        if let Some(bank) = self.banks.get_mut(port) {
            bank.bus.receive(at_ns, byte, answer);
        }
        self.apply_targets()
    }

    /// Applies a fault of the machine or its units. Faults of plugs and wires belong to [`MotorBox`](crate::MotorBox).
    ///
    /// # Errors
    /// The part does not exist.
    pub fn apply(&mut self, fault: BoxFault) -> Result<(), BoxError> {
        match fault {
            BoxFault::Plant(fault) => self.plant.apply(fault)?,
            BoxFault::Reboot { port, address, for_s } => self.unit_mut(port, address)?.reboot(ns(for_s)),
            BoxFault::Mute { port, address, for_s } => {
                let until_ns = self.now_ns.saturating_add(ns(for_s));
                self.unit_mut(port, address)?.mute_until(until_ns);
            }
            BoxFault::Estop { port, address, on } => {
                let found = self.banks.get_mut(port).and_then(|bank| {
                    let unit = bank.bus.units().iter().position(|unit| unit.address() == address)?;
                    bank.stopped.get_mut(unit)
                });
                *found.ok_or(BoxError::NoSuchUnit { port, address })? = on;
            }
            BoxFault::Unplug { .. }
            | BoxFault::Plug { .. }
            | BoxFault::Noise { .. }
            | BoxFault::Silence { .. }
            | BoxFault::Late { .. } => {}
        }
        self.measure();
        self.apply_targets()
    }

    fn unit_mut(&mut self, port: usize, address: u8) -> Result<&mut Unit, BoxError> {
        let units = self.banks.get_mut(port).map(|bank| bank.bus.units_mut());
        units
            .and_then(|units| units.iter_mut().find(|unit| unit.address() == address))
            .ok_or(BoxError::NoSuchUnit { port, address })
    }

    /// Copies sensor readings from the plant to the units.
    fn measure(&mut self) {
        for bank in &mut self.banks {
            for (unit, winches) in bank.winches.iter().enumerate() {
                let mut measured =
                    Measured { supply_v: self.plant.voltage_v(), temperature_c: BOARD_C, ..Measured::default() };
                if bank.stopped[unit] {
                    measured.status.0 |= Status::EMERGENCY_STOP;
                }
                for (motor, winch) in winches.iter().enumerate() {
                    let Some(Winch { cable, sign }) = *winch else { continue };
                    measured.counts[motor] = self.plant.counts(cable) * sign as i64;
                    measured.speeds_counts_s[motor] = self.plant.averaged_speed_counts_s(cable) * sign;
                    // On the wire a current is positive in the direction of rising counts; a pull acts the other way.
                    let current_a = -self.plant.measured_current_a(cable) * sign;
                    measured.currents_a[motor] = current_a;
                    measured.duties[motor] = self.plant.duty(cable) * sign;
                    let limit_a = bank.applied[unit][motor].1;
                    if current_a.abs() > WARN_AT * limit_a {
                        measured.status.0 |= [Status::OVER_CURRENT_1, Status::OVER_CURRENT_2][motor];
                    }
                }
                bank.bus.measure(unit, &measured);
            }
        }
    }

    /// Copies targets and changed settings from the units to the plant.
    fn apply_targets(&mut self) -> Result<(), BoxError> {
        for bank in &mut self.banks {
            let units = bank.bus.units().iter().zip(&bank.winches).zip(&mut bank.applied);
            for ((unit, winches), applied) in units {
                for (winch, motor) in winches.iter().zip(MOTORS) {
                    let Some(Winch { cable, sign }) = *winch else { continue };
                    self.inputs[cable] = match unit.target(motor) {
                        Target::Speed(speed) => MotorInput::Speed(speed * sign),
                        // Adding zero turns the -0 of a reversed winch into the 0 of a released motor.
                        Target::Duty(duty) => MotorInput::Duty(duty * sign + 0.0),
                    };
                    let settings = (unit.velocity_pid(motor), unit.max_current_a(motor));
                    if settings != applied[motor.index()] {
                        applied[motor.index()] = settings;
                        self.plant.set_gains(cable, gains_of(settings.0))?;
                        self.plant.set_current_limit(cable, settings.1.max(MIN_CURRENT_A))?;
                    }
                }
            }
        }
        Ok(())
    }
}

impl Bank {
    /// Tunes the units over the bus, as an installer would, and stores the settings in them.
    fn commission(&mut self, plant: &Plant, current_limit_a: f64) {
        let mut nobody = WireQueue::new(0);
        let mut tell = |bus: &mut UnitBus, packet: Packet| {
            for &byte in packet.iter() {
                bus.receive(0, byte, &mut nobody);
            }
        };
        for (unit, winches) in self.winches.iter().enumerate() {
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

fn ns(seconds: f64) -> u64 {
    (seconds.max(0.0) * 1e9) as u64
}
