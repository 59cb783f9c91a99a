//! Drive units and the physics they turn, without a clock.

use plant::{MotorInput, Plant, SpeedGains};
use roboclaw::codec::{Motor, Pid, Write};
use roboclaw::unit::{Measured, Target, Unit, UnitBus, UnitOptions};
use roboclaw::{Packet, Status};
use serial::{Device, Paced};

use crate::BoxError;
use crate::fault::BoxFault;
use crate::settings::{BoxConfig, UnitConfig};

/// Longest time the drives keep one target, ns: ramps and watchdogs are looked at this often.
const STEP_NS: u64 = 5_000_000;

/// Gains are 16.16 fixed-point numbers on the wire.
const FIXED_POINT: f64 = 65_536.0;

/// Part of the current limit at which a unit warns.
const WARN_AT: f64 = 0.95;

/// A current limit of nothing would be a motor that cannot move; the smallest a unit can be told, A.
const MIN_CURRENT_A: f64 = 0.01;

const MOTORS: [Motor; 2] = [Motor::One, Motor::Two];

/// Board temperature, degrees Celsius: a closed box on a mild day.
const BOARD_C: f64 = 31.0;

/// Which winch a motor of a unit turns.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Winch {
    cable: usize,
    /// -1 where the wiring makes the count fall as line pays out.
    sign: f64,
}

/// One serial line with its units.
#[derive(Debug, Clone)]
struct Bank {
    bus: UnitBus,
    winches: Vec<[Option<Winch>; 2]>,
    /// Whether the stop button of each unit is pressed.
    stopped: Vec<bool>,
    /// Settings that the plant has been given, to see when a program changes them.
    applied: Vec<[(Pid, f64); 2]>,
}

/// All units of the box and the plant; time is given to it.
///
/// Units tell motors what to do and ask what encoders say; the plant knows nothing of units, and they nothing of it.
#[derive(Debug, Clone)]
pub struct Machine {
    plant: Plant,
    banks: Vec<Bank>,
    inputs: Vec<MotorInput>,
    now_ns: u64,
}

impl Machine {
    /// Everything at rest at time 0, motors released, the speed loops tuned to motors and encoders.
    ///
    /// # Errors
    /// The plant makes no sense.
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
        machine.listen()?;
        Ok(machine)
    }

    /// The physics: truth.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Units on a port.
    pub fn units(&self, port: usize) -> &[Unit] {
        self.banks.get(port).map_or(&[], |bank| bank.bus.units())
    }

    /// How far it has come, ns.
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Lives on until `now_ns`; a time that is already past changes nothing.
    ///
    /// # Errors
    /// None that a configuration can bring about: the plant refuses what is not finite.
    pub fn advance(&mut self, now_ns: u64) -> Result<(), BoxError> {
        while self.now_ns < now_ns {
            let step_ns = (now_ns - self.now_ns).min(STEP_NS);
            self.plant.step(step_ns as f64 * 1e-9, &self.inputs)?;
            self.now_ns += step_ns;
            self.measure();
            for bank in &mut self.banks {
                bank.bus.advance(self.now_ns);
            }
            self.listen()?;
        }
        Ok(())
    }

    /// A byte has reached the units on a port at `at_ns`; an answer goes onto `answer`.
    ///
    /// # Errors
    /// As [`Machine::advance`].
    pub fn receive(&mut self, port: usize, at_ns: u64, byte: u8, answer: &mut Paced) -> Result<(), BoxError> {
        self.advance(at_ns)?;
        if let Some(bank) = self.banks.get_mut(port) {
            bank.bus.receive(at_ns, byte, answer);
        }
        self.listen()
    }

    /// Breaks something in machine or units; what concerns the ports' plugs and wires is the box's.
    ///
    /// # Errors
    /// There is no such part.
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
        self.listen()
    }

    fn unit_mut(&mut self, port: usize, address: u8) -> Result<&mut Unit, BoxError> {
        let units = self.banks.get_mut(port).map(|bank| bank.bus.units_mut());
        units
            .and_then(|units| units.iter_mut().find(|unit| unit.address() == address))
            .ok_or(BoxError::NoSuchUnit { port, address })
    }

    /// Plant to units: what the sensors say.
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
                    // On the wire a current is positive where it drives the count up: the other way than it pulls.
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

    /// Units to plant: targets, and settings that have changed.
    fn listen(&mut self) -> Result<(), BoxError> {
        for bank in &mut self.banks {
            let units = bank.bus.units().iter().zip(&bank.winches).zip(&mut bank.applied);
            for ((unit, winches), applied) in units {
                for (winch, motor) in winches.iter().zip(MOTORS) {
                    let Some(Winch { cable, sign }) = *winch else { continue };
                    self.inputs[cable] = match unit.target(motor) {
                        Target::Speed(speed) => MotorInput::Speed(speed * sign),
                        // Adding zero turns the -0 of a reversed winch into the 0 that means released.
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
    /// Tunes the units as an installer would, over the line, and has them keep it.
    fn commission(&mut self, plant: &Plant, current_limit_a: f64) {
        let mut nobody = Paced::new(0);
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
        // A unit takes any number; none at all would divide by nothing.
        full_speed_counts_s: f64::from(pid.counts_s_at_full_duty.max(1)),
    }
}

fn ns(seconds: f64) -> u64 {
    (seconds.max(0.0) * 1e9) as u64
}
