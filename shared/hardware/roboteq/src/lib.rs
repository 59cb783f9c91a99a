//! Roboteq controllers over their serial text protocol: a [drive family](drives::DriveBus) whose driver never uses a
//! late or broken answer, and the controller's side of the protocol for simulation.
//!
//! A controller drives two motors and has a serial port, or USB, of its own. Its answers have neither checksum nor
//! number. From the bottom up:
//! * [`codec`]: text lines. No state.
//! * [`Bus`]: the controller of one port; see [`driver`] for the rules and why.
//! * [`mod@unit`]: a virtual controller without physics.
//!
//! A count is one of the controller's encoder counter, four for each pulse of the encoder.
//!
//! Architecture invariants: one thread owns a port. The driver moves a motor only by command, and after a controller
//! was lost or restarted only once it was commanded to stand still. A sample carries the time of its request. A control
//! cycle allocates nothing and waits no longer than the deadline and one answer's time.
//!
//! ```
//! use drives::{Command, CountBound, DriveBus};
//! use roboteq::driver::{Bus, BusConfig, UART_MARGIN_NS};
//! use roboteq::unit::{Controller, ControllerOptions};
//! use serial::{Pipe, Transport};
//!
//! let port = Pipe::new("simulated", 115_200, Controller::new(ControllerOptions::new(0)));
//! let bound = CountBound { counts_s: 100_000.0, margin: 0.0 };
//! let (baud, margin_ns, watchdog_ms) = (115_200, UART_MARGIN_NS, 300);
//! let config = BusConfig { baud, margin_ns, address: 0, axes: 2, watchdog_ms, bound, stop_pin: None };
//! let mut bus = Bus::new(port, &config)?;
//! while bus.settle(bus.now_ns() + 10_000_000).is_err() {}
//!
//! let mut answers = bus.blank_answers();
//! for command in [Command::HOLD, Command::Velocity(1000.0)] {
//!     let deadline_ns = bus.now_ns() + 10_000_000;
//!     bus.exchange(&[[Some(command); 2]], deadline_ns, &mut answers);
//!     assert!(answers[0].outcome.is_ok());
//! }
//! # Ok::<(), drives::Error>(())
//! ```
#![forbid(unsafe_code)]

pub mod codec;
pub mod driver;
mod status;
pub mod unit;

pub use driver::{Bus, BusConfig, watchdog_ms};
pub use status::neutral;
