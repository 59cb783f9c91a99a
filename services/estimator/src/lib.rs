//! Motor state to node estimate: where the node is, how it moves, and how the lines pull.
//!
//! Invariants:
//! * [`Estimator::step`] is pure: no clock, no input or output, no allocation. The same samples give the same bits.
//! * An estimate is `valid` only if every cable was read in this cycle or at most [`BRIDGED_CYCLES`] before, the position is
//!   known to motor-io, and everything in it is finite. An invalid one carries what was measured and nothing else.
//! * A method is a [`CableEstimator`]: one cable's readings and commands to its length and velocity. A standard one is a row in
//!   `method.rs`, which alone has its name. One's own is a program of its own ([`process::main_with`]), which the system file starts in this
//!   one's place or beside it.
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
