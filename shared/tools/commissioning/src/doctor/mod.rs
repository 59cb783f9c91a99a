//! `nims doctor`: checks whether this machine can run a robot; each finding has a remedy. It changes nothing without
//! `--fix`, and then nothing without a question.

mod drives;
mod fix;
mod judge;
pub mod kernel;
mod machine;
mod probe;
mod realtime;

pub use probe::{TMPFS_MAGIC, nearest_existing};

use crate::finding::{self, Finding};
use command::{Answer, Failure, Output};
use config::SystemFile;
use serde_json::json;
use std::path::{Path, PathBuf};

/// `nims doctor`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// System file; its ports, runs folder and scheduling are checked too.
    pub config: Option<PathBuf>,
    /// Change settings of the kernel that delay the robot, after a question for each; see docs/real-time.md.
    #[arg(long)]
    pub fix: bool,
    /// Ask the drives on real ports too: nims stops them, releases their motors and sets their watchdogs, as `nims up`
    /// does. Support the node before.
    #[arg(long, requires = "config")]
    pub drives: bool,
    /// Answer the questions of --fix with yes.
    #[arg(long, requires = "fix")]
    pub yes: bool,
    /// Judge the limits of this process of the robot in place of those of this one; 0: of none, because no robot runs.
    /// A gateway asks so: its own service may do less than that of the robot.
    #[arg(long, hide = true, value_name = "PID")]
    pub limits_of: Option<u32>,
}

/// Runs `nims doctor` with or without a system file.
///
/// # Errors
/// A system file that cannot be used, or an error among the findings.
pub fn run(args: &Args) -> Answer<Output> {
    let path = args.config.as_deref().map(std::path::absolute).transpose().map_err(Failure::bad)?;
    let file = path.as_deref().map(SystemFile::load).transpose().map_err(Failure::bad)?;
    let root = Path::new("/");
    let examine = || realtime::examine(&kernel::read(root), &probe::wanted(root, file.as_ref()));
    let mut examined = examine();
    let mut changes = Vec::new();
    if args.fix {
        changes = fix::fix(root, &examined, &mut |sentence| fix::question(args.yes, sentence))?;
        examined = examine();
    }
    let mut found: Vec<Finding> = judge::judge(&probe::probe(file.as_ref(), args.limits_of));
    found.extend(examined.into_iter().map(|examined| examined.finding));
    found.extend(file.iter().flat_map(drives::to_set));
    if let (true, Some(file)) = (args.drives, &file) {
        found.extend(drives::ask(file)?);
    }
    found.sort_by_key(|finding| std::cmp::Reverse(finding.level as u8));
    let errors = finding::errors(&found);
    let failure = (errors > 0).then(|| {
        Failure::NotNow(format!(
            "{} on this machine would stop the robot, listed on stdout",
            finding::counted(errors, "error")
        ))
    });
    let lines: Vec<String> = changes.iter().map(fix::Change::line).collect();
    let output = if args.fix {
        let text = lines.iter().chain([&finding::to_text(&found)]).cloned().collect::<Vec<_>>().join("\n");
        Output::new(json!({ "findings": finding::to_json(&found), "changes": lines }), text)
    } else {
        Output::new(finding::to_json(&found), finding::to_text(&found))
    };
    Ok(output.failing(failure))
}
