//! `nims paper`: every figure and table of the paper, computed by this code.

use clap::Parser;
use nims_paper::Args;
use std::process::ExitCode;

/// Every figure and table of the paper from this code, on one page with what the paper claims.
#[derive(Debug, Parser)]
#[command(name = "nims paper", version = runtime::build::own())]
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
