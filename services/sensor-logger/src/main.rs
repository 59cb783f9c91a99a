//! Readings of any sensor to samples with a place, and to live maps; see the library.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use service::{Args, Chassis};

fn main() -> ExitCode {
    service::main("sensor-logger", |_: &Args, chassis: &mut Chassis| sensor_logger::process::run(chassis))
}
