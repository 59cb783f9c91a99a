//! Computes the node estimate from the motor state: position, velocity and cable tensions.
//!
//! Invariants:
//! * [`Estimator::step`] is pure: no clock, no I/O, no allocation. The same samples give the same bits. Only with a
//!   method in a program it waits for that program's answer, until a deadline.
//! * An estimate is `valid` only if every cable was read in this cycle or so shortly before that [`Instant::bridges`]
//!   the time, motor-io knows the position, and every number is finite. An invalid estimate carries only what was
//!   measured.
//! * A method is a [`CableEstimator`]: the readings and commands of one cable to its length and velocity. A standard
//!   method is a row in `method.rs`. A custom method is a separate program ([`process::main_with`]) that the system
//!   file names in place of this one or beside it; in another language it is a program that this one asks over a pipe
//!   ([`mod@program`]).
#![forbid(unsafe_code)]

mod cable_estimator;
mod cables;
mod estimator;
mod method;
pub mod process;
pub mod program;
mod readings;
mod serve;
mod swing;

pub use cable_estimator::{BRIDGED_CYCLES, CableEstimator, CableSample, Instant, Measurement, Parameters};
pub use estimator::{Estimator, EstimatorConfig};
pub use method::{METHOD_OTHER, Method};
pub use runtime::program;
