//! `nims start`, `stop-process`, `restart`, `plug`, `unplug`: sends a request to the supervisor and waits until the
//! process table shows the change.

use command::{Answer, Failure, Output};

use bus::Bus;
use client::{SupervisorCommand, follow, state_name};
use messages::{ProcessState, text_of};
use serde_json::json;

/// Commands that start and end processes while the robot runs.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Start a process: a role such as controller, or a `[[process]]` of the system file.
    Start(StartArgs),
    /// Shut a process down.
    StopProcess {
        /// Name in the process table.
        process: String,
    },
    /// Shut a process down and start it again.
    Restart {
        /// Name in the process table.
        process: String,
    },
    /// Start a program that is not in the system file, e.g. a sensor, as a process of the robot.
    Plug(PlugArgs),
    /// Shut down a process that was plugged in, and remove it from the process table.
    Unplug {
        /// Name in the process table.
        process: String,
    },
}

impl Command {
    /// Sends the request to the supervisor and waits until the process has the requested state.
    ///
    /// # Errors
    /// No supervisor runs, it refuses, or the process does not reach the state in time; each with the reason.
    pub fn run(&self, domain: Option<&str>) -> Answer<Output> {
        let command = match self {
            Self::Start(StartArgs { process, slot, law }) => {
                SupervisorCommand::Start { name: process.clone(), slot: *slot, law: law.clone() }
            }
            Self::StopProcess { process } => SupervisorCommand::Stop { name: process.clone() },
            Self::Restart { process } => SupervisorCommand::Restart { name: process.clone() },
            // A relative path is resolved in the current folder, which is also the program's working folder.
            Self::Plug(PlugArgs { name, replace, command }) => SupervisorCommand::Plug {
                name: name.clone(),
                folder: std::env::current_dir().map_err(Failure::not_now)?,
                command: command.clone(),
                replace: *replace,
            },
            Self::Unplug { process } => SupervisorCommand::Unplug { name: process.clone() },
        };
        send_and_follow(&client::join(domain)?, &command)
    }
}

/// `nims start`.
#[derive(Debug, clap::Args)]
pub struct StartArgs {
    /// A role, a process of the process table, or a `[[process]]` of the system file.
    pub process: String,
    /// Slot of a controller or estimator; default: the first free one.
    #[arg(long, value_enum)]
    pub slot: Option<config::Slot>,
    /// Law of a controller, method of an estimator, or the name of a `[[process]]`; default: as configured.
    #[arg(long)]
    pub law: Option<String>,
}

/// `nims plug`.
#[derive(Debug, clap::Args)]
pub struct PlugArgs {
    /// Name of the process: 1 to 16 of a-z, 0-9, dash.
    pub name: String,
    /// If a process of this name runs: start the new one beside it, and end the old one at the first valid sample of
    /// the new one.
    #[arg(long)]
    pub replace: bool,
    /// Program and arguments, after `--`; {name}, {domain}, {system} and {run} are replaced by the name of the process,
    /// the domain, the system file and the run folder.
    #[arg(last = true, required = true)]
    pub command: Vec<String>,
}

/// Sends a request to the supervisor, waits until the process table shows the change, and returns the result as a
/// sentence.
///
/// # Errors
/// As [`follow`].
pub(crate) fn send_and_follow(bus: &Bus, command: &SupervisorCommand) -> Answer<Output> {
    let row = follow(bus, command, |_| ())?;
    let name = text_of(&row.name);
    let sentence = match row.state {
        ProcessState::STATE_READY => format!("{name} is ready (process {})", row.pid),
        ProcessState::STATE_RUNNING => format!("{name} runs (process {})", row.pid),
        ProcessState::STATE_GONE => format!("{name} is unplugged"),
        _ => format!("{name} has ended"),
    };
    let value =
        json!({ "accepted": true, "answer": sentence, "name": name, "pid": row.pid, "state": state_name(row.state) });
    Ok(Output::new(value, sentence))
}
