//! The page of a robot; see the library.

use command::Answer;
use page::settings::{Args, Command};
use std::process::ExitCode;

fn main() -> ExitCode {
    command::main(std::env::args_os(), |_: &Args| false, |args| run(args).map(|()| None))
}

fn run(args: &Args) -> Answer {
    match &args.command {
        Command::Serve(serve) => page::serve(serve, &args.place),
        Command::Start(start) => page::start(start, &args.place),
        Command::Pair(pair) => page::pair(pair, &args.place),
        Command::Tokens => page::tokens(&args.place),
        Command::Revoke { holder } => page::revoke(holder, &args.place),
    }
}
