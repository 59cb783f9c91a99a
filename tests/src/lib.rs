//! Tests across crates and processes.
#![forbid(unsafe_code)]

pub mod laws;
pub mod scenarios;

pub use nims::lockstep;
