//! Tests across crates and processes.
#![forbid(unsafe_code)]

pub mod drift;
pub mod golden;
pub mod laws;
pub mod python;
pub mod record;
pub mod recorded;
pub mod scenarios;
pub mod takeover;
pub mod walk;

pub use lockstep;
pub use python::python;
