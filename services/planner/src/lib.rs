//! Turns missions and requests into checked motion segments.
//!
//! The crate `mission` reads a mission file, [`plan`] makes segments of it and checks each against the robot's limits,
//! [`Planner`] tracks the one mission that is flown, [`progress`] stores on disk how far it came, [`dry_run()`]
//! predicts a mission without flying it. [`scan`] makes way points of patterns over an area.
//!
//! Invariants:
//! * A mission is checked as a whole before its first segment is published: a rejected mission moves nothing.
//! * Segments follow each other without a gap, each from rest to rest, so a motion without a successor ends at rest.
//! * [`Planner`] is pure: time and samples are arguments of every call.
#![forbid(unsafe_code)]

pub mod adaptive;
mod dry_run;
mod flight;
mod inputs;
pub mod plan;
mod planner;
pub mod process;
pub mod progress;
mod refusal;
pub mod requests;
pub mod scan;
mod stopped;

pub use ::mission::{self, Mission};
pub use dry_run::{Summary, dry_run};
pub use inputs::Inputs;
pub use plan::{Plan, PlanError, PlannerConfig};
pub use planner::{Planner, state_text};
pub use progress::Progress;
pub use refusal::Refusal;
