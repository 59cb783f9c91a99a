//! Tools for the time before the first flight: checks of configuration and machine, calibration, plans and workspace.
//!
//! Invariants:
//! * Nothing here requests a motion, and most of it needs no robot.
//! * Each finding comes with its cure.
#![forbid(unsafe_code)]

pub mod calibrate;
pub mod check;
mod command_line;
pub mod doctor;
pub mod kinematics;
pub mod plan;
pub mod setup;
pub mod workspace;

pub use command_line::Command;
