//! `nims runs` and `nims fetch`: finished runs of a robot whose folder of runs is closed to this user.

use client::{Gateway, Place};
use command::{Answer, Failure, Output};
use serde_json::json;
use std::fs::{self, File};
use std::io::{self, IsTerminal, Read, Write};
use std::path::{Path, PathBuf};

/// Bytes that are copied at once.
const PIECE: usize = 1 << 20;

/// `nims fetch`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the run, as `nims runs` lists it.
    pub run: String,
    /// New folder for the copy; default: the name of the run in the current folder.
    pub dest: Option<PathBuf>,
}

/// Lists the finished runs.
///
/// # Errors
/// There is no gateway, or it does not answer.
pub fn runs(place: Place<'_>) -> Answer<Output> {
    let runs = client::gateway(place)?.runs()?;
    let width = runs.iter().map(|run| run.name.len()).max().unwrap_or(0);
    let line = |run: &client::RunRow| {
        format!("{:width$}  {:4} files  {:9.1} MB", run.name, run.files, run.bytes as f64 * 1e-6)
    };
    let words = if runs.is_empty() {
        "no finished run".to_owned()
    } else {
        runs.iter().map(line).collect::<Vec<_>>().join("\n")
    };
    let rows: Vec<_> =
        runs.iter().map(|run| json!({ "name": run.name, "files": run.files, "bytes": run.bytes })).collect();
    Ok(Output::new(json!({ "runs": rows }), words))
}

/// Copies a finished run.
///
/// # Errors
/// There is no such run, the destination exists, or a file cannot be copied whole.
pub fn fetch(place: Place<'_>, args: &Args) -> Answer<Output> {
    let dest = args.dest.clone().unwrap_or_else(|| PathBuf::from(&args.run));
    if dest.exists() {
        return Err(Failure::BadInput(format!("{} exists already; give another folder", dest.display())));
    }
    let (files, all) = copy_run(&client::gateway(place)?, &args.run, &dest)?;
    let sentence = format!("{}: {files} files, {:.1} MB", dest.display(), all as f64 * 1e-6);
    Ok(Output::new(json!({ "run": dest, "files": files, "bytes": all }), sentence))
}

/// Copies a finished run to a new folder through its gateway; returns the number of files and their bytes.
///
/// # Errors
/// There is no such run, or a file cannot be copied whole.
pub(crate) fn copy_run(gateway: &Gateway, run: &str, dest: &Path) -> Answer<(usize, u64)> {
    let files = gateway.files(run)?;
    let all: u64 = files.iter().map(|file| file.bytes).sum();
    // Under another name until it is whole.
    let part = with_ending(dest, ".part");
    let failed = |what: &Path, error: io::Error| Failure::NotNow(format!("{}: {error}", what.display()));
    begin(&part).map_err(|error| failed(&part, error))?;
    let mut progress = Progress { done: 0, all, shown: 0, terminal: io::stderr().is_terminal() };
    for file in &files {
        let to = part.join(safe(&file.name)?);
        let from = gateway.open(run, &file.name)?;
        if let Some(folder) = to.parent() {
            fs::create_dir_all(folder).map_err(|error| failed(folder, error))?;
        }
        let copied = copy(from, &to, &mut progress).map_err(|error| failed(&to, error))?;
        if copied != file.bytes {
            return Err(Failure::NotNow(format!(
                "{} has {copied} bytes instead of {}; fetch the run again",
                to.display(),
                file.bytes
            )));
        }
    }
    fs::rename(&part, dest).map_err(|error| failed(dest, error))?;
    Ok((files.len(), all))
}

/// Creates the folder of a copy, without what an earlier attempt has left there.
fn begin(part: &Path) -> io::Result<()> {
    match fs::remove_dir_all(part) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    fs::create_dir_all(part)
}

/// Returns the path of a file below the destination.
fn safe(name: &str) -> Answer<&Path> {
    let path = Path::new(name);
    let plain = path.components().all(|part| matches!(part, std::path::Component::Normal(_)));
    if plain && !name.is_empty() {
        Ok(path)
    } else {
        Err(Failure::NotNow(format!("the gateway names a file {name:?}, which lies outside of the run")))
    }
}

fn copy(mut from: File, to: &Path, progress: &mut Progress) -> io::Result<u64> {
    let mut into = File::create_new(to)?;
    let (mut piece, mut copied) = (vec![0; PIECE], 0);
    loop {
        let length = from.read(&mut piece)?;
        if length == 0 {
            into.sync_all()?;
            return Ok(copied);
        }
        into.write_all(&piece[..length])?;
        copied += length as u64;
        progress.add(length as u64);
    }
}

fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

/// The progress on stderr, in a terminal only, in steps of a percent.
struct Progress {
    done: u64,
    all: u64,
    shown: u64,
    terminal: bool,
}

impl Progress {
    fn add(&mut self, bytes: u64) {
        self.done += bytes;
        let percent = 100 * self.done / self.all.max(1);
        if self.terminal && percent > self.shown {
            self.shown = percent;
            let end = if self.done == self.all { "\n" } else { "" };
            eprint!("\rnims: {percent:3} % of {:.1} MB{end}", self.all as f64 * 1e-6);
        }
    }
}

/// `nims token`.
#[derive(Debug, clap::Subcommand)]
pub enum TokenCommand {
    /// Create a token and print its secret, which is shown only here.
    Add {
        /// Name of its holder: letters, digits, `-` and `_`.
        name: String,
        /// What its holder may do: look, stop or fly.
        role: String,
    },
    /// List the tokens, without their secrets.
    List,
    /// Revoke a token; its connections are closed.
    Revoke {
        /// Name of its holder.
        name: String,
    },
}

impl TokenCommand {
    /// Runs the command.
    ///
    /// # Errors
    /// There is no gateway, or it refuses.
    pub fn run(&self, place: Place<'_>) -> Answer<Output> {
        let gateway: Gateway = client::gateway(place)?;
        match self {
            Self::Add { name, role } => {
                let secret = gateway.add_token(name, role)?;
                Ok(Output::new(json!({ "name": name, "role": role, "secret": secret }), secret))
            }
            Self::List => {
                let tokens = gateway.tokens()?;
                let line = |row: &client::TokenRow| format!("{:20} {:4}  since {}", row.name, row.role, row.created);
                let words = if tokens.is_empty() {
                    "no tokens".to_owned()
                } else {
                    tokens.iter().map(line).collect::<Vec<_>>().join("\n")
                };
                let rows: Vec<_> = tokens
                    .iter()
                    .map(|row| json!({ "name": row.name, "role": row.role, "created": row.created }))
                    .collect();
                Ok(Output::new(json!({ "tokens": rows }), words))
            }
            Self::Revoke { name } => {
                gateway.revoke_token(name)?;
                Ok(Output::accepted(format!("the token {name} is revoked")))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_lands_in_the_folder_of_the_run_only() {
        assert_eq!(safe("log/motor-io.txt"), Ok(Path::new("log/motor-io.txt")));
        for name in ["", "/etc/passwd", "../x", "log/../../x"] {
            assert!(safe(name).is_err(), "{name}");
        }
    }

    #[test]
    fn a_copy_begins_without_the_remains_of_an_earlier_attempt() {
        let folder = tempfile::tempdir().unwrap();
        let part = folder.path().join("run.part");
        for _ in 0..2 {
            begin(&part).unwrap();
            assert_eq!(fs::read_dir(&part).unwrap().count(), 0);
            fs::create_dir(part.join("log")).unwrap();
            fs::write(part.join("log/motor-io.txt"), "half").unwrap();
        }
    }

    #[test]
    fn a_copy_is_the_same_and_never_replaces_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let (from, to) = (folder.path().join("from"), folder.path().join("to"));
        let bytes: Vec<u8> = (0..3_000_000_u32).map(|i| (i % 251) as u8).collect();
        fs::write(&from, &bytes).unwrap();
        let mut progress = Progress { done: 0, all: bytes.len() as u64, shown: 0, terminal: false };
        let copied = copy(File::open(&from).unwrap(), &to, &mut progress).unwrap();
        assert_eq!((copied, fs::read(&to).unwrap()), (bytes.len() as u64, bytes));
        assert!(copy(File::open(&from).unwrap(), &to, &mut progress).is_err());
    }
}
