//! The mathematics of the robot compared with independent solutions, the paper's figures and its own properties.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod counting;
mod elastic;
mod energy;
mod hanging;
mod motion;
mod planar;
mod pulleys;
mod sag;
mod swing;
mod tension;
mod tension_general;
mod uncertainty;
