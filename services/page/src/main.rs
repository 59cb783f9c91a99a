//! The page of a robot; see the library.

use command::{Answer, Output};
use page::settings::{Args, Command};
use std::process::ExitCode;

fn main() -> ExitCode {
    command::main(std::env::args_os(), |args: &Args| args.json, run)
}

fn run(args: &Args) -> Answer<Option<Output>> {
    match &args.command {
        Command::Serve(serve) => page::serve(serve, &args.place).map(|()| None),
        Command::Start(start) => page::start(start, &args.place, args.json).map(|()| None),
        Command::Pair(pair) => page::pair(pair, &args.place).map(Some),
        Command::Tokens => page::tokens(&args.place).map(Some),
        Command::Revoke { holder } => page::revoke(holder, &args.place).map(Some),
    }
}
