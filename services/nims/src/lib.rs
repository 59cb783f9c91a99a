//! The operator's command: requests to a running robot, live views, and the offline tools.
//!
//! Each command is a module or a crate with its own arguments; [`cli`] lists the commands and prints their result.
//!
//! Invariants:
//! * It moves nothing itself: it sends requests to motor-io and the planner, and prints their answers.
//! * Exit code 0: answered (also "not feasible", which is an answer); 2: bad input; 1: it could not be done now. A
//!   failure is one sentence on stderr. With `--json`, stdout holds one JSON object and nothing else.
//! * Bad input is found before anything is started or requested.

#![forbid(unsafe_code)]

mod channels;
pub mod cli;
mod demo;
pub mod fault;
mod new_sensor;
mod operate;
mod processes;
mod programs;
mod set;
mod status;
mod swap;
mod top;
pub mod visualization_export;
