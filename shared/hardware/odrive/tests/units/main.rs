//! Codec, virtual board and driver.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod codec;
mod conformance;
mod judge;
mod unit;
