//! The main function of a program: arguments to exit code.

use crate::{Answer, Failure, Output, print_line};
use clap::{CommandFactory, FromArgMatches, Parser};
use std::ffi::OsString;
use std::process::ExitCode;

/// Parses the arguments, runs the command, prints its output once, and reports a failure in one sentence.
///
/// `json` returns whether the arguments request JSON. A command that has printed its output itself returns `None`.
pub fn main<C: Parser>(
    args: impl IntoIterator<Item = OsString>,
    json: impl Fn(&C) -> bool,
    run: impl FnOnce(&C) -> Answer<Option<Output>>,
) -> ExitCode {
    execute(C::command(), args, json, run)
}

/// A program of one command: its own arguments, and `--json`.
#[derive(Parser)]
struct Tool<A: clap::Args> {
    #[command(flatten)]
    args: A,
    /// Print one JSON object on stdout.
    #[arg(long)]
    json: bool,
}

/// Runs a program of one command, as [`main`] does. `about` is its description in the help.
pub fn tool<A: clap::Args>(
    name: &'static str,
    version: &'static str,
    about: &'static str,
    run: impl FnOnce(&A) -> Answer<Output>,
) -> ExitCode {
    let command = Tool::<A>::command().name(name).version(version).about(about);
    execute(command, std::env::args_os(), |tool: &Tool<A>| tool.json, |tool| run(&tool.args).map(Some))
}

fn execute<C: FromArgMatches>(
    command: clap::Command,
    args: impl IntoIterator<Item = OsString>,
    json: impl Fn(&C) -> bool,
    run: impl FnOnce(&C) -> Answer<Option<Output>>,
) -> ExitCode {
    let name = command.get_name().to_owned();
    let name = name.as_str();
    // `nims up` is a separate program, but its messages start with `nims`.
    let prefix = name.split(' ').next().unwrap_or(name);
    let args: Vec<OsString> = args.into_iter().collect();
    let help = help_of(&command, &args);
    let cli = match command.try_get_matches_from(args).and_then(|given| C::from_arg_matches(&given)) {
        Ok(cli) => cli,
        Err(error) if error.exit_code() == 0 => {
            // --help and --version
            let _ = error.print();
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("{prefix}: {}", usage(&error, &help));
            return ExitCode::from(2);
        }
    };
    let failure = match run(&cli) {
        Ok(output) => output.and_then(|output| {
            output.print(json(&cli));
            output.failure
        }),
        Err(failure) => {
            if let Some(value) = failure.to_json().filter(|_| json(&cli)) {
                let _ = print_line(&value.to_string());
            }
            Some(failure)
        }
    };
    match failure {
        None => ExitCode::SUCCESS,
        Some(failure) => {
            eprintln!("{prefix}: {failure}");
            ExitCode::from(Failure::exit_code(&failure))
        }
    }
}

/// Returns the clause that names the help of the command in these arguments.
fn help_of(command: &clap::Command, args: &[OsString]) -> String {
    let (mut command, mut path) = (command, command.get_name().to_owned());
    for word in args.iter().skip(1) {
        let Some(inner) = command.find_subcommand(word) else { continue };
        command = inner;
        path = format!("{path} {}", inner.get_name());
    }
    let what = if command.has_subcommands() { "lists the commands" } else { "explains the command" };
    format!("`{path} --help` {what}")
}

/// Returns the first paragraph of clap's message about wrong arguments, on one text line.
fn usage(error: &clap::Error, help: &str) -> String {
    use clap::error::ErrorKind;
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return format!("the command is missing; {help}");
    }
    let text = error.to_string();
    let first: Vec<&str> =
        text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more")).collect();
    let sentence = first.join(" ").split_whitespace().collect::<Vec<_>>().join(" ");
    format!("{}; {help}", sentence.trim_start_matches("error: "))
}
