//! Drive units and the physics they turn, without a clock.

use plant::{MotorInput, Plant};
use serial::WireQueue;

use crate::BoxError;
use crate::fault::BoxFault;
use crate::settings::BoxConfig;
use crate::twin::{self, MOTORS, Readings, Twin, Winch};

/// Longest time for which the drives keep one target, ns: ramps and watchdogs are evaluated this often.
const STEP_NS: u64 = 5_000_000;

/// Board temperature, degrees Celsius: a closed box on a mild day.
const BOARD_C: f64 = 31.0;

/// Units on one serial port.
#[derive(Debug)]
struct Bank {
    units: Box<dyn Twin>,
    addresses: Vec<u8>,
    winches: Vec<[Option<Winch>; MOTORS]>,
    /// State of each unit's stop button; true: pressed.
    stopped: Vec<bool>,
}

impl Clone for Bank {
    fn clone(&self) -> Self {
        Self {
            units: self.units.copy(),
            addresses: self.addresses.clone(),
            winches: self.winches.clone(),
            stopped: self.stopped.clone(),
        }
    }
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
                let winches: Vec<[Option<Winch>; MOTORS]> = port
                    .units
                    .iter()
                    .map(|unit| {
                        unit.cables.map(|cable| {
                            cable.map(|cable| {
                                let sign = |reversed: Option<&bool>| if reversed == Some(&true) { -1.0 } else { 1.0 };
                                let second_sign = sign(config.second_reversed.get(cable));
                                Winch { cable, sign: sign(config.reversed.get(cable)), second_sign }
                            })
                        })
                    })
                    .collect();
                let mut units = twin::new(port, config.turnaround_ns);
                units.commission(&plant, &winches, config.plant.motor.current_limit_a);
                let addresses = port.units.iter().map(|unit| unit.address).collect();
                Bank { units, addresses, winches, stopped: vec![false; port.units.len()] }
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

    /// Units on a port, if they are RoboClaws.
    pub fn units(&self, port: usize) -> &[roboclaw::unit::Unit] {
        self.banks.get(port).map_or(&[], |bank| bank.units.roboclaws())
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
                bank.units.device().advance(self.now_ns);
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
            bank.units.device().receive(at_ns, byte, answer);
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
            BoxFault::Reboot { port, address, for_s } => {
                let (bank, unit) = self.unit_mut(port, address)?;
                bank.units.reboot(unit, ns(for_s));
            }
            BoxFault::Mute { port, address, for_s } => {
                let until_ns = self.now_ns.saturating_add(ns(for_s));
                let (bank, unit) = self.unit_mut(port, address)?;
                bank.units.mute_until(unit, until_ns);
            }
            BoxFault::Estop { port, address, on } => {
                let (bank, unit) = self.unit_mut(port, address)?;
                bank.stopped[unit] = on;
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

    fn unit_mut(&mut self, port: usize, address: u8) -> Result<(&mut Bank, usize), BoxError> {
        let bank = self.banks.get_mut(port).ok_or(BoxError::NoSuchUnit { port, address })?;
        let unit = bank.addresses.iter().position(|&other| other == address);
        Ok((bank, unit.ok_or(BoxError::NoSuchUnit { port, address })?))
    }

    /// Copies sensor readings from the plant to the units.
    fn measure(&mut self) {
        for bank in &mut self.banks {
            for (unit, winches) in bank.winches.iter().enumerate() {
                let mut readings = Readings {
                    counts: [0; MOTORS],
                    second_counts: [0; MOTORS],
                    speeds_counts_s: [0.0; MOTORS],
                    currents_a: [0.0; MOTORS],
                    duties: [0.0; MOTORS],
                    supply_v: self.plant.voltage_v(),
                    temperature_c: BOARD_C,
                    stopped: bank.stopped[unit],
                };
                for (motor, winch) in winches.iter().enumerate() {
                    let Some(Winch { cable, sign, second_sign }) = *winch else { continue };
                    readings.counts[motor] = self.plant.counts(cable) * sign as i64;
                    readings.second_counts[motor] = self.plant.second_counts(cable) * second_sign as i64;
                    readings.speeds_counts_s[motor] = self.plant.averaged_speed_counts_s(cable) * sign;
                    // On the wire a current is positive in the direction of rising counts; a pull acts the other way.
                    readings.currents_a[motor] = -self.plant.measured_current_a(cable) * sign;
                    readings.duties[motor] = self.plant.duty(cable) * sign;
                }
                bank.units.measure(unit, &readings);
            }
        }
    }

    /// Copies targets and changed settings from the units to the plant.
    fn apply_targets(&mut self) -> Result<(), BoxError> {
        for bank in &mut self.banks {
            for (unit, winches) in bank.winches.iter().enumerate() {
                for (motor, winch) in winches.iter().enumerate() {
                    let Some(Winch { cable, sign, .. }) = *winch else { continue };
                    self.inputs[cable] = match bank.units.target(unit, motor) {
                        MotorInput::Speed(speed) => MotorInput::Speed(speed * sign),
                        // Adding zero turns the -0 of a reversed winch into the 0 of a released motor.
                        MotorInput::Duty(duty) => MotorInput::Duty(duty * sign + 0.0),
                        MotorInput::Current(current_a) => MotorInput::Current(current_a * sign),
                    };
                }
            }
            bank.units.apply_settings(&mut self.plant, &bank.winches)?;
        }
        Ok(())
    }
}

fn ns(seconds: f64) -> u64 {
    (seconds.max(0.0) * 1e9) as u64
}
