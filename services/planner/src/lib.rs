//! Missions and requests to checked motion segments.
//!
//! [`mission`] reads mission files, [`plan`] makes segments of them and checks each against the limits of the robot,
//! [`Planner`] tracks the mission that is flown, [`progress`] stores its progress on disk, [`dry_run`] plans without
//! flying. [`scan`] makes way points of patterns over an area.
//!
//! Invariants:
//! * A mission is checked whole before its first segment is published: a refused mission moves nothing.
//! * Segments follow each other without a gap, each from rest to rest, so a motion without a successor ends at rest.
//! * [`Planner`] is pure: time and samples come with every call.
#![forbid(unsafe_code)]

pub mod adaptive;
mod dry_run;
mod flight;
pub mod mission;
pub mod plan;
mod planner;
pub mod process;
pub mod progress;
pub mod requests;
pub mod scan;
mod stopped;

pub use dry_run::{Summary, dry_run};
pub use mission::Mission;
pub use plan::{Plan, PlanError, PlannerConfig};
pub use planner::{Inputs, Planner, Refusal, state_text};
pub use progress::Progress;
