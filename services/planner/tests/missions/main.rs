//! Motions, patterns and scans, from the request to the trajectory.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod limits;
mod paths;
mod planner;
mod requests;
mod scans;
mod world;
