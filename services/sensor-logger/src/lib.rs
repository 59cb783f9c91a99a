//! The process around the crate `georeference`: publishes the readings of any sensor with the place where each was
//! taken on `sample/NAME`, and a live map of them on `map/NAME`.
//!
//! Invariants:
//! * No other process depends on it: the robot flies without it, and `nims map` computes its output again from the run.
#![forbid(unsafe_code)]

pub mod process;
