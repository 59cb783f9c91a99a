//! moteus controllers of brushless motors over fdcanusb text lines: a [drive family](drives::DriveBus) whose driver
//! never uses a late or broken answer, and the unit's side of the protocol for simulation.
//!
//! A unit drives one motor. It is on a UART of its own, or with others on a CAN-FD bus behind a USB adapter; both speak
//! the same text lines. From the bottom up:
//! * [`codec`]: text lines, frames and registers as bytes. No state.
//! * [`Bus`]: the units of one port; see [`driver`] for the rules and why.
//! * [`mod@unit`]: virtual units without physics, for a process on a pseudo-terminal or a test with a virtual clock.
//!
//! A count is 1/100 000 of a turn, the resolution of the position as a 32-bit integer. The unit's position ends at
//! 21 474 turns, and the driver then reports it instead of counting on.
//!
//! Architecture invariants: one thread owns a port. The driver moves a motor only by command, and after a unit was lost
//! or restarted only once it was commanded to stand still. A sample carries the time of its request. A control cycle
//! allocates nothing and waits no longer than the deadline and one answer's time.
//!
//! ```
//! use drives::{Command, CountBound, DriveBus};
//! use moteus::driver::{Bus, BusConfig, UART_MARGIN_NS, UnitConfig};
//! use moteus::codec::Checksums;
//! use moteus::unit::{Unit, UnitBus, UnitOptions};
//! use serial::{Pipe, Transport};
//!
//! // A virtual unit on a simulated port; a real one: `serial::ReopeningPort::new("/dev/serial/by-path/..", 921_600)`.
//! let units = UnitBus::new(vec![Unit::new(UnitOptions::new(1))], Checksums::Required);
//! let port = Pipe::new("simulated", 921_600, units);
//! let bound = CountBound { counts_s: 3_000_000.0, margin: 0.0 };
//! let unit = UnitConfig { address: 1, watchdog_ms: 300, bound, torque_constant_n_m_a: 0.05, second: None };
//! let config = BusConfig {
//!     baud: 921_600,
//!     margin_ns: UART_MARGIN_NS,
//!     checksums: Checksums::Required,
//!     units: vec![unit],
//!     stop_pin: None,
//! };
//! let mut bus = Bus::new(port, &config)?;
//! while bus.settle(bus.now_ns() + 10_000_000).is_err() {}
//!
//! let mut answers = bus.blank_answers();
//! for command in [Command::HOLD, Command::Velocity(1000.0), Command::Torque(0.5)] {
//!     let deadline_ns = bus.now_ns() + 10_000_000;
//!     bus.exchange(&[[Some(command), None]], deadline_ns, &mut answers);
//!     assert!(answers[0].outcome.is_ok());
//! }
//! assert_eq!(answers[0].report.counts.value, [0, 0]); // without physics nothing turns the encoder
//! # Ok::<(), drives::Error>(())
//! ```
#![forbid(unsafe_code)]

pub mod codec;
pub mod driver;
mod status;
pub mod unit;

pub use driver::{Bus, BusConfig, SECOND_STEP_COUNTS, SecondInput, UnitConfig, watchdog_ms};
pub use status::neutral;
