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
//! * A cable moves only by a command that the arbiter accepted and the limits passed, by a jog, or in soft mode by a
//!   hand.
//! * The core has no clock, does no I/O and allocates nothing after its construction.
//! * The node's speed and acceleration are bounded by the lengths that motor-io measures itself, a motion begins where
//!   motor-io computes the node to be, and commands that lead away from the setpoint are a fault.
//! * A fault stays until it is reset, and no motion continues by itself after one.
//! * Time to live counts cycles, never milliseconds.
#![forbid(unsafe_code)]

mod answer;
mod arbiter;
mod ask;
mod backend;
mod commanded_envelope;
mod core;
mod drives;
mod energy;
mod inbox;
mod kernel;
mod limits;
mod load;
mod mode;
mod motion;
mod node;
mod odometry;
mod plan_clock;
mod position;
mod process;
mod requests;
mod safety;
mod setpoint;
mod settings;
mod slip;
mod watch;

pub use answer::Answer;
pub use arbiter::{Arbiter, ArbiterInput, ChosenCommand};
pub use ask::{Asked, Trouble, ask};
pub use backend::open as open_port;
pub use core::{Core, DriveCommand, Observation};
pub use inbox::Inbox;
pub use odometry::{NOT_COUNTED, Position};
pub use process::run;
pub use setpoint::Setpoints;
pub use settings::{ConfigError, CoreConfig, SecondEncoders};
