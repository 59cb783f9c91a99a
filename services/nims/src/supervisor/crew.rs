//! Which processes a box needs, in the order in which they start, and what the death of each means.

use crate::failure::{Answer, Failure};
use service::config::{BoxFile, Role};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A process to be started.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    /// Unique name.
    pub name: String,
    /// What it does.
    pub role: Role,
    /// The program.
    pub program: PathBuf,
    /// Its arguments.
    pub args: Vec<OsString>,
    /// Start it again when it dies.
    pub restart: bool,
    /// Waits for a heartbeat that says it is ready. A program that is not ours may never send one.
    pub beats: bool,
}

impl Member {
    /// Whether the robot cannot go on without it.
    #[must_use]
    pub fn is_vital(&self) -> bool {
        !matches!(self.role, Role::Recorder | Role::Other)
    }
}

/// The name of a role, as it stands in the process table.
#[must_use]
pub fn role_name(role: Role) -> &'static str {
    match role {
        Role::MotorBox => "motor-box",
        Role::MotorIo => "motor-io",
        Role::Estimator => "estimator",
        Role::Controller => "controller",
        Role::Planner => "planner",
        Role::Recorder => "recorder",
        Role::Other => "other",
    }
}

/// What happens when a process of this role dies, for the operator.
#[must_use]
pub fn consequence(role: Role, watchdog_s: f64) -> String {
    match role {
        Role::MotorBox => {
            "the virtual drives are gone, so motor-io reports a fault; start again with `nims up`".to_owned()
        }
        Role::MotorIo => format!(
            "the drives stop the motors after {watchdog_s} s; start again with `nims up`, which comes up disarmed"
        ),
        Role::Estimator | Role::Controller => {
            "the robot stops on the path and holds; end with Ctrl-C and start again".to_owned()
        }
        Role::Planner => "the robot finishes the current segment and holds; end with Ctrl-C and start again".to_owned(),
        Role::Recorder => "the mission goes on, and what happens until it is back is not recorded".to_owned(),
        Role::Other => "the mission goes on without it".to_owned(),
    }
}

/// The crew of a box: recorder first, so that nothing is missed, then upstream before downstream.
///
/// # Errors
/// A program that is not there.
pub fn crew(file: &BoxFile, box_path: &Path, domain: &str, run: &Path) -> Answer<Vec<Member>> {
    let mut order =
        vec![Role::Recorder, Role::MotorBox, Role::MotorIo, Role::Estimator, Role::Controller, Role::Planner];
    if file.motor_box.is_none() {
        order.retain(|role| *role != Role::MotorBox);
    }
    let mut members = Vec::new();
    for role in order {
        let name = role_name(role);
        let replaced = file.process.iter().find(|process| process.role == role);
        let (program, mut args) = match replaced {
            Some(process) => program(&process.command)?,
            None => (beside_us(name)?, Vec::new()),
        };
        args.extend(["--box".into(), box_path.into(), "--name".into(), name.into(), "--domain".into(), domain.into()]);
        if role == Role::Recorder {
            args.extend(["--run".into(), run.into()]);
        }
        // A recorder that comes back begins a new file beside the one that recovery closes.
        let restart = role == Role::Recorder || replaced.is_some_and(|process| process.restart);
        members.push(Member { name: name.to_owned(), role, program, args, restart, beats: true });
    }
    for process in file.process.iter().filter(|process| process.role == Role::Other) {
        let (program, args) = program(&process.command)?;
        members.push(Member {
            name: process.name.clone(),
            role: Role::Other,
            program,
            args,
            restart: process.restart,
            beats: false,
        });
    }
    Ok(members)
}

/// A configured command: the program, looked for beside this one if it has no slash, and its arguments.
fn program(command: &[String]) -> Answer<(PathBuf, Vec<OsString>)> {
    let Some((first, rest)) = command.split_first() else {
        return Err(Failure::BadInput("`command` of a process is empty; give a program and its arguments".to_owned()));
    };
    let program = if first.contains('/') { PathBuf::from(first) } else { beside_us(first)? };
    if !program.is_file() {
        return Err(Failure::BadInput(format!("there is no program {}, which a [[process]] names", program.display())));
    }
    Ok((program, rest.iter().map(OsString::from).collect()))
}

fn beside_us(name: &str) -> Answer<PathBuf> {
    let own = std::env::current_exe().map_err(Failure::not_now)?;
    let path = own.with_file_name(name);
    if path.is_file() {
        Ok(path)
    } else {
        Err(Failure::NotNow(format!(
            "there is no program {}: build all of them with `cargo build --workspace`",
            path.display()
        )))
    }
}
