//! The scene: the robot as tools draw it in three dimensions, live.

use std::process::ExitCode;

use service::{Args, Chassis};

fn main() -> ExitCode {
    service::main("scene", |_: &Args, chassis: &mut Chassis| scene::process::run(chassis))
}
