//! Commands for the time before the first flight: checks of configuration and machine, calibration, offline plans.
//!
//! Invariants:
//! * Nothing here requests motion, and most commands work without a robot.
//! * Each finding has a remedy.
#![forbid(unsafe_code)]

mod bow;
pub mod calibrate;
pub mod check;
mod command_line;
mod config_kind;
pub mod doctor;
pub mod finding;
pub mod kinematics;
pub mod loads;
pub mod new_program;
pub mod plan;
mod preload;
mod readable;
mod robot_findings;
pub mod setup;
mod swing;
pub mod workspace;

pub use command_line::Command;
