//! The virtual motor control box: winches, cables and node behind drive units that use the real protocol on
//! pseudo-terminals.
//!
//! [`Machine`] stands for the hardware: drive units with their protocol, and the physics that they drive. [`Wire`]
//! gives each serial port a name and the speed of a real wire, and [`MotorBox`] runs all of it in real time. A program
//! cannot tell the box from hardware. Sensors on the node have ports beside the drives'.
//!
//! # Invariants
//! * Nothing in the control loop reads the truth that the box publishes: it is for evaluation.
//! * [`Machine`] has no clock; time is an argument. The same bytes at the same times give the same answers.
//! * The box advances by at most 20 ms at once: its time stops while the computer has no processor for the box or for
//!   motor-io.
#![forbid(unsafe_code)]

mod device;
mod error;
mod fault;
mod machine;
mod run;
pub mod section;
mod serve;
pub mod settings;
mod socket;
mod time;
mod twin;
mod wire;
mod world;

pub use device::{DeviceConfig, DeviceKind};
pub use error::BoxError;
pub use fault::{BoxFault, FaultRequest, KINDS, Kind, UnknownFault};
pub use machine::Machine;
pub use run::MotorBox;
pub use section::{GroundFile, MotorBoxSection};
pub use serve::{LEFT_OUT, ports_only, serve};
pub use settings::BoxConfig;
pub use socket::{Shared, Socket};
pub use time::LeftOut;
pub use wire::Wire;
