//! The codec, the driver and the virtual units, against each other and against the manual's examples.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod codec;
mod conformance;
mod driver;
mod fleet;
mod unit;
