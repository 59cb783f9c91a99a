//! The state of a robot as plain data and in sentences, for every program that shows it.
//!
//! Invariants:
//! * No clock, no I/O, no bus: samples in, data and sentences out.
//! * Each mode, fault, verdict, phase, cause, answer and end of a mission has its sentence here and nowhere else.
#![forbid(unsafe_code)]

pub mod answers;
mod parameter;
pub mod periods;
pub mod sentences;
mod stop;
mod unit;

pub use answers::Reason;
pub use periods::Periods;
pub use unit::DriveUnit;
