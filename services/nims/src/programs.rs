//! Programs in the same folder as `nims`: `nims up` runs the supervisor, and `nims X` runs `nims-X` if X is not built
//! in, as git and cargo do.

use client::Place;
use command::{Answer, Failure};
use std::ffi::{OsStr, OsString};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The programs `nims-X` that come with nims: X, and what it does.
pub const COMPANIONS: [(&str, &str); 6] = [
    ("bench", "Measure whether this machine is good enough for a robot"),
    ("drive-capture", "Record what a drive says on its serial port, or answer as it did"),
    ("page", "Show and fly a robot on a tablet"),
    ("paper", "Compute every figure and table of the paper"),
    ("sim", "Fly a virtual robot much faster than real time: laws, parameters and worlds side by side"),
    ("truth", "Draw a plausible world for the virtual motor box that is not the robot's model"),
];

/// Replaces this process by the supervisor. Returns only if that fails.
pub fn run_supervisor(arguments: &[OsString], place: Place<'_>, json: bool) -> Failure {
    match sibling("supervisor") {
        Ok(path) => become_program(&path, arguments, place, json),
        Err(failure) => failure,
    }
}

/// Replaces this process by the program `nims-X`. Returns only if that fails.
pub fn run_external(words: &[OsString], place: Place<'_>, json: bool) -> Failure {
    let Some((name, arguments)) = words.split_first() else { return unknown(OsStr::new("")) };
    let plain = |name: &&str| name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-');
    match name.to_str().filter(plain).map(|name| sibling(&format!("nims-{name}"))) {
        Some(Ok(path)) => become_program(&path, arguments, place, json),
        _ => unknown(name),
    }
}

fn unknown(name: &OsStr) -> Failure {
    let name = name.to_string_lossy();
    Failure::BadInput(format!(
        "there is no command `{name}`, and no program nims-{name}; `nims --help` lists the commands"
    ))
}

/// Returns the path of a program in the folder of this one.
///
/// # Errors
/// The program was not built or not installed.
pub fn sibling(name: &str) -> Answer<PathBuf> {
    let path = std::env::current_exe().map_err(Failure::not_now)?.with_file_name(name);
    if path.is_file() {
        return Ok(path);
    }
    let path = path.display();
    Err(Failure::NotNow(format!("there is no program {path}: build all programs with `cargo build --workspace`")))
}

fn become_program(path: &Path, arguments: &[OsString], place: Place<'_>, json: bool) -> Failure {
    let error = command(path, arguments, place, json).exec();
    Failure::NotNow(format!("{} cannot be run: {error}", path.display()))
}

/// The program with the options of `nims` before its own arguments; one that has no such option refuses it.
fn command(path: &Path, arguments: &[OsString], place: Place<'_>, json: bool) -> Command {
    let mut command = Command::new(path);
    command.args(place.domain.into_iter().flat_map(|domain| ["--domain", domain]));
    command.args(place.gateway.into_iter().flat_map(|socket| [OsStr::new("--gateway"), socket.as_os_str()]));
    command.args(json.then_some("--json")).args(arguments);
    command
}

/// Answers the requests of `nims solve` until the input ends.
///
/// # Errors
/// Standard input cannot be read, or standard output cannot be written.
pub fn solve() -> Answer {
    solve::serve(std::io::stdin(), std::io::stdout().lock()).map_err(Failure::not_now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_companion_gets_the_options_of_nims() {
        let words = ["revoke".into(), "ada".into()];
        let place = Place { domain: Some("lab"), gateway: Some(Path::new("/run/nims-gateway/lab.sock")) };
        let given = |place, json| {
            let command = command(Path::new("nims-page"), &words, place, json);
            command.get_args().map(|arg| arg.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(given(place, true), "--domain lab --gateway /run/nims-gateway/lab.sock --json revoke ada");
        assert_eq!(given(Place::default(), false), "revoke ada");
    }
}
