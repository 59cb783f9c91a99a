//! The virtual motor box: simulated winches, cables and node behind the drives' real serial protocol on
//! pseudo-terminals.
//!
//! [`Machine`] takes the place of the hardware: drive units that understand packet serial, and the physics that they
//! move. [`Wire`] gives each serial port a name and the speed of a real wire; [`MotorBox`] runs them in real time. A
//! program at a port cannot distinguish the box from hardware. Simulated sensors on the node have ports beside those of
//! the drives.
//!
//! # Invariants
//! * Nothing in the control loop reads what the box publishes: the truth is for evaluation.
//! * [`Machine`] has no clock; time is an argument. The same bytes at the same times give the same answers.
//! * The box advances by at most 20 ms at once. Its time stops while the box or motor-io waits for a processor.
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
