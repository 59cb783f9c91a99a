//! Notes of a test run: checks that this machine cannot make, and tests that were repeated because the machine stood
//! still.
//!
//! Each test is a process of its own and its output is only shown when it fails. So a note goes to a file that all of
//! them share, and `scripts/test` prints the file at its end. Without the file a note goes to standard error only.
#![forbid(unsafe_code)]

use std::fmt::Display;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::PathBuf;

/// Variable with the path of the file.
pub const FILE: &str = "NIMS_TEST_NOTES";

/// Notes that this test does not check something, and why.
pub fn left_out(check: &str, reason: impl Display) {
    write("left out", &format!("{check}: {reason}"));
}

/// Notes that this test is repeated, with the machine's evidence that it was not the robot's fault.
pub fn repeated(evidence: impl Display) {
    write("repeated", &evidence.to_string());
}

/// Appends one line `KIND <tab> PROGRAM TEST <tab> TEXT`. Tests append at the same time: one write each.
fn write(kind: &str, text: &str) {
    let program = std::env::current_exe().ok().and_then(|path| Some(path.file_stem()?.to_string_lossy().into_owned()));
    // Cargo appends a hash of 16 digits to the name of a test program.
    let program = program.unwrap_or_default();
    let program = program.rsplit_once('-').map_or(program.as_str(), |(name, _)| name);
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("?");
    let text = text.replace(['\n', '\t'], " ");
    eprintln!("{kind}: {test}: {text}");
    let Some(path) = std::env::var_os(FILE).map(PathBuf::from) else { return };
    let line = format!("{kind}\t{program} {test}\t{text}\n");
    let written = OpenOptions::new().append(true).open(&path).and_then(|mut file| file.write_all(line.as_bytes()));
    if let Err(error) = written {
        eprintln!("{}: {error}", path.display());
    }
}
