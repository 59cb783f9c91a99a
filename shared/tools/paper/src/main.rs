//! The program `nims paper`.

#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    let about = "Reproduce every figure and table of the paper on one page, with the paper's claims";
    command::tool("nims paper", runtime::build::description(), about, nims_paper::run)
}
