//! ODrive boards over the ASCII protocol of firmware 0.5: a [drive family](drives::DriveBus) whose driver never uses a
//! late or broken answer, and the board's side of the protocol for simulation.
//!
//! A board drives one or two brushless motors and has a serial port, or USB, of its own; the protocol has no address.
//! From the bottom up:
//! * [`codec`]: text lines. No state.
//! * [`Bus`]: the board of one port; see [`driver`] for the rules and why.
//! * [`mod@unit`]: a virtual board without physics.
//!
//! A count is 1/100 000 of a turn.
//!
//! Architecture invariants: one thread owns a port. The driver moves a motor only by command, and after a board was
//! lost or restarted only once it was commanded to stand still. A sample carries the time of its request. A control
//! cycle allocates nothing and waits no longer than the deadline and one answer's time.
//!
//! ```
//! use drives::{Command, CountBound, DriveBus};
//! use odrive::driver::{Bus, BusConfig, UART_MARGIN_NS};
//! use odrive::unit::{Board, BoardOptions};
//! use serial::{Pipe, Transport};
//!
//! let port = Pipe::new("simulated", 921_600, Board::new(BoardOptions::new(0)));
//! let bound = CountBound { counts_s: 3_000_000.0, margin: 0.0 };
//! let (baud, margin_ns, watchdog_ms) = (921_600, UART_MARGIN_NS, 300);
//! let (torque_constant_n_m_a, stop_pin) = (0.05, None);
//! let config =
//!     BusConfig { baud, margin_ns, address: 0, axes: 2, watchdog_ms, bound, torque_constant_n_m_a, stop_pin };
//! let mut bus = Bus::new(port, &config)?;
//! while bus.settle(bus.now_ns() + 10_000_000).is_err() {}
//!
//! let mut answers = bus.blank_answers();
//! for command in [Command::HOLD, Command::Velocity(1000.0), Command::Torque(0.5)] {
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
