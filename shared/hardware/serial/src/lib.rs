//! Serial ports that survive being unplugged, and an in-process pipe with a virtual clock.
//!
//! Drivers use a [`Transport`]: a byte stream with its own clock, on which every wait has an absolute deadline. There
//! are three:
//!
//! * [`Port`]: a serial device, opened for one program alone; it ends when the device goes away.
//! * [`ReopeningPort`]: a port that reports at once that its device went away, and opens it again when it is back.
//! * [`Pipe`]: the same in memory, with a simulated device at the far end, a virtual clock, bytes paced like on a wire and faults
//!   on request. Nothing in it depends on the machine's speed, so a test that passes once passes always.
//!
//! [`Pty`] and [`Jack`] are the other side of the first two: a pseudo-terminal that a simulated device offers to programs. Where such a
//! device keeps a [`LeftOut`] beside its port, a [`ReopeningPort`] goes by the device's time: it leaves out what the device left out.
//!
//! Architecture invariants: this is the only crate that uses `serialport`; nothing here knows a protocol; no call waits
//! longer than the deadline it was given, on the port's clock.
#![forbid(unsafe_code)]

mod clock;
mod error;
mod left_out;
mod pace;
mod pipe;
mod port;
mod pty;
mod random;
mod reopening;
mod transport;

pub use clock::{monotonic_ns, sleep_until};
pub use error::Error;
pub use left_out::{LeftOut, PortClock, Program};
pub use pace::{Paced, byte_time_ns};
pub use pipe::{Device, Faults, Pipe, PipeCounts};
pub use port::{Latency, Port};
pub use pty::{Jack, Pty};
pub use random::Random;
pub use reopening::{PortState, REOPEN_EVERY_NS, ReopeningPort};
pub use transport::{StatusPin, Transport};
