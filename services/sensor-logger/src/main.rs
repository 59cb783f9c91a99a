//! Publishes readings of any sensor with their places, and live maps; see the library.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use runtime::{Args, Chassis};

fn main() -> ExitCode {
    runtime::main("sensor-logger", |_: &Args, chassis: &mut Chassis| sensor_logger::process::run(chassis))
}
