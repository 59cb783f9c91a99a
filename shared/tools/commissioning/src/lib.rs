//! What happens before the first flight: checks of configuration and machine, the calibration, plans on paper.
//!
//! Invariants:
//! * Nothing here asks a robot to move, and most of it needs none.
//! * Each finding has its cure beside it.
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
