//! Reads a sensor on a serial port; see the library.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use runtime::CommonArgs;

/// Publish the readings of a sensor on a serial port on sensor/NAME.
#[derive(Debug, Parser)]
struct Args {
    #[command(flatten)]
    common: CommonArgs,
    /// Sensor file: port, protocol, values; configs/sensors holds commented examples.
    file: PathBuf,
}

impl AsRef<CommonArgs> for Args {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}

fn main() -> ExitCode {
    runtime::main("sensor", |args: &Args, chassis| sensor::serve(&args.file, chassis))
}
