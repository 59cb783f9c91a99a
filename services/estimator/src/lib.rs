//! Motor state to node estimate: where the node is, how it moves, and how the lines pull.
//!
//! Invariants:
//! * [`Estimator::step`] is pure: no clock, no input or output, no allocation. The same samples give the same bits.
//! * An estimate is `valid` only if every cable was read in this cycle or at most [`BRIDGED_CYCLES`] before, the position is
//!   known to motor-io, and everything in it is finite. An invalid one carries what was measured and nothing else.
#![forbid(unsafe_code)]

mod estimator;
mod kalman;
mod method;
mod phi;

pub use estimator::{BRIDGED_CYCLES, Estimator, EstimatorConfig};
pub use method::{Method, MethodError};
