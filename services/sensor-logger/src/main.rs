//! Readings of any sensor to samples with a place, and to live maps; see the library.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use runtime::{Args, Chassis};

fn main() -> ExitCode {
    runtime::main("sensor-logger", |_: &Args, chassis: &mut Chassis| sensor_logger::process::run(chassis))
}
