//! Tests across crates and processes.
#![forbid(unsafe_code)]

pub mod lockstep;
pub mod scenarios;
