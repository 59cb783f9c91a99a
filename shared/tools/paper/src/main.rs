//! The program `nims paper`.

use clap::Parser;
use nims_paper::Args;
use std::process::ExitCode;

/// Reproduce every figure and table of the paper on one page, with the paper's claims.
#[derive(Debug, Parser)]
#[command(name = "nims paper", version = runtime::build::description())]
struct Cli {
    #[command(flatten)]
    args: Args,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    command::main(std::env::args_os(), |cli: &Cli| cli.json, |cli| nims_paper::run(&cli.args).map(Some))
}
