//! `nims runs` and `nims fetch`: finished runs of a robot whose folder of runs is closed to this user.

use client::{Gateway, Place};
use command::{Answer, Failure, Output};
use serde_json::json;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};

/// `nims fetch`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the run, as `nims runs` lists it.
    pub run: String,
    /// New folder for the copy, or a folder in which it is placed; default: the current one.
    pub dest: Option<PathBuf>,
}

/// Lists the finished runs of the gateway; with a folder, or without a gateway, those of a folder.
///
/// # Errors
/// There is neither a gateway nor the folder, or the gateway does not answer.
pub fn runs(place: Place<'_>, folder: Option<&Path>) -> Answer<Output> {
    let gateway = match (folder, client::gateway(place)) {
        (Some(folder), _) => return analysis::run_list::list(folder),
        (None, Err(_)) if Path::new(analysis::run_list::FOLDER).is_dir() && place.gateway.is_none() => {
            return analysis::run_list::list(Path::new(analysis::run_list::FOLDER));
        }
        (None, gateway) => gateway?,
    };
    let runs = gateway.runs()?;
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
    let dest = match &args.dest {
        // As `cp` does.
        Some(folder) if folder.is_dir() => folder.join(&args.run),
        Some(new) => new.clone(),
        None => PathBuf::from(&args.run),
    };
    if dest.exists() {
        return Err(Failure::BadInput(format!("{} exists already; give another folder", dest.display())));
    }
    let (files, all) = client::copy_run(&client::gateway(place)?, &args.run, &dest, show_progress())?;
    let sentence = format!("{}: {files} files, {:.1} MB", dest.display(), all as f64 * 1e-6);
    Ok(Output::new(json!({ "run": dest, "files": files, "bytes": all }), sentence))
}

/// Shows the progress of a copy on a terminal, in steps of a percent.
pub(crate) fn show_progress() -> impl FnMut(u64, u64) {
    let (terminal, mut shown) = (io::stderr().is_terminal(), 0);
    move |done, all| {
        let percent = 100 * done / all.max(1);
        if terminal && percent > shown {
            shown = percent;
            let end = if done == all { "\n" } else { "" };
            eprint!("\rnims: {percent:3} % of {:.1} MB{end}", all as f64 * 1e-6);
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
