//! The program `nims truth`.

#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    let about = "Draw a plausible world that is not the robot's model, for the virtual motor box";
    command::tool("nims truth", runtime::build::description(), about, nims_truth::run)
}
