//! `nims start`, `stop-process`, `restart`, `plug`, `unplug`: asks the supervisor, and follows the process table until it has come about.

use command::{Answer, Failure, Output};

use bus::Bus;
use client::{SupervisorCommand, follow, state_name};
use messages::{ProcessState, text_of};
use serde_json::json;

/// Processes that come and go while the robot runs.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Start a process: a role such as controller, or a `[[process]]` of the system file.
    Start(StartArgs),
    /// End a process in good order.
    StopProcess {
        /// Its name in the process table.
        process: String,
    },
    /// End a process in good order and start it again.
    Restart {
        /// Its name in the process table.
        process: String,
    },
    /// Start a program that the system file does not know, e.g. a sensor, as one of the robot's processes.
    Plug(PlugArgs),
    /// End a process that was plugged in, and forget it.
    Unplug {
        /// Its name in the process table.
        process: String,
    },
}

impl Command {
    /// Asks the supervisor and follows the process table until the process is where it was asked to be.
    ///
    /// # Errors
    /// No supervisor, refused, or it does not come about: why.
    pub fn run(&self, domain: Option<&str>) -> Answer<Output> {
        let asked = match self {
            Self::Start(StartArgs { process, slot, law }) => {
                SupervisorCommand::Start { name: process.clone(), slot: *slot, law: law.clone() }
            }
            Self::StopProcess { process } => SupervisorCommand::Stop { name: process.clone() },
            Self::Restart { process } => SupervisorCommand::Restart { name: process.clone() },
            // A program with a slash is looked for from the present folder, where it runs too.
            Self::Plug(PlugArgs { name, replace, command }) => SupervisorCommand::Plug {
                name: name.clone(),
                folder: std::env::current_dir().map_err(Failure::not_now)?,
                command: command.clone(),
                replace: *replace,
            },
            Self::Unplug { process } => SupervisorCommand::Unplug { name: process.clone() },
        };
        tell(&client::join(domain)?, &asked)
    }
}

/// `nims start`.
#[derive(Debug, clap::Args)]
pub struct StartArgs {
    /// A role, the name of a process in the process table, or a `[[process]]` of the system file.
    pub process: String,
    /// For a controller or an estimator: which slot; default: the first free one.
    #[arg(long, value_enum)]
    pub slot: Option<config::Slot>,
    /// For a controller or an estimator: which law, or which `[[process]]`; default: as configured.
    #[arg(long)]
    pub law: Option<String>,
}

/// `nims plug`.
#[derive(Debug, clap::Args)]
pub struct PlugArgs {
    /// What it shall be called: 1 to 16 of a-z, 0-9, dash.
    pub name: String,
    /// If a process of that name runs: start this one beside it, and end the other when this one has said its first valid sample.
    #[arg(long)]
    pub replace: bool,
    /// Program and arguments, behind `--`; {name}, {domain}, {system} and {run} stand for its name, the robot's domain, the system file, the run folder.
    #[arg(last = true, required = true)]
    pub command: Vec<String>,
}

/// Asks, follows, and says in one sentence what came of it.
///
/// # Errors
/// As [`follow`].
pub(crate) fn tell(bus: &Bus, asked: &SupervisorCommand) -> Answer<Output> {
    let row = follow(bus, asked, |_| ())?;
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
