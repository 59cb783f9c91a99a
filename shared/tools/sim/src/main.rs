//! The program `nims sim`.
#![forbid(unsafe_code)]

use clap::Parser;
use nims_sim::Args;
use std::process::ExitCode;

/// Fly a virtual robot without processes, much faster than real time: laws, parameters and worlds side by side.
#[derive(Debug, Parser)]
#[command(name = "nims sim", version = runtime::build::description())]
struct Cli {
    #[command(flatten)]
    args: Args,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    command::main(std::env::args_os(), |cli: &Cli| cli.json, |cli| nims_sim::run(&cli.args).map(Some))
}
