//! Entry point of the `nims` command; the library implements it.

use nims::cli::Cli;
use std::process::ExitCode;

fn main() -> ExitCode {
    command::main(std::env::args_os(), |cli: &Cli| cli.json, Cli::run)
}
