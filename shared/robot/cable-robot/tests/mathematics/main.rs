//! The mathematics of the robot, held to independent solutions, the paper's figures and its own properties.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod calibration;
mod counting;
mod drive_lag;
mod elastic;
mod energy;
mod motion;
mod no_alloc;
mod no_panic;
mod planar;
mod preview;
mod tension;
mod tension_general;
