//! RoboClaw motor controllers over packet serial: a [drive family](drives::DriveBus) whose driver never uses a late or
//! broken answer, and the unit's side of the protocol for simulation.
//!
//! A unit drives two brushed motors with encoders and closes their speed loops; up to eight units share a serial port.
//! From the bottom up:
//! * [`codec`]: commands, questions and answers as bytes, [`Status`] in words. No state.
//! * [`Bus`]: the units of one line, in step with them or on the way back to it, see [`driver`] for the rules and why.
//! * [`mod@unit`]: virtual units without physics, for a process on a pseudo-terminal or a test with a virtual clock.
//!
//! Architecture invariants: one thread owns a port. The driver moves a motor only by command, and after a unit was lost
//! or restarted only once it was commanded to stand still. A sample carries the time of its request. A control cycle
//! allocates nothing and waits no longer than the deadline and one answer's time.
//!
//! Limit of the protocol: an acknowledgement is a single byte without a checksum, so noise of that value right after a
//! lost command counts as one. The caller must check that the encoders follow.
//!
//! ```
//! use drives::{Command, CountBound, DriveBus};
//! use roboclaw::driver::{Bus, BusConfig, UnitConfig, WIRE_MARGIN_NS};
//! use roboclaw::unit::{Unit, UnitBus, UnitOptions};
//! use serial::{Pipe, Transport};
//!
//! // A virtual unit on a simulated port; a real one: `serial::ReopeningPort::new("/dev/serial/by-path/..", 230_400)`.
//! let port = Pipe::new("simulated", 230_400, UnitBus::new(vec![Unit::new(UnitOptions::new(0x80))]));
//! let bound = CountBound { counts_s: 50_000.0, margin: 0.0 };
//! let unit = UnitConfig { address: 0x80, watchdog_tenths: 3, bound };
//! let config = BusConfig { baud: 230_400, margin_ns: WIRE_MARGIN_NS, units: vec![unit], stop_pin: None };
//! let mut bus = Bus::new(port, &config)?;
//! bus.settle(100_000_000)?;
//!
//! let mut answers = bus.blank_answers();
//! for command in [Command::HOLD, Command::Velocity(1000.0)] {
//!     let deadline_ns = bus.now_ns() + 10_000_000;
//!     bus.exchange(&[[Some(command); 2]], deadline_ns, &mut answers);
//!     assert!(answers[0].outcome.is_ok());
//! }
//! assert_eq!(answers[0].report.counts.value, [0, 0]); // without physics nothing turns the encoders
//! # Ok::<(), drives::Error>(())
//! ```
#![forbid(unsafe_code)]

pub mod codec;
mod crc;
pub mod driver;
mod packet;
mod status;
pub mod unit;

pub use codec::Command;
pub use crc::{Crc, crc16};
pub use driver::{Bus, BusConfig, Drive, UnitConfig, watchdog_tenths};
pub use packet::{MAX_PACKET, Packet};
pub use serial::StatusPin;
pub use status::{Status, StatusWidth};
