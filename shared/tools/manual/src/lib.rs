//! Man pages and shell completions of the command `nims`, made from the definitions of its arguments.
//!
//! A program of its own: what makes these files is not part of a program that runs on a control box. The programs that
//! `nims` runs as its commands (`up`, `bench`, `paper`, `sim`, `truth`) are included with their own arguments.
//!
//! Invariant: the same definitions give the same bytes; no date and no path of this machine is in them.
#![forbid(unsafe_code)]

use clap::{Args, CommandFactory};
use clap_complete::Shell;
use command::{Answer, Failure};
use std::path::{Path, PathBuf};

/// Shells, and the file name that each looks for.
const SHELLS: [(Shell, &str); 3] =
    [(Shell::Bash, "completions/nims"), (Shell::Zsh, "completions/_nims"), (Shell::Fish, "completions/nims.fish")];

/// Returns the command `nims` with the arguments of all programs that it runs.
#[must_use]
pub fn complete_command() -> clap::Command {
    let up = |command: clap::Command| {
        let about = command.get_about().cloned().unwrap_or_default();
        supervisor::Args::augment_args(clap::Command::new("up").about(about))
    };
    let mut command = nims::cli::Cli::command().mut_subcommand("up", up).allow_external_subcommands(false);
    for (name, about) in nims::programs::COMPANIONS {
        let program = clap::Command::new(name).about(about);
        command = command.subcommand(match name {
            "bench" => nims_bench::Args::augment_args(program),
            "drive-capture" => nims_drive_capture::Args::augment_args(program),
            "paper" => nims_paper::Args::augment_args(program),
            "sim" => nims_sim::Args::augment_args(program),
            "truth" => nims_truth::Args::augment_args(program),
            _ => program,
        });
    }
    command
}

/// Writes one man page for each command and a completion for each shell; returns the files.
///
/// # Errors
/// A file cannot be written.
pub fn write(folder: &Path) -> Answer<Vec<PathBuf>> {
    let mut command = complete_command();
    let mut files = Vec::new();
    for (shell, name) in SHELLS {
        let mut text = Vec::new();
        clap_complete::generate(shell, &mut command, "nims", &mut text);
        files.push(write_file(folder, name, &text)?);
    }
    command.build();
    pages(&command, "nims", folder, &mut files)?;
    Ok(files)
}

/// Writes the page of a command and those of its subcommands.
fn pages(command: &clap::Command, name: &str, folder: &Path, files: &mut Vec<PathBuf>) -> Answer {
    let mut text = Vec::new();
    clap_mangen::Man::new(command.clone())
        .title(name.to_uppercase())
        .source("nims")
        .manual("nims, control stack of cable robots")
        .render(&mut text)
        .map_err(Failure::not_now)?;
    files.push(write_file(folder, &format!("man/{name}.1"), &text)?);
    for below in command.get_subcommands().filter(|below| below.get_name() != "help" && !below.is_hide_set()) {
        pages(below, &format!("{name}-{}", below.get_name()), folder, files)?;
    }
    Ok(())
}

fn write_file(folder: &Path, name: &str, text: &[u8]) -> Answer<PathBuf> {
    let path = folder.join(name);
    let failed = |error: std::io::Error| Failure::NotNow(format!("{} cannot be written: {error}", path.display()));
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    std::fs::write(&path, text).map_err(failed)?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn written() -> BTreeMap<String, String> {
        let folder = tempfile::tempdir().unwrap();
        let files = write(folder.path()).unwrap();
        let name = |path: &PathBuf| path.strip_prefix(folder.path()).unwrap().to_str().unwrap().to_owned();
        files.iter().map(|path| (name(path), std::fs::read_to_string(path).unwrap())).collect()
    }

    #[test]
    fn every_command_has_a_page_and_each_shell_knows_it() {
        let files = written();
        for command in nims::cli::Cli::command().get_subcommands().filter(|command| !command.is_hide_set()) {
            let name = command.get_name();
            let page = &files[&format!("man/nims-{name}.1")];
            assert!(page.contains(".SH SYNOPSIS") && page.contains(".SH DESCRIPTION"), "{name}:\n{page}");
            for (_, shell) in SHELLS {
                assert!(files[shell].contains(name), "{shell} lacks {name}");
            }
        }
    }

    #[test]
    fn programs_beside_nims_are_included_with_their_own_arguments() {
        let files = written();
        for (command, option) in [
            ("up", "\\-\\-for"),
            ("bench", "\\-\\-seconds"),
            ("paper", "\\-\\-out"),
            ("sim", "\\-\\-sweep"),
            ("truth", "\\-\\-seed"),
        ] {
            let page = &files[&format!("man/nims-{command}.1")];
            assert!(page.contains(option), "{command}:\n{page}");
        }
    }

    #[test]
    fn the_files_are_the_same_each_time() {
        assert_eq!(written(), written());
    }
}
