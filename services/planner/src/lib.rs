//! Missions and requests to checked motion segments.
//!
//! [`mission`] reads what the operator wants, [`plan`] makes segments of it and checks each against the robot's limits,
//! [`Planner`] keeps track of the one mission that is flown, [`progress`] keeps on disk how far it came, [`dry_run()`] says what would
//! happen. [`scan`] makes way points of patterns over an area.
//!
//! Invariants:
//! * A mission is checked whole before its first segment is published: a refused mission moves nothing.
//! * Segments follow each other without a gap, each from rest to rest, so a motion without a successor ends at rest.
//! * [`Planner`] is pure: time and samples come with every call.
#![forbid(unsafe_code)]

pub mod adaptive;
mod dry_run;
mod flight;
mod inputs;
pub mod mission;
pub mod plan;
mod planner;
pub mod process;
pub mod progress;
pub mod requests;
pub mod scan;
mod stopped;

pub use dry_run::{Summary, dry_run};
pub use inputs::Inputs;
pub use mission::Mission;
pub use plan::{Plan, PlanError, PlannerConfig};
pub use planner::{Planner, Refusal, state_text};
pub use progress::Progress;
