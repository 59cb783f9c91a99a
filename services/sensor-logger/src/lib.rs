//! Any sensor's readings with the place where each was taken, on `sample/NAME`, and a live map of what they say, on `map/NAME`.
//!
//! What it computes stands in the crate `georeference`; here is its process.
//!
//! Invariants:
//! * Nothing depends on it: the robot flies without it, and what it makes can be made again from the run (`nims map`).
#![forbid(unsafe_code)]

pub mod process;
