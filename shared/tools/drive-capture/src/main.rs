//! The program `nims drive-capture`.

#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    let about = "Record what a program and a drive say on a serial port, or answer as the drive did";
    command::tool("nims drive-capture", runtime::build::description(), about, nims_drive_capture::run)
}
