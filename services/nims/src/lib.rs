//! The operator's command `nims`: requests to a running robot, live views, and tools that need no robot.
//!
//! Each command has its own module or crate, which also defines its arguments. [`cli`] lists the commands and
//! dispatches them; the output is printed in one place.
//!
//! Invariants:
//! * The command moves nothing itself: it sends requests to motor-io and the planner, and prints their answers.
//! * Exit code 0: answered ("not feasible" is an answer too); 2: bad input; 1: it could not be done now. A failure is
//!   one sentence on stderr. With `--json`, stdout holds one JSON object and nothing else.
//! * Input is checked before anything is started or requested.

#![forbid(unsafe_code)]

mod channels;
pub mod cli;
mod closed_runs;
mod demo;
pub mod fault;
mod fetch;
mod groups;
mod operate;
mod processes;
pub mod programs;
mod progress;
mod set;
mod status;
mod swap;
mod top;
pub mod visualization_export;
mod wait;
