//! Serves operators who are not the robot's user; see the library.

use command::Answer;
use gateway::Server;
use gateway::settings::{Args, Settings};
use std::process::ExitCode;

fn main() -> ExitCode {
    command::main(std::env::args_os(), |_: &Args| false, |args| run(args).map(|()| None))
}

fn run(args: &Args) -> Answer {
    bus::make_private();
    let settings = Settings::new(args)?;
    if let Some(plugin) = &args.plugin {
        return gateway::exec(args, plugin, &settings.socket);
    }
    let stop = command::stop_flag()?;
    Server::open(&settings)?.run(&stop)
}
