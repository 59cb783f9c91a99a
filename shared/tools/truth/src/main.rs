//! The program `nims truth`.
#![forbid(unsafe_code)]

use clap::Parser;
use nims_truth::Args;
use std::process::ExitCode;

/// Draw a plausible world that is not the robot's model, for the virtual motor box.
#[derive(Debug, Parser)]
#[command(name = "nims truth", version = runtime::build::description())]
struct Cli {
    #[command(flatten)]
    args: Args,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    command::main(std::env::args_os(), |cli: &Cli| cli.json, |cli| nims_truth::run(&cli.args).map(Some))
}
