//! The start of a program, and its end with the process that started it.

use std::io::{self, ErrorKind};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{SyncSender, sync_channel};

use rustix::fs::Access;
use thiserror::Error;

/// Argument that makes a program answer over its standard input and output instead of the bus.
pub const ARGUMENT: &str = "--lockstep";

/// Starts a program that is to be killed with the one that starts it.
const SETPRIV: &str = "setpriv";
const KILLED_WITH_THE_PARENT: [&str; 3] = ["--pdeathsig", "KILL", "--"];

/// Why a program does not start.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum StartError {
    /// The command, or its first answer, is not that of such a program.
    #[error("{0}")]
    NotOne(String),
    /// It fails, or does not answer in time.
    #[error("{0}")]
    Fails(String),
}

impl StartError {
    /// The failure of the process that starts the program.
    #[must_use]
    pub fn failure(self) -> anyhow::Error {
        match self {
            Self::NotOne(why) => runtime::BadInput(why).into(),
            Self::Fails(why) => anyhow::Error::msg(why),
        }
    }
}

/// Starts the program of a command, from a thread that stays until the keeper is dropped.
pub(crate) fn spawn(
    role: &str,
    command: &str,
    system: &Path,
    in_flight: bool,
) -> Result<(Child, SyncSender<()>), StartError> {
    let mut words = command.split_whitespace();
    let Some(program) = words.next() else {
        return Err(StartError::NotOne(format!("the command of the {role}'s program is empty; give its path")));
    };
    let mut start = ending_with_this_process(program);
    start.args(words).args([ARGUMENT, "--system"]).arg(system).stdin(Stdio::piped()).stdout(Stdio::piped());
    kept(start, in_flight).map_err(|error| {
        let why = format!("the {role}'s program {program} does not start: {error}");
        match error.kind() {
            ErrorKind::NotFound | ErrorKind::PermissionDenied => StartError::NotOne(why),
            _ => StartError::Fails(why),
        }
    })
}

/// A program that the kernel kills with the thread that started it, also where this process is killed: one that never
/// reads does not see that its pipe is closed. What the program itself starts is not killed. Without a `setpriv` of
/// util-linux, or where the program cannot be run, it is started as it is.
fn ending_with_this_process(program: &str) -> Command {
    let is_runnable = |path: &Path| path.is_file() && rustix::fs::access(path, Access::EXEC_OK).is_ok();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let runs = if program.contains('/') {
        is_runnable(Path::new(program))
    } else {
        std::env::split_paths(&path).any(|folder| is_runnable(&folder.join(program)))
    };
    // Other programs of this name have no such option.
    let has_option = || Command::new(SETPRIV).args(KILLED_WITH_THE_PARENT).arg("true").stderr(Stdio::null()).status();
    if !(runs && has_option().is_ok_and(|status| status.success())) {
        return Command::new(program);
    }
    let mut start = Command::new(SETPRIV);
    start.args(KILLED_WITH_THE_PARENT).arg(program);
    start
}

/// Starts a program from a thread that stays until the keeper is dropped: the program ends with it. In flight it has
/// ordinary scheduling: from the control thread it would inherit priority and processor, and a program that computes
/// without end would take them from motor-io.
fn kept(mut command: Command, in_flight: bool) -> io::Result<(Child, SyncSender<()>)> {
    let (started, child) = sync_channel(1);
    let (keeper, until) = sync_channel::<()>(0);
    std::thread::spawn(move || {
        if in_flight {
            runtime::realtime::ordinary();
        }
        if started.send(command.spawn()).is_ok() {
            let _ = until.recv();
        }
    });
    let child = child.recv().unwrap_or_else(|_| Err(io::Error::other("its thread has ended")))?;
    Ok((child, keeper))
}
