//! The program `nims sim`.

#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    let about =
        "Fly a virtual robot without processes, much faster than real time: laws, parameters and worlds side by side";
    command::tool("nims sim", runtime::build::description(), about, nims_sim::run)
}
