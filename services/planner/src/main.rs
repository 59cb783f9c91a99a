//! The process `planner`; see the library.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    runtime::main("planner", planner::process::run)
}
