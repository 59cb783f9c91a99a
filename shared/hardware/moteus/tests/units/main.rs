//! Codec, virtual unit and driver.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod codec;
mod conformance;
mod quick;
mod second;
mod unit;
