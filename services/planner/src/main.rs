//! The process `planner`; see the library.
#![forbid(unsafe_code)]

use std::path::Path;
use std::process::ExitCode;

use runtime::Args;

fn main() -> ExitCode {
    runtime::main("planner", |args: &Args, chassis| {
        // The supervisor gives each process the copy of the system file in the run folder.
        let system_file = args.common.system_file.as_deref();
        planner::process::run(chassis, system_file.and_then(Path::parent).unwrap_or(Path::new("")))
    })
}
