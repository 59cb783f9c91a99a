//! Interface between a protocol and the wire.

use std::sync::Arc;

use crate::{Error, PortClock};

/// Status input of a serial port besides its data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StatusPin {
    /// Clear to send.
    Cts,
    /// Data set ready.
    Dsr,
    /// Carrier detect.
    Cd,
}

impl StatusPin {
    /// Every pin with its name in configuration files.
    pub const NAMES: [(&'static str, StatusPin); 3] =
        [("cts", StatusPin::Cts), ("dsr", StatusPin::Dsr), ("cd", StatusPin::Cd)];

    /// Returns the pin of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<StatusPin> {
        StatusPin::NAMES.iter().find(|(known, _)| *known == name).map(|(_, pin)| *pin)
    }
}

/// A byte stream with a clock. Every wait has an absolute deadline on that clock; after the deadline only available
/// bytes are returned.
pub trait Transport: Send {
    /// Name for the operator.
    fn name(&self) -> &Arc<str>;

    /// Time of this transport's clock, ns: [`monotonic_ns`](crate::monotonic_ns) for devices of this machine, less the
    /// time that a simulated one left out.
    fn now_ns(&self) -> u64;

    /// Present time for stamps, ns: [`monotonic_ns`](crate::monotonic_ns) for devices of this machine.
    fn stamp_ns(&self) -> u64 {
        self.now_ns()
    }

    /// Clock of a simulated device of this machine, for other threads than the port's.
    fn clock(&self) -> Option<Arc<PortClock>> {
        None
    }

    /// Sets whether a thread with other work in every cycle uses the port. Such a port neither opens nor closes its
    /// device, because a broken adapter can block either: a lost device stays lost until this is `false` again.
    fn set_inline(&mut self, inline: bool) {
        let _ = inline;
    }

    /// Waits until this transport's clock shows `until_ns`.
    fn wait_until(&mut self, until_ns: u64);

    /// Number of the connection: 1 for the first, one more each time the device came back. Tries to connect, without
    /// waiting. When the number has changed, the far side may have lost its settings.
    fn connection(&mut self) -> Result<u32, Error>;

    /// Writes all bytes to the device. They may still be in transit when this returns.
    fn write_all(&mut self, bytes: &[u8], deadline_ns: u64) -> Result<(), Error>;

    /// Waits for at least one byte and reads as many as fit into `buffer`; 0 after the deadline.
    fn read(&mut self, buffer: &mut [u8], deadline_ns: u64) -> Result<usize, Error>;

    /// Number of bytes received and not yet read.
    fn pending(&mut self) -> Result<usize, Error>;

    /// Discards bytes received and not read, and bytes written and not sent.
    fn clear(&mut self) -> Result<(), Error>;

    /// Reads a status input.
    fn is_on(&mut self, pin: StatusPin) -> Result<bool, Error>;

    /// Reads until `buffer` is full or the deadline has passed; returns the number of bytes.
    fn fill(&mut self, buffer: &mut [u8], deadline_ns: u64) -> Result<usize, Error> {
        let least = buffer.len();
        self.fill_at_least(buffer, least, deadline_ns)
    }

    /// Reads until `buffer` has `least` bytes or the deadline has passed; returns the number of bytes. More than
    /// `least` are those that had arrived with them.
    fn fill_at_least(&mut self, buffer: &mut [u8], least: usize, deadline_ns: u64) -> Result<usize, Error> {
        let mut filled = 0;
        while filled < least
            && let Some(rest) = buffer.get_mut(filled..).filter(|rest| !rest.is_empty())
        {
            match self.read(rest, deadline_ns)? {
                0 => break,
                n => filled += n,
            }
        }
        Ok(filled)
    }
}

impl<T: Transport + ?Sized> Transport for Box<T> {
    fn name(&self) -> &Arc<str> {
        (**self).name()
    }
    fn now_ns(&self) -> u64 {
        (**self).now_ns()
    }
    fn stamp_ns(&self) -> u64 {
        (**self).stamp_ns()
    }
    fn clock(&self) -> Option<Arc<PortClock>> {
        (**self).clock()
    }
    fn set_inline(&mut self, inline: bool) {
        (**self).set_inline(inline);
    }
    fn wait_until(&mut self, until_ns: u64) {
        (**self).wait_until(until_ns);
    }
    fn connection(&mut self) -> Result<u32, Error> {
        (**self).connection()
    }
    fn write_all(&mut self, bytes: &[u8], deadline_ns: u64) -> Result<(), Error> {
        (**self).write_all(bytes, deadline_ns)
    }
    fn read(&mut self, buffer: &mut [u8], deadline_ns: u64) -> Result<usize, Error> {
        (**self).read(buffer, deadline_ns)
    }
    fn pending(&mut self) -> Result<usize, Error> {
        (**self).pending()
    }
    fn clear(&mut self) -> Result<(), Error> {
        (**self).clear()
    }
    fn is_on(&mut self, pin: StatusPin) -> Result<bool, Error> {
        (**self).is_on(pin)
    }
}
