//! Motions, patterns and scans, from the request to the trajectory.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod planner;
mod scans;
