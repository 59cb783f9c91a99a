//! The controller: computes cable velocities from node estimates and the motion.
//!
//! Invariants:
//! * [`Controller::step`] is pure: no clock, no input or output, no allocation. The same samples give the same bits.
//! * Every finite input gives finite velocities within the limits; a row without a good answer is not `valid`.
//! * A further law is a variant of [`Law`] and a name in the configuration; motions, slots, limits and stretch do not
//!   depend on it. A custom law is a [`CableLaw`] in a separate program ([`process::main_with`]), which the system file
//!   starts instead of this one.
#![forbid(unsafe_code)]

mod controller;
mod custom_law;
mod law;
mod preview;
pub mod process;
mod retune;

pub use controller::{Controller, ControllerConfig, Inputs};
pub use custom_law::{CableLaw, LawInput};
pub use law::{Law, LawError};
pub use preview::{Notice, PreviewSettings};
pub use runtime::program;
