//! `nims doctor`: checks whether this machine can run a robot; each finding has a remedy. It changes nothing.

mod judge;
mod machine;
mod probe;

pub use probe::{TMPFS_MAGIC, nearest_existing};

use crate::finding;
use command::{Answer, Failure, Output};
use config::SystemFile;
use std::path::PathBuf;

/// `nims doctor`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// System file; its ports, runs folder and scheduling are checked too.
    pub config: Option<PathBuf>,
}

/// Runs `nims doctor` with or without a system file.
///
/// # Errors
/// A system file that cannot be used, or an error among the findings.
pub fn run(args: &Args) -> Answer<Output> {
    let path = args.config.as_deref().map(std::path::absolute).transpose().map_err(Failure::bad)?;
    let file = path.as_deref().map(SystemFile::load).transpose().map_err(Failure::bad)?;
    let found = judge::judge(&probe::probe(file.as_ref()));
    let errors = finding::errors(&found);
    let failure = (errors > 0)
        .then(|| Failure::NotNow(format!("{errors} error(s) on this machine would stop the robot, listed on stdout")));
    Ok(Output::new(finding::to_json(&found), finding::to_text(&found)).failing(failure))
}
