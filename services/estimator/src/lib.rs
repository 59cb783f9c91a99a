//! The estimator: computes position and velocity of the node and the cable tensions from motor states.
//!
//! Invariants:
//! * [`Estimator::step`] is pure: no clock, no input or output, no allocation. The same samples give the same bits.
//! * An estimate is `valid` only if every cable was read in this cycle or at most [`BRIDGED_CYCLES`] before, motor-io
//!   knows the position, and all numbers are finite. An invalid estimate contains only the measured lengths.
//! * A method is a [`CableEstimator`]: it computes length and velocity of one cable from its readings and commands. A
//!   standard method is a row in `method.rs`, the only place that names it. A custom method is a separate program
//!   ([`process::main_with`]), which the system file starts instead of this one or in the other slot.
#![forbid(unsafe_code)]

mod cable_estimator;
mod estimator;
mod kalman;
mod method;
mod phi;
pub mod process;

pub use cable_estimator::{BRIDGED_CYCLES, CableEstimator, CableSample, Instant, Measurement, Parameters};
pub use estimator::{Estimator, EstimatorConfig};
pub use method::{METHOD_OTHER, Method};
pub use runtime::program;
