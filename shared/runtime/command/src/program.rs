//! From the arguments of a program to its exit code.

use crate::{Answer, Failure, Output};
use clap::Parser;
use std::ffi::OsString;
use std::process::ExitCode;

/// Parses the arguments, runs the command, prints its output once, and says in one sentence what went wrong.
///
/// `json` tells from the arguments whether JSON is wanted. A command that has printed everything itself returns `None`.
pub fn main<C: Parser>(
    args: impl IntoIterator<Item = OsString>,
    json: impl Fn(&C) -> bool,
    run: impl FnOnce(&C) -> Answer<Option<Output>>,
) -> ExitCode {
    let command = C::command();
    let name = command.get_name();
    // `nims up` is a program of its own, and speaks as nims.
    let speaker = name.split(' ').next().unwrap_or(name);
    let cli = match C::try_parse_from(args) {
        Ok(cli) => cli,
        Err(error) if error.exit_code() == 0 => {
            // --help and --version
            let _ = error.print();
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("{speaker}: {}", usage(&error, name));
            return ExitCode::from(2);
        }
    };
    let failure = match run(&cli) {
        Ok(output) => output.and_then(|output| {
            output.print(json(&cli));
            output.failure
        }),
        Err(failure) => Some(failure),
    };
    match failure {
        None => ExitCode::SUCCESS,
        Some(failure) => {
            eprintln!("{speaker}: {failure}");
            ExitCode::from(Failure::exit_code(&failure))
        }
    }
}

/// The first paragraph of clap's message about wrong arguments, on one line.
fn usage(error: &clap::Error, name: &str) -> String {
    use clap::error::ErrorKind;
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return format!("say what to do; `{name} --help` lists the commands");
    }
    let text = error.to_string();
    let first: Vec<&str> =
        text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more")).collect();
    let sentence = first.join(" ").split_whitespace().collect::<Vec<_>>().join(" ");
    format!("{}; `{name} --help` lists the commands", sentence.trim_start_matches("error: "))
}
