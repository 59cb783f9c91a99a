//! A serial port that opens its device again when it comes back.

use std::cell::Cell;
use std::sync::Arc;

use crate::clock::{monotonic_ns, sleep_until};
use crate::transport::{StatusPin, Transport};
use crate::{Error, Latency, Port, PortClock};

/// Time between two attempts to open a lost device, ns: short compared with the second that USB needs to enumerate a
/// device, long compared with the cost of an attempt.
pub const REOPEN_EVERY_NS: u64 = 200_000_000;

/// Step in which a simulated device that has no processor is waited for, ns.
const DEVICE_STEP_NS: u64 = 1_000_000;
/// Further wait once it has run, ns: its answer takes time on the wire.
const DEVICE_ANSWER_NS: u64 = 8_000_000;
/// Longest such wait, ns: no robot can be driven on a slower computer.
const DEVICE_PATIENCE_NS: u64 = 5_000_000_000;
/// The same for a caller that has other work, ns: it has to notice a request to stop.
const INLINE_PATIENCE_NS: u64 = 1_000_000_000;
/// Age up to which what the device left out counts as known, ns: short beside a wait for an answer, and long beside the
/// steps between an answer and the next question, each of which asks for the time.
const LEFT_OUT_KNOWN_NS: u64 = 100_000;

/// Connection of a [`ReopeningPort`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PortState {
    /// The device is open.
    Connected,
    /// The device is not there; the port tries to open it every [`REOPEN_EVERY_NS`].
    Lost(Error),
}

/// A serial device by its name, present or not.
///
/// No call waits for a lost device: every operation fails at once with the reason. [`Transport::connection`] tries to
/// open it. Use a stable name (`/dev/serial/by-path/..`): the kernel gives a device that is plugged in again another
/// number.
#[derive(Debug)]
pub struct ReopeningPort {
    name: Arc<str>,
    baud: u32,
    port: Option<Port>,
    /// See [`Transport::set_inline`].
    inline: bool,
    /// A lost device that is still open: closing can block, and the loss is to be known before. It is closed before the
    /// next attempt to open it.
    unclosed: Option<Port>,
    lost: Error,
    next_try_ns: u64,
    connections: u32,
    clock: Arc<PortClock>,
    /// Last time shown: a device reports a pause when it is over, and the clock must not go back.
    shown_ns: Cell<u64>,
    /// What the device had left out at the last reading, and the time of that, ns.
    left_out_ns: Cell<u64>,
    left_out_at_ns: Cell<u64>,
}

impl ReopeningPort {
    /// A port for the device `name` at `baud` bits per second. Nothing is opened yet.
    #[must_use]
    pub fn new(name: &str, baud: u32) -> ReopeningPort {
        let name: Arc<str> = name.into();
        ReopeningPort {
            lost: Error::Missing { port: Arc::clone(&name) },
            clock: Arc::new(PortClock::new(&name)),
            shown_ns: Cell::new(0),
            left_out_ns: Cell::new(0),
            left_out_at_ns: Cell::new(0),
            name,
            baud,
            port: None,
            inline: false,
            unclosed: None,
            next_try_ns: 0,
            connections: 0,
        }
    }

    /// Whether the device is there, as of the last operation.
    #[must_use]
    pub fn state(&self) -> PortState {
        match self.port {
            Some(_) => PortState::Connected,
            None => PortState::Lost(self.lost.clone()),
        }
    }

    /// Latency of the open port; `None` while the device is lost.
    #[must_use]
    pub fn latency(&self) -> Option<Latency> {
        self.port.as_ref().map(Port::latency)
    }

    /// Time of the next attempt to open the device, on the monotonic clock, ns; `None` while it is there.
    #[must_use]
    pub fn next_try_ns(&self) -> Option<u64> {
        self.port.is_none().then_some(self.next_try_ns)
    }

    fn with_port<R>(&mut self, work: impl FnOnce(&mut Port) -> Result<R, Error>) -> Result<R, Error> {
        let Some(port) = self.port.as_mut() else { return Err(self.lost.clone()) };
        let result = work(port);
        if let Err(error) = &result
            && error.is_lost()
        {
            self.lost = error.clone();
            self.unclosed = self.port.take();
            self.next_try_ns = monotonic_ns() + REOPEN_EVERY_NS;
        }
        result
    }

    /// Closes a lost device.
    fn close(&mut self) {
        if self.unclosed.take().is_some() {
            self.clock.closed();
        }
    }

    /// Continues a read whose deadline has passed on the machine's clock, while the device has left out time or waits
    /// for a processor.
    fn read_on(&mut self, buffer: &mut [u8], deadport_ns: u64) -> Result<usize, Error> {
        let patience_ns = if self.inline { INLINE_PATIENCE_NS } else { DEVICE_PATIENCE_NS };
        let give_up_ns = monotonic_ns().saturating_add(patience_ns);
        let mut waited = false;
        loop {
            let now_ns = monotonic_ns();
            let wants_to_run = now_ns < give_up_ns && self.clock.device_wants_to_run();
            let until_ns = if self.now_ns() < deadport_ns {
                self.on_the_machine_ns(deadport_ns)
            } else if wants_to_run {
                waited = true;
                now_ns + DEVICE_STEP_NS
            } else if std::mem::take(&mut waited) {
                now_ns + DEVICE_ANSWER_NS
            } else {
                return Ok(0);
            };
            match self.with_port(|port| port.read(buffer, until_ns))? {
                0 if now_ns < give_up_ns => {}
                got => return Ok(got),
            }
        }
    }

    /// Converts a time of the port's clock to the machine's, as far as it is known.
    fn on_the_machine_ns(&self, port_ns: u64) -> u64 {
        port_ns.saturating_add(self.known_left_out_ns(monotonic_ns()))
    }

    /// What the device has left out, read again after [`LEFT_OUT_KNOWN_NS`].
    fn known_left_out_ns(&self, machine_ns: u64) -> u64 {
        if machine_ns.saturating_sub(self.left_out_at_ns.get()) > LEFT_OUT_KNOWN_NS {
            self.left_out_ns.set(self.clock.left_out_ns());
            self.left_out_at_ns.set(machine_ns);
        }
        self.left_out_ns.get()
    }
}

impl Drop for ReopeningPort {
    fn drop(&mut self) {
        self.clock.closed();
    }
}

impl Transport for ReopeningPort {
    fn name(&self) -> &Arc<str> {
        &self.name
    }

    fn now_ns(&self) -> u64 {
        let machine_ns = monotonic_ns();
        let now_ns = machine_ns.saturating_sub(self.known_left_out_ns(machine_ns)).max(self.shown_ns.get());
        self.shown_ns.set(now_ns);
        now_ns
    }

    fn stamp_ns(&self) -> u64 {
        monotonic_ns()
    }

    fn clock(&self) -> Option<Arc<PortClock>> {
        Some(Arc::clone(&self.clock))
    }

    fn set_inline(&mut self, inline: bool) {
        self.inline = inline;
        if !inline {
            self.close();
        }
    }

    fn wait_until(&mut self, until_ns: u64) {
        while self.now_ns() < until_ns {
            sleep_until(self.on_the_machine_ns(until_ns));
        }
    }

    fn connection(&mut self) -> Result<u32, Error> {
        if self.port.is_none() {
            let now_ns = monotonic_ns();
            if self.inline || now_ns < self.next_try_ns {
                return Err(self.lost.clone());
            }
            self.close();
            match Port::open(&self.name, self.baud) {
                Ok(port) => {
                    self.port = Some(port);
                    self.clock.connected();
                    self.left_out_at_ns.set(0);
                    self.connections += 1;
                }
                Err(error) => {
                    self.lost = error.clone();
                    self.next_try_ns = now_ns + REOPEN_EVERY_NS;
                    return Err(error);
                }
            }
        }
        Ok(self.connections)
    }

    fn write_all(&mut self, bytes: &[u8], deadport_ns: u64) -> Result<(), Error> {
        let deadport_ns = self.on_the_machine_ns(deadport_ns);
        self.with_port(|port| port.write_all(bytes, deadport_ns))
    }

    fn read(&mut self, buffer: &mut [u8], deadport_ns: u64) -> Result<usize, Error> {
        let until_ns = self.on_the_machine_ns(deadport_ns);
        let late = self.now_ns() >= deadport_ns;
        let got = self.with_port(|port| port.read(buffer, until_ns))?;
        if got > 0 || late { Ok(got) } else { self.read_on(buffer, deadport_ns) }
    }

    fn pending(&mut self) -> Result<usize, Error> {
        self.with_port(Port::pending)
    }

    fn clear(&mut self) -> Result<(), Error> {
        self.with_port(Port::clear)
    }

    fn is_on(&mut self, pin: StatusPin) -> Result<bool, Error> {
        self.with_port(|port| port.is_on(pin))
    }
}
