//! Mission files: legs and patterns as they are written, read and checked without a robot.
//!
//! The planner makes segments of them, the gateway stores nothing else for it, and the commands read them before they
//! send them, so all of them refuse a file in the same sentence.
//!
//! Invariants:
//! * [`Mission::parse`] accepts only values in the stated ranges. Whether a robot can fly them is for the planner.
//! * No text makes it panic.
#![forbid(unsafe_code)]

mod file;
pub mod pattern;

pub use file::{Dwell, Leg, Line, MAX_LEGS, MAX_POINTS, Mission, MissionError, Parabola, PathShape, Polyline, Spiral};
