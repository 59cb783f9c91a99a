//! Motor drives without a vendor: what the control cycle needs of a drive family, and the threads that serve several
//! ports at once.
//!
//! * [`DriveBus`]: the trait of a drive family. One bus is one serial port with its units; each unit has up to [`AXES`]
//!   motors.
//! * [`Command`], [`UnitReport`], [`DriveStatus`], [`Error`]: commands, readings, conditions and failures in neutral
//!   terms.
//! * [`Fleet`]: several buses, each with a thread, that start every control cycle together.
//!
//! A new family implements [`DriveBus`] in its own crate; nothing here and nothing in the safety machine changes. The
//! contract of the trait is in its documentation. `shared/testing/drive-conformance` tests it, and `tests/fleet/fake/`
//! is a complete family to copy.
//!
//! Architecture invariants: no vendor is named here. One thread at a time has a port. A sample carries the time at
//! which it was requested. In a control cycle nothing is allocated.
//!
//! ```
//! use drives::{Capabilities, Command, CountBound};
//!
//! // A position counter that moves at most at 2000 counts per second, read with an uncertainty of 10 counts.
//! let bound = CountBound { counts_s: 2_000.0, margin: 10.0 };
//! assert!(bound.explains(30.0, 10_000_000) && !bound.explains(31.0, 10_000_000));
//!
//! // What a caller needs and a family does not offer.
//! let offered = Capabilities { velocity: true, ..Capabilities::NONE };
//! let needed = Capabilities { velocity: true, watchdog: true, ..Capabilities::NONE };
//! assert_eq!(offered.first_missing(needed), Some("a watchdog"));
//! assert!(!Command::HOLD.moves() && Command::Velocity(-1.0).moves());
//! ```
#![forbid(unsafe_code)]

mod bus;
mod counts;
mod error;
mod fleet;
mod fleet_cycle;
mod inbox;
mod overdue;
mod port_thread;
mod report;
mod setup;
mod silence;
mod status;
mod track;

pub use bus::{Capabilities, Command, DriveBus, UnitCommand};
pub use counts::CountBound;
pub use error::{CommandName, Error, InvalidConfig, ReplyText, reply_text, watchdog_ms};
pub use fleet::Fleet;
pub use fleet_cycle::{FleetCommand, FleetReply, MAX_FLEET, PortReport};
pub use inbox::{Heard, Inbox};
pub use overdue::Overdue;
pub use report::{AXES, Counters, Firmware, SecondEncoder, StopInput, Timed, UnitAnswer, UnitInfo, UnitReport};
pub use setup::{Recognised, Setup, SetupStep};
pub use silence::{ASK_SILENT_EVERY_NS, BABBLE_NS, Instead, Noise, PAUSE_NS, SILENT_AFTER};
pub use status::DriveStatus;
pub use track::{Track, within};
