//! The command line: the commands with their arguments, and their dispatch.

use crate::{
    channels, closed_runs, demo, fault, fetch, groups, operate, processes, programs, set, status, swap, top,
    visualization_export,
};
use clap::{Parser, Subcommand};
use client::Place;
use command::values::seconds;
use command::{Answer, Output};
use std::ffi::OsString;
use std::path::PathBuf;

/// Run, watch and command a cable-suspended robot.
///
/// Exit code 0: answered; 2: bad input; 1: it could not be done now. Diagnostics go to stderr.
#[derive(Debug, Parser)]
#[command(name = "nims", version = runtime::build::description(), propagate_version = true, help_template = groups::TEMPLATE, before_help = help())]
pub struct Cli {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
    /// The robot's domain: the name of its system, or the path of a folder; default: that of the only running robot.
    #[arg(long, global = true, value_name = "NAME")]
    pub domain: Option<String>,
    /// Socket of the robot's gateway; default: only where this user cannot join the robot, found in /run/nims-gateway.
    #[arg(long, global = true, value_name = "SOCKET")]
    pub gateway: Option<PathBuf>,
    /// Print one JSON object on stdout.
    #[arg(long, global = true)]
    pub json: bool,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Start a robot on the virtual motor box, fly a mission, write the report, and stop the robot.
    Demo(demo::Args),
    /// Start every process of a system and monitor them; Ctrl-C holds the robot, stops them and closes the run file.
    #[command(disable_help_flag = true, disable_version_flag = true)]
    Up {
        /// System file and options; `nims up --help` lists them.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
        arguments: Vec<OsString>,
    },
    /// Show the state of the robot and its processes.
    Status,
    /// Show the robot and its processes live in the terminal; q quits.
    Top,
    /// List, count and print channels.
    #[command(subcommand)]
    Channel(channels::Command),
    /// Commands that move the robot or bring it to rest.
    #[command(flatten)]
    Operate(operate::Command),
    /// Commands that start and end processes.
    #[command(flatten)]
    Processes(processes::Command),
    /// Replace the controller or estimator in charge while the robot moves.
    Swap(swap::Args),
    /// Set a parameter of all controllers or estimators while the robot runs, until the run ends; without a value, show
    /// it.
    #[command(after_help = set::help())]
    Set(set::Args),
    /// Cause a fault in the virtual motor box or in a process; `nims fault list` lists the faults.
    Fault {
        /// The fault: `list`, or e.g. `stall 2`, `noise 1 0.01`, `stop controller`, `nan estimator`.
        #[arg(required = true, allow_negative_numbers = true)]
        words: Vec<String>,
        /// End the fault after this many seconds.
        #[arg(long = "for", value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
        seconds: Option<f64>,
    },
    /// Commands for use before the first flight, and the starts of new programs.
    #[command(flatten)]
    Commissioning(commissioning::Command),
    /// Evaluate the project's formulas for programs in any language: one JSON object per line in, one per line out.
    Solve,
    /// Commands for recorded runs.
    #[command(flatten)]
    Analysis(analysis::Command),
    /// Write the channels of a run, of any type, as tables for other tools: one file per channel.
    Export(ExportArgs),
    /// Compute a recorded run again and compare every bit; with --law or --set: compute the commands of another law or
    /// parameter.
    Replay(replay::Args),
    /// List the finished runs of a robot with a gateway, or those in a folder with verdicts and trends.
    Runs {
        /// Folder of runs; default: the gateway's, or `runs` in the current folder.
        folder: Option<PathBuf>,
    },
    /// Copy a finished run from a robot with a gateway.
    Fetch(fetch::Args),
    /// Create, list and revoke tokens, with which a program acts through the gateway for a person.
    #[command(subcommand)]
    Token(fetch::TokenCommand),
    /// Run the program nims-X as `nims X`.
    #[command(external_subcommand)]
    Program(Vec<OsString>),
}

/// Returns the commands in groups, with their descriptions.
fn help() -> String {
    let described = Command::augment_subcommands(clap::Command::new("nims"));
    let about = |command: &clap::Command| command.get_about().map(ToString::to_string).unwrap_or_default();
    let commands: Vec<_> =
        described.get_subcommands().map(|command| (command.get_name().to_owned(), about(command))).collect();
    groups::text(&commands)
}

/// `nims export`: writes tables, or one file with a visualization.
#[derive(Debug, clap::Args)]
pub struct ExportArgs {
    #[command(flatten)]
    tables: analysis::export::Args,
    /// Instead of tables: write the visualization for Foxglove, Lichtblick, RViz and rerun to this new file.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["out", "format", "channel", "from", "to"])]
    visualization: Option<PathBuf>,
}

impl ExportArgs {
    fn run(&self) -> Answer<Output> {
        match &self.visualization {
            Some(file) => visualization_export::export_visualization(&self.tables.run, file),
            None => analysis::export::run(&self.tables),
        }
    }
}

impl Cli {
    /// Runs the command. Returns `None` if the command has printed its output itself.
    ///
    /// # Errors
    /// The command failed: one sentence.
    pub fn run(&self) -> Answer<Option<Output>> {
        let domain = self.domain.as_deref();
        let place = Place { domain, gateway: self.gateway.as_deref() };
        let output = match &self.command {
            Command::Demo(args) => return demo::run(args, domain).map(Some),
            Command::Up { arguments } => return Err(programs::run_supervisor(arguments, place, self.json)),
            Command::Program(words) => return Err(programs::run_external(words, place, self.json)),
            Command::Top => return top::top(place, self.json).map(|()| None),
            Command::Solve => return programs::solve().map(|()| None),
            Command::Channel(command) => return command.run(place),
            Command::Status => status::status(&client::link(place)?),
            Command::Operate(command) => command.run(place),
            Command::Processes(command) => command.run(place),
            Command::Swap(args) => swap::run(place, args),
            Command::Set(args) => set::set(place, args),
            Command::Fault { words, seconds } => fault::fault(place, words, *seconds),
            Command::Commissioning(command) => command.run(place),
            Command::Analysis(command) => closed_runs::run(place, command),
            Command::Runs { folder } => fetch::runs(place, folder.as_deref()),
            Command::Fetch(args) => fetch::fetch(place, args),
            Command::Token(command) => command.run(place),
            Command::Export(args) => args.run(),
            Command::Replay(args) => replay::replay(args),
        };
        output.map(Some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn negative_coordinates_are_not_taken_for_options() {
        for line in
            [&["nims", "goto", "-1,2,0.5"][..], &["nims", "zero", "--at", "-1,2,0.5"], &["nims", "jog", "1", "-0.1"]]
        {
            assert!(Cli::try_parse_from(line).is_ok(), "{line:?}");
        }
    }
}
