//! The box in real time: wires, machine and clock.

use plant::ground::Ground;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::BoxError;
use crate::device::Device;
use crate::fault::{BoxFault, FaultRequest};
use crate::machine::Machine;
use crate::settings::BoxConfig;
use crate::time::{BoxTime, LeftOut};
use crate::wire::Wire;

/// Longest step of the machine, ns. The physics has its own, finer steps; this bounds the delay of a watchdog.
const TICK_NS: u64 = 5_000_000;

/// Period of the wires' maintenance, ns.
const MAINTAIN_NS: u64 = 50_000_000;

/// Shortest sleep, ns: less has passed before the call returns.
const SHORTEST_SLEEP_NS: u64 = 1_000;
/// Shortest sleep while the box's time stands still, ns: nothing becomes due meanwhile.
const STANDING_SLEEP_NS: u64 = 1_000_000;

/// The running box.
#[derive(Debug)]
pub struct MotorBox {
    machine: Machine,
    wires: Vec<Wire>,
    devices: Vec<Device>,
    ground: Ground,
    time: BoxTime,
    maintained_ns: u64,
    /// Pending repairs and their times on the machine's clock, ns.
    repairs: Vec<(u64, BoxFault)>,
    /// Configured supply, V.
    supply_v: f64,
}

impl MotorBox {
    /// Builds the machine and publishes its ports.
    ///
    /// # Errors
    /// The machine's configuration cannot be used, or a port cannot be created.
    pub fn new(config: &BoxConfig) -> Result<Self, BoxError> {
        let machine = Machine::new(config)?;
        let wires = config
            .ports
            .iter()
            .zip(0..)
            .map(|(port, i)| {
                // Bytes over USB take no time.
                let baud = if port.wire == config::Wire::Usb { 0 } else { port.baud };
                Wire::new(&port.link, baud, config.plant.seed.wrapping_add(i))
            })
            .collect::<Result<_, _>>()?;
        let seed = |i: usize| config.plant.seed.wrapping_add(i as u64);
        let devices = config.devices.iter().enumerate().map(|(i, device)| Device::new(device.clone(), seed(100 + i)));
        let devices = devices.collect::<Result<_, _>>()?;
        Ok(Self {
            machine,
            wires,
            devices,
            ground: config.ground.clone(),
            time: BoxTime::new(config.ports.iter().map(|port| &*port.link), config.period_ns)?,
            maintained_ns: 0,
            repairs: Vec::new(),
            supply_v: config.plant.supply_v,
        })
    }

    /// The machine with its truth and units.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Time of the last step on the real clock (CLOCK_MONOTONIC), ns.
    pub fn real_ns(&self) -> u64 {
        self.time.real_ns()
    }

    /// Time left out so far because the computer had no processor for the box or for the program that drives it.
    pub fn left_out(&self) -> LeftOut {
        self.time.left_out()
    }

    /// Applies a fault for its duration, or a repair. A pending repair of the same part is cancelled.
    ///
    /// # Errors
    /// The part does not exist.
    pub fn request(&mut self, request: &FaultRequest) -> Result<(), BoxError> {
        self.apply(request.fault)?;
        let repair = request.fault.repair(self.supply_v);
        self.repairs.retain(|(_, pending)| Some(*pending) != repair && *pending != request.fault);
        if let (Some(seconds), Some(repair)) = (request.for_s, repair) {
            self.repairs.push((self.time.now_ns().saturating_add((seconds * 1e9) as u64), repair));
        }
        Ok(())
    }

    fn repair(&mut self) -> Result<(), BoxError> {
        while let Some(due) = self.repairs.iter().position(|(at_ns, _)| *at_ns <= self.time.now_ns()) {
            let (_, repair) = self.repairs.swap_remove(due);
            self.apply(repair)?;
        }
        Ok(())
    }

    /// Applies a fault or a repair.
    ///
    /// # Errors
    /// The part does not exist.
    pub fn apply(&mut self, fault: BoxFault) -> Result<(), BoxError> {
        match fault {
            BoxFault::Unplug { port } => self.wire_mut(port)?.unplug(),
            BoxFault::Plug { port } => self.wire_mut(port)?.plug()?,
            BoxFault::Noise { port, probability } => self.wire_mut(port)?.noise = probability,
            BoxFault::Silence { port, on } => self.wire_mut(port)?.silent = on,
            BoxFault::Late { port, delay_s } => self.wire_mut(port)?.late_ns = (delay_s * 1e9) as u64,
            other => self.machine.apply(other)?,
        }
        Ok(())
    }

    /// The wires: the drives' ports in the order of the system file, then those of the devices.
    fn wire_mut(&mut self, port: usize) -> Result<&mut Wire, BoxError> {
        let count = self.wires.len() + self.devices.len();
        let devices = self.devices.iter_mut().map(|device| &mut device.wire);
        self.wires.iter_mut().chain(devices).nth(port).ok_or(BoxError::NoSuchPort { port, count })
    }

    /// Runs until `until_ns` on the real clock (CLOCK_MONOTONIC), or until a signal interrupts the wait.
    ///
    /// # Errors
    /// A pseudo-terminal failed.
    pub fn run_until(&mut self, until_ns: u64) -> Result<(), BoxError> {
        loop {
            self.catch_up()?;
            if self.real_ns() >= until_ns {
                return Ok(());
            }
            let devices = self.devices.iter().map(Device::next_ns);
            let next_ns = self.wires.iter().filter_map(Wire::next_ns).chain(devices).min();
            let tick_ns = self.machine.now_ns() + TICK_NS;
            let sleep_ns = next_ns.map_or(tick_ns, |next| next.min(tick_ns)).saturating_sub(self.time.now_ns());
            let least_ns = if self.time.stands() { STANDING_SLEEP_NS } else { SHORTEST_SLEEP_NS };
            let sleep_ns = sleep_ns.min(until_ns - self.real_ns()).max(least_ns);
            let busy = self.wires.iter().any(|wire| wire.next_ns().is_some());
            self.time.sleep(sleep_ns, busy);
            if !self.wait(sleep_ns)? {
                return Ok(());
            }
        }
    }

    /// Advances clock, wires and machine to the present.
    fn catch_up(&mut self) -> Result<(), BoxError> {
        self.time.pass(serial::monotonic_ns());
        let now_ns = self.time.now_ns();
        self.repair()?;
        for (port, wire) in self.wires.iter_mut().enumerate() {
            wire.take_in(now_ns)?;
            while let Some((at_ns, byte)) = wire.next_for_units(now_ns) {
                wire.answer(|line| self.machine.receive(port, at_ns, byte, line))?;
            }
        }
        if now_ns >= self.machine.now_ns() + TICK_NS {
            self.machine.advance(now_ns)?;
        }
        for wire in &mut self.wires {
            wire.hand_out(now_ns)?;
        }
        for device in &mut self.devices {
            if device.is_due(now_ns) {
                self.machine.advance(now_ns)?;
            }
            device.live(now_ns, self.machine.plant(), &self.ground)?;
        }
        if now_ns >= self.maintained_ns + MAINTAIN_NS {
            self.maintained_ns = now_ns;
            self.wires.iter().for_each(Wire::maintain);
            self.devices.iter().for_each(|device| device.wire.maintain());
        }
        Ok(())
    }

    /// Sleeps until a program writes, or for `sleep_ns`; returns false after a signal.
    fn wait(&self, sleep_ns: u64) -> Result<bool, BoxError> {
        let timeout =
            Timespec { tv_sec: (sleep_ns / 1_000_000_000) as i64, tv_nsec: (sleep_ns % 1_000_000_000) as i64 };
        let devices = self.devices.iter().map(|device| &device.wire);
        let mut descriptors: Vec<PollFd<'_>> = self
            .wires
            .iter()
            .chain(devices)
            .filter_map(Wire::descriptor)
            .map(|descriptor| PollFd::from_borrowed_fd(descriptor, PollFlags::IN))
            .collect();
        match poll(&mut descriptors, Some(&timeout)) {
            Ok(_) => Ok(true),
            Err(rustix::io::Errno::INTR) => Ok(false),
            Err(error) => Err(BoxError::Wait(error.into())),
        }
    }
}
