//! `nims up`: starts every process of a robot, watches them, and ends them.

use clap::Parser;
use std::process::ExitCode;
use supervisor::Args;

/// Start every process of a system and watch them; Ctrl-C holds the robot, stops them and closes the run file.
#[derive(Debug, Parser)]
#[command(name = "nims up", version = runtime::build::description())]
struct Cli {
    #[command(flatten)]
    args: Args,
    /// The robot's domain: the name of its system, or the path of a folder; default: the name in the system file.
    #[arg(long, value_name = "NAME")]
    domain: Option<String>,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    command::main(
        std::env::args_os(),
        |cli: &Cli| cli.json,
        |cli| supervisor::run(&cli.args, cli.domain.as_deref()).map(Some),
    )
}
