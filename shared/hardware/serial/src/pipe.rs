//! A serial port in memory with a virtual clock, a simulated device at the far end, and faults on request.
//!
//! The clock moves only when the near side waits, and then jumps to the next event, so a simulated hour costs no more
//! than its work, and every run is the same.

use std::sync::Arc;

use crate::pace::WireQueue;
use crate::{Error, Random, StatusPin, Transport};

/// Device at the far end of a [`Pipe`].
pub trait Device: Send {
    /// Receives a byte at `now_ns`. The answer goes onto the wire with [`WireQueue::push`], at the time at which the
    /// device begins to send.
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue);

    /// Advances the device to `now_ns`. Called in order, before the bytes that arrive at that time.
    fn advance(&mut self, now_ns: u64) {
        let _ = now_ns;
    }
}

/// Faults of the wire. Probabilities are per byte, in both directions, except `late`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// A byte is dropped.
    pub drop: f64,
    /// One bit of a byte is inverted.
    pub corrupt: f64,
    /// A byte arrives twice.
    pub duplicate: f64,
    /// A random byte is inserted before a byte.
    pub insert: f64,
    /// An answer as a whole is delayed, with everything after it.
    pub late: f64,
    /// Delay of a late answer, ns.
    pub late_ns: u64,
}

/// Event counts of a pipe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PipeCounts {
    /// Bytes written by the near side.
    pub written: u64,
    /// Bytes sent by the device.
    pub answered: u64,
    /// Bytes dropped, corrupted, duplicated or inserted.
    pub faults: u64,
    /// Answers delayed.
    pub late: u64,
}

/// The near end of the pipe; see the [crate's example](crate).
#[derive(Debug)]
pub struct Pipe<D> {
    name: Arc<str>,
    now_ns: u64,
    to_device: WireQueue,
    from_device: WireQueue,
    /// The device writes here first, so that faults can change its bytes.
    outbox: WireQueue,
    device: D,
    faults: Faults,
    random: Random,
    plugged: bool,
    silent_until_ns: u64,
    connections: u32,
    /// State of all status pins; `None`: it has no pins.
    pins: Option<bool>,
    counts: PipeCounts,
}

impl<D: Device> Pipe<D> {
    /// A connected pipe without faults, its clock at zero. `baud` 0: bytes take no time.
    pub fn new(name: &str, baud: u32, device: D) -> Pipe<D> {
        Pipe {
            name: name.into(),
            now_ns: 0,
            to_device: WireQueue::new(baud),
            from_device: WireQueue::new(baud),
            // The device's bytes are paced once, on the wire.
            outbox: WireQueue::new(0),
            device,
            faults: Faults::default(),
            random: Random::new(0),
            plugged: true,
            silent_until_ns: 0,
            connections: 1,
            pins: None,
            counts: PipeCounts::default(),
        }
    }

    /// Sets the faults from now on, drawn from a generator with this seed.
    pub fn set_faults(&mut self, faults: Faults, seed: u64) {
        self.faults = faults;
        self.random = Random::new(seed);
    }

    /// Switches all status pins on or off; a new pipe has no pins.
    pub fn set_pins(&mut self, on: bool) {
        self.pins = Some(on);
    }

    /// Drops everything that the device sends until `until_ns`.
    pub fn silence_until(&mut self, until_ns: u64) {
        self.silent_until_ns = until_ns;
    }

    /// Injects bytes that arrive now.
    pub fn inject(&mut self, bytes: &[u8]) {
        self.from_device.push(self.now_ns, bytes);
    }

    /// Unplugs the device: bytes in transit are lost, and the near side finds the device gone. The device continues to
    /// run.
    pub fn unplug(&mut self) {
        self.plugged = false;
        self.to_device.clear();
        self.from_device.clear();
        self.outbox.clear();
    }

    /// Plugs the device in again.
    pub fn plug(&mut self) {
        if !self.plugged {
            self.plugged = true;
            self.connections += 1;
        }
    }

    /// Device at the far end.
    pub fn device(&self) -> &D {
        &self.device
    }

    /// Device at the far end.
    pub fn device_mut(&mut self) -> &mut D {
        &mut self.device
    }

    /// Event counts.
    #[must_use]
    pub fn counts(&self) -> PipeCounts {
        self.counts
    }

    fn gone(&self, doing: &'static str) -> Error {
        Error::Gone { port: Arc::clone(&self.name), doing }
    }

    /// Puts a byte onto one direction of the wire, with faults.
    fn send(faults: &Faults, random: &mut Random, counts: &mut PipeCounts, wire: &mut WireQueue, at_ns: u64, byte: u8) {
        if random.chance(faults.insert) {
            counts.faults += 1;
            let noise = random.byte();
            wire.push(at_ns, &[noise]);
        }
        if random.chance(faults.drop) {
            counts.faults += 1;
            return;
        }
        let mut byte = byte;
        if random.chance(faults.corrupt) {
            counts.faults += 1;
            byte ^= 1 << (random.byte() & 7);
        }
        wire.push(at_ns, &[byte]);
        if random.chance(faults.duplicate) {
            counts.faults += 1;
            wire.push(at_ns, &[byte]);
        }
    }

    /// Runs all events up to `until_ns`.
    fn run_until(&mut self, until_ns: u64) {
        while let Some(at_ns) = self.to_device.next_ns().filter(|&at_ns| at_ns <= until_ns) {
            self.now_ns = self.now_ns.max(at_ns);
            self.device.advance(self.now_ns);
            let Some((_, byte)) = self.to_device.pop(at_ns) else { break };
            self.device.receive(self.now_ns, byte, &mut self.outbox);
            self.post_answer();
        }
        if until_ns > self.now_ns {
            self.now_ns = until_ns;
            self.device.advance(self.now_ns);
        }
    }

    fn post_answer(&mut self) {
        if self.outbox.is_empty() {
            return;
        }
        let late_ns = if self.random.chance(self.faults.late) {
            self.counts.late += 1;
            self.faults.late_ns
        } else {
            0
        };
        while let Some((at_ns, byte)) = self.outbox.pop(u64::MAX) {
            self.counts.answered += 1;
            if at_ns >= self.silent_until_ns {
                let wire = &mut self.from_device;
                Self::send(&self.faults, &mut self.random, &mut self.counts, wire, at_ns + late_ns, byte);
            }
        }
        // A delayed answer must not delay a later one by the outbox's own clock.
        self.outbox.clear();
    }
}

impl<D: Device> Transport for Pipe<D> {
    fn name(&self) -> &Arc<str> {
        &self.name
    }

    fn now_ns(&self) -> u64 {
        self.now_ns
    }

    fn wait_until(&mut self, until_ns: u64) {
        self.run_until(until_ns);
    }

    fn connection(&mut self) -> Result<u32, Error> {
        if self.plugged { Ok(self.connections) } else { Err(Error::Missing { port: Arc::clone(&self.name) }) }
    }

    fn write_all(&mut self, bytes: &[u8], _deadline_ns: u64) -> Result<(), Error> {
        if !self.plugged {
            return Err(self.gone("writing"));
        }
        for &byte in bytes {
            self.counts.written += 1;
            let wire = &mut self.to_device;
            Self::send(&self.faults, &mut self.random, &mut self.counts, wire, self.now_ns, byte);
        }
        Ok(())
    }

    fn read(&mut self, buffer: &mut [u8], deadline_ns: u64) -> Result<usize, Error> {
        loop {
            if !self.plugged {
                return Err(self.gone("reading"));
            }
            self.run_until(self.now_ns);
            let mut taken = 0;
            for slot in buffer.iter_mut() {
                let Some((_, byte)) = self.from_device.pop(self.now_ns) else { break };
                *slot = byte;
                taken += 1;
            }
            if taken > 0 || buffer.is_empty() || self.now_ns >= deadline_ns {
                return Ok(taken);
            }
            // Jumps to the next arrival at either end.
            let next_ns = [self.from_device.next_ns(), self.to_device.next_ns()].into_iter().flatten().min();
            self.run_until(next_ns.unwrap_or(u64::MAX).min(deadline_ns));
        }
    }

    fn pending(&mut self) -> Result<usize, Error> {
        if !self.plugged {
            return Err(self.gone("asking for received bytes"));
        }
        self.run_until(self.now_ns);
        Ok(self.from_device.arrived(self.now_ns))
    }

    fn is_on(&mut self, _pin: StatusPin) -> Result<bool, Error> {
        if !self.plugged {
            return Err(self.gone("asking for its status pins"));
        }
        self.pins.ok_or_else(|| Error::NoPin { port: Arc::clone(&self.name) })
    }

    fn clear(&mut self) -> Result<(), Error> {
        if !self.plugged {
            return Err(self.gone("clearing the port"));
        }
        self.from_device.discard_arrived(self.now_ns);
        self.to_device.clear();
        Ok(())
    }
}
