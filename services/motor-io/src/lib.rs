//! The clock of the robot, and the only process that moves it.
//!
//! [`Core`] decides: in each cycle [`Core::decide`] turns what arrived (commands, requests, the planned motion,
//! heartbeats) into commands for the drives, then [`Core::observe`] turns the drives' replies into the cycle's samples.
//! Both read the same [`messages::MotorInput`], which is published, so a run file holds everything to repeat the same
//! decisions bit for bit.
//!
//! A cycle k: the velocities chosen for k are sent, encoders are read, `motor/state` k is published; estimator and
//! controller answer with commands based on k; these are applied in cycle k + 1. Cable velocity is dL/dt: positive pays
//! out.
//!
//! Invariants:
//! * A cable moves only by a command that the [`arbiter`] accepted and the [`limits`] passed, or by a jog.
//! * The core has no clock, does no I/O and allocates nothing after its construction.
//! * The node's speed and acceleration are bounded by the lengths that motor-io measures itself, a motion begins where
//!   motor-io computes the node to be, and commands that lead away from the setpoint are a fault.
//! * A fault stays until it is reset, and no motion continues by itself after one.
//! * Time to live counts cycles, never milliseconds.
#![forbid(unsafe_code)]

pub mod answer;
pub mod arbiter;
mod backend;
pub mod commanded_envelope;
pub mod core;
pub mod drives;
pub mod energy;
pub mod inbox;
pub mod kernel;
pub mod limits;
pub mod mode;
pub mod motion;
pub mod node;
pub mod odometry;
pub mod plan_clock;
pub mod position;
pub mod process;
mod requests;
pub mod safety;
pub mod setpoint;
pub mod settings;
pub mod watch;

pub use answer::Answer;
pub use core::{Core, DriveCommand, Observation};
pub use settings::{ConfigError, CoreConfig};
