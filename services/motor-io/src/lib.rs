//! The clock of the robot and the only process that moves it.
//!
//! The deciding part is [`Core`]: in each cycle [`Core::decide`] turns what arrived (commands, requests, the plan's motion, signs of
//! life) into what the drives do, then [`Core::observe`] turns the drives' replies into the cycle's samples. Both see the same
//! [`messages::MotorInput`], which is published, so that a run file holds all it takes to run the same decisions again, bit for bit.
//!
//! A cycle k: velocities chosen for k are sent, encoders are read, `motor/state` k goes out; estimator and controller answer with
//! commands based on k; they are applied in cycle k + 1. Cable velocities are dL/dt: positive pays line out.
//!
//! Invariants:
//! * Nothing but a command that the [`arbiter`] accepted and the [`limits`] let through, or a jog, ever moves a cable.
//! * The core has no clock, does no I/O and allocates nothing after its construction.
//! * The node's speed and its change are bounded by motor-io's own lengths, a motion begins where motor-io believes the node is, and
//!   commands that lead away from the set point are a fault.
//! * A fault stays until it is reset, and no motion goes on by itself after one.
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
