//! Node estimate and motion to cable velocities.
//!
//! Invariants:
//! * [`Controller::step`] is pure: no clock, no input or output, no allocation. The same samples give the same bits.
//! * Every finite input gives finite velocities inside the limits; what has no good answer has a row that is not `valid`.
//! * Another law is a variant of [`Law`] and a name in the configuration; motions, slots, limits and stretch stay as they are.
#![forbid(unsafe_code)]

mod controller;
mod law;
mod preview;

pub use controller::{Controller, ControllerConfig, Seen};
pub use law::{Law, LawError};
pub use preview::{Notice, PreviewSettings};
