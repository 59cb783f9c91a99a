//! The program `nims-manual FOLDER`: writes the man pages and completions into a folder.
#![forbid(unsafe_code)]

use clap::Parser;
use command::Output;
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write the man pages and shell completions of `nims`.
#[derive(Debug, Parser)]
#[command(name = "nims-manual")]
struct Cli {
    /// Folder for `man/` and `completions/`.
    folder: PathBuf,
}

fn main() -> ExitCode {
    command::main(
        std::env::args_os(),
        |_: &Cli| false,
        |cli| {
            let files = nims_manual::write(&cli.folder)?;
            Ok(Some(Output::new(
                json!({ "files": files }),
                format!("{} files in {}", files.len(), cli.folder.display()),
            )))
        },
    )
}
