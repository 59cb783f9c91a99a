//! The one interface between a protocol and the wire.

use std::sync::Arc;

use crate::{Error, PortClock};

/// An input of a serial port beside its data: what drives it is on or off.
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
    /// Every pin, with its name in configuration files.
    pub const NAMES: [(&'static str, StatusPin); 3] =
        [("cts", StatusPin::Cts), ("dsr", StatusPin::Dsr), ("cd", StatusPin::Cd)];

    /// The pin of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<StatusPin> {
        StatusPin::NAMES.iter().find(|(known, _)| *known == name).map(|(_, pin)| *pin)
    }
}

/// A byte stream with a clock. Every wait has an absolute deadline on that clock; a deadline that is over means "only what is there".
pub trait Transport: Send {
    /// The name the operator knows it by.
    fn name(&self) -> &Arc<str>;

    /// This transport's clock, ns. For devices of this machine it is [`monotonic_ns`](crate::monotonic_ns), less what a simulated one left out.
    fn now_ns(&self) -> u64;

    /// The present instant as others stamp it, ns: for devices of this machine [`monotonic_ns`](crate::monotonic_ns).
    fn stamp_ns(&self) -> u64 {
        self.now_ns()
    }

    /// What a simulated device of this machine leaves out of its time, for others than the line's own thread.
    fn clock(&self) -> Option<Arc<PortClock>> {
        None
    }

    /// Let time pass until this transport's clock shows `until_ns`.
    fn wait_until(&mut self, until_ns: u64);

    /// Which connection this is: 1 for the first, one more each time the line came back. May try to connect, without waiting.
    /// When the number has changed, the far side may have lost everything it was told.
    fn connection(&mut self) -> Result<u32, Error>;

    /// Hand all bytes to the device. They may still be on their way when this returns.
    fn write_all(&mut self, bytes: &[u8], deadline_ns: u64) -> Result<(), Error>;

    /// Wait for at least one byte and take what fits into `buffer`; 0 where the deadline came first.
    fn read(&mut self, buffer: &mut [u8], deadline_ns: u64) -> Result<usize, Error>;

    /// Bytes received and not yet read.
    fn pending(&mut self) -> Result<usize, Error>;

    /// Throw away what was received and not read, and what was written and not sent.
    fn clear(&mut self) -> Result<(), Error>;

    /// Whether an input beside the data is on.
    fn is_on(&mut self, pin: StatusPin) -> Result<bool, Error>;

    /// Read until `buffer` is full or the deadline has come; returns how many bytes were read.
    fn fill(&mut self, buffer: &mut [u8], deadline_ns: u64) -> Result<usize, Error> {
        let mut filled = 0;
        while let Some(rest) = buffer.get_mut(filled..).filter(|rest| !rest.is_empty()) {
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
