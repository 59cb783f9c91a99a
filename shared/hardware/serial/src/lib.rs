//! Serial ports that survive being unplugged, and an in-process pipe with a virtual clock.
//!
//! Drivers of drives and sensors use a [`Transport`]: a byte stream with its own clock, on which every wait has an
//! absolute deadline. There are three:
//!
//! * [`Port`]: a serial device, opened exclusively; it ends when the device goes away.
//! * [`ReopeningPort`]: a port that reports at once that its device went away, and opens it again when it is back.
//! * [`Pipe`]: the same in memory, with a simulated device at the far end, a virtual clock, bytes paced like on a wire
//!   and faults on request. It does not depend on the machine's speed, so tests with it are deterministic.
//!
//! [`Pty`] and [`PtyLink`] are the other side of the first two: a pseudo-terminal that a simulated device offers to
//! programs. Where such a device keeps a [`LeftOutClock`] beside its port, a [`ReopeningPort`] uses the device's time
//! and leaves out what the device left out.
//!
//! Architecture invariants: this is the only crate that names `serialport`; it contains no protocol; no call waits
//! longer than its deadline on the transport's clock.
//!
//! ```
//! use serial::{Device, WireQueue, Pipe, Transport};
//!
//! struct Echo;
//! impl Device for Echo {
//!     fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
//!         reply.push(now_ns, &[byte]);
//!     }
//! }
//!
//! let mut pipe = Pipe::new("echo", 115_200, Echo);
//! pipe.write_all(b"hi", 1_000_000)?;
//! let mut answer = [0; 2];
//! assert_eq!(pipe.fill(&mut answer, 1_000_000)?, 2);
//! assert_eq!(&answer, b"hi");
//! assert_eq!(pipe.now_ns(), 3 * serial::byte_time_ns(115_200)); // two bytes there, the last one back
//! # Ok::<(), serial::Error>(())
//! ```
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
pub use left_out::{LeftOutClock, PortClock, Program};
pub use pace::{WireQueue, byte_time_ns};
pub use pipe::{Device, Faults, Pipe, PipeCounts};
pub use port::{Latency, Port};
pub use pty::{Pty, PtyLink};
pub use random::Random;
pub use reopening::{PortState, REOPEN_EVERY_NS, ReopeningPort};
pub use transport::{StatusPin, Transport};
