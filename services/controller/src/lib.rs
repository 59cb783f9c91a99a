//! Computes cable velocities from the node estimate and the planned motion.
//!
//! Invariants:
//! * [`Controller::step`] is pure: no clock, no I/O, no allocation. The same samples give the same bits.
//! * Every finite input gives finite velocities within the limits. Where no such answer exists, the row is not `valid`.
//! * A further law is a variant of [`Law`] and a name in the configuration; motions, slots, limits and stretch stay as
//!   they are. A custom law is a [`CableLaw`] in a separate program ([`process::main_with`]) that the system file names
//!   in place of this one; in another language it is a program
//!   that this one asks over a pipe ([`mod@program`]).
#![forbid(unsafe_code)]

mod controller;
mod custom_law;
mod instant;
mod law;
pub mod lockstep;
mod preview;
pub mod process;
pub mod program;
mod retune;
mod settings;
mod target;

pub use controller::{Controller, Inputs};
pub use custom_law::{CableLaw, LawInput};
pub use law::{Law, LawError};
pub use preview::{Notice, PreviewSettings};
pub use runtime::program;
pub use settings::ControllerConfig;
