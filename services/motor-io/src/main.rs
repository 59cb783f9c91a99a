//! The process `motor-io`; see the library.
#![forbid(unsafe_code)]

use runtime::CommonArgs;
use std::path::PathBuf;
use std::process::ExitCode;

/// Drives the motors: the clock of the robot, and the only process that moves it.
#[derive(Debug, clap::Parser)]
#[command(name = "motor-io")]
struct Args {
    #[command(flatten)]
    common: CommonArgs,
    /// Folder that keeps the position over restarts. Default: `state` beside the folder of the runs.
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
}

impl AsRef<CommonArgs> for Args {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}

fn main() -> ExitCode {
    runtime::main("motor-io", |args: &Args, chassis| motor_io::run(chassis, args.state.as_deref()))
}
