//! The virtual motor control box: winches, cables and node that speak the real bytes on pseudo-terminals.
//!
//! Where the hardware would be, there is [`Machine`]: drive units that understand packet serial, and the physics they turn.
//! [`Wire`] gives each serial port a name and the speed of a real wire, and [`MotorBox`] lets it all live in real time. Whatever
//! talks to the box cannot tell it from hardware, and needs not know that it is there. Sensors on the node have ports beside the drives'.
//!
//! # Invariants
//! * Nothing in the control loop may read what the box publishes: truth is for evaluation.
//! * [`Machine`] has no clock; time is an argument. The same bytes at the same times give the same answers.
//! * The box lives at most 20 ms at once: where the computer stands still, so does the box; and where it has no time for motor-io.
#![forbid(unsafe_code)]

mod device;
mod error;
mod fault;
mod machine;
mod run;
mod serve;
pub mod settings;
mod socket;
mod time;
mod wire;

pub use device::{DeviceConfig, DeviceKind};
pub use error::BoxError;
pub use fault::{BoxFault, FaultRequest, KINDS, Kind, UnknownFault};
pub use machine::Machine;
pub use run::MotorBox;
pub use serve::{ports_only, serve};
pub use settings::BoxConfig;
pub use socket::{Shared, Socket};
pub use time::Kept;
pub use wire::Wire;
