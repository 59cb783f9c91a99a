//! The virtual motor control box; see the library.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};
use runtime::{BadInput, Chassis, CommonArgs};

/// The virtual motor control box: drive units on pseudo-terminals, with winches, cables and a node behind them.
#[derive(Debug, Parser)]
struct Args {
    #[command(flatten)]
    common: CommonArgs,
    /// Only create the ports in this folder, without bus and truth.
    #[arg(long, value_name = "FOLDER")]
    ports_only: Option<PathBuf>,
}

impl AsRef<CommonArgs> for Args {
    fn as_ref(&self) -> &CommonArgs {
        &self.common
    }
}

fn main() -> ExitCode {
    // States the build, as `runtime::main` does.
    let given = Args::command().version(runtime::build::description()).get_matches();
    let args = Args::from_arg_matches(&given).unwrap_or_else(|error| error.exit());
    let Some(folder) = args.ports_only else {
        return runtime::main::<Args>("motor-box", |_, chassis: &mut Chassis| motor_box::serve(chassis));
    };
    let system_file = args
        .common
        .system_file
        .ok_or_else(|| BadInput("no system file: give one with --system FILE".to_owned()).into());
    match system_file.and_then(|path| motor_box::ports_only(&path, &folder)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("motor-box: {error:#}");
            runtime::exit_code(&error)
        }
    }
}
