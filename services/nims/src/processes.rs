//! `nims start`, `stop-process`, `restart`, `plug`, `unplug`: sends a request to the supervisor and waits until the
//! process table shows the change.

use command::{Answer, Failure, Output};

use client::{Place, RobotLink, follow, state_name};
use messages::{ProcessState, Request, text_of};
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
    pub fn run(&self, place: Place<'_>) -> Answer<Output> {
        let command = match self {
            Self::Start(StartArgs { process, slot, law }) => {
                Request::StartProcess { name: process.clone(), slot: *slot, law: law.clone() }
            }
            Self::StopProcess { process } => Request::StopProcess { name: process.clone() },
            Self::Restart { process } => Request::RestartProcess { name: process.clone() },
            // A relative path is resolved in the current folder, which is also the program's working folder.
            Self::Plug(PlugArgs { name, replace, command }) => Request::Plug {
                name: name.clone(),
                folder: present_folder()?,
                command: command.clone(),
                replace: *replace,
            },
            Self::Unplug { process } => Request::Unplug { name: process.clone() },
        };
        let output = send_and_follow(&client::link(place)?, &command)?;
        if let Request::Plug { name, .. } = &command {
            eprintln!(
                "warning: {name} has the same rights as the robot: it can read and write its shared memory; as a [[plugin]] of \
                 the system file, a service runs it as another user (docs/access.md)"
            );
        }
        Ok(output)
    }
}

/// `nims start`.
#[derive(Debug, clap::Args)]
pub struct StartArgs {
    /// A role, a process of the process table, or a `[[process]]` of the system file.
    pub process: String,
    /// Slot of a controller or estimator; default: the first free one.
    #[arg(long, value_parser = config::slot_argument())]
    pub slot: Option<messages::Slot>,
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

/// Returns the current folder.
fn present_folder() -> Answer<String> {
    let folder = std::env::current_dir().map_err(Failure::not_now)?;
    folder.into_os_string().into_string().map_err(|folder| {
        let folder = folder.display();
        Failure::BadInput(format!("the name of the folder {folder} is not UTF-8; start from another one"))
    })
}

/// Sends a request to the supervisor, waits until the process table shows the change, and returns the result as a
/// sentence.
///
/// # Errors
/// As [`follow`].
pub(crate) fn send_and_follow(link: &RobotLink, command: &Request) -> Answer<Output> {
    let row = follow(link, command, |_| ())?;
    let name = text_of(&row.name);
    let sentence = match row.state {
        // A plug-in, which the service manager runs.
        ProcessState::STATE_RUNNING if row.pid == 0 => text_of(&row.reason),
        ProcessState::STATE_READY => format!("{name} is ready (process {})", row.pid),
        ProcessState::STATE_RUNNING => format!("{name} runs (process {})", row.pid),
        ProcessState::STATE_GONE => format!("{name} is unplugged"),
        _ => format!("{name} has ended"),
    };
    let value =
        json!({ "accepted": true, "answer": sentence, "name": name, "pid": row.pid, "state": state_name(row.state) });
    Ok(Output::new(value, sentence))
}
