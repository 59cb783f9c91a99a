//! The cases; [`conformance!`](crate::conformance) makes a test of each.

mod commands;
mod units;
mod wire;

pub use commands::*;
pub use units::*;
pub use wire::*;
