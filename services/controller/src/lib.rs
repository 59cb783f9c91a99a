//! Node estimate and motion to cable velocities.
//!
//! Invariants:
//! * [`Controller::step`] is pure: no clock, no input or output, no allocation. The same samples give the same bits.
//! * Every finite input gives finite velocities inside the limits; what has no good answer has a row that is not `valid`.
//! * Another law is a variant of [`Law`] and a name in the configuration; motions, slots, limits and stretch stay as they are. A law of one's own is
//!   a [`CableLaw`] in a program of its own ([`process::main_with`]), which the system file starts in this one's place.
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
