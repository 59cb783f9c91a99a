//! The program `nims bench`.

use clap::Parser;
use nims_bench::{Args, peer};
use std::process::ExitCode;

/// Measure whether this machine is suitable for a robot, each figure compared with a plain alternative.
#[derive(Debug, Parser)]
#[command(name = "nims bench", version = runtime::build::description())]
struct Cli {
    #[command(flatten)]
    args: Args,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    let mut given = std::env::args().skip(1);
    if given.next().as_deref() == Some(peer::COMMAND) {
        return match peer::serve(&given.next().unwrap_or_default()) {
            Ok(()) => ExitCode::SUCCESS,
            Err(failure) => {
                eprintln!("nims: {failure}");
                ExitCode::from(failure.exit_code())
            }
        };
    }
    command::main(std::env::args_os(), |cli: &Cli| cli.json, |cli| nims_bench::run(&cli.args).map(Some))
}
