//! Visualization: the robot as tools draw it in three dimensions, live.

use std::process::ExitCode;

use runtime::{Args, Chassis};

fn main() -> ExitCode {
    runtime::main("visualization", |_: &Args, chassis: &mut Chassis| visualization::process::run(chassis))
}
