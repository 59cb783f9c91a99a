//! Publishes the robot live for tools that draw it in three dimensions; see the library.

use std::process::ExitCode;

use runtime::{Args, Chassis};

fn main() -> ExitCode {
    runtime::main("visualization", |_: &Args, chassis: &mut Chassis| visualization::process::run(chassis))
}
