//! Lines of comments and documentation have at most 120 columns, the limit that `rustfmt.toml` sets for code.

// `clippy.toml` permits `unwrap` in test functions only, and this file has a helper.
#![allow(clippy::unwrap_used)]

use architecture::root;
use std::path::{Path, PathBuf};

const COLUMNS: usize = 120;

/// Files below a folder that have comments, except build outputs and downloads.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            if !["target", "node_modules", "golden", "__pycache__"].contains(&name.as_str()) {
                files(&path, found);
            }
        } else if !name.contains('.') || [".rs", ".toml", ".py", ".sh"].iter().any(|ending| name.ends_with(ending)) {
            found.push(path);
        }
    }
}

/// Whether a line is a comment: of Rust, or of a script or a configuration file.
fn is_comment(path: &Path, line: &str) -> bool {
    let is_rust = path.extension().is_some_and(|ending| ending == "rs");
    line.trim_start().starts_with(if is_rust { "//" } else { "#" })
}

#[test]
fn comments_have_at_most_120_columns() {
    let mut found = Vec::new();
    for place in ["services", "shared", "tests", "scripts", "configs", ".config", ".ci"] {
        files(&root().join(place), &mut found);
    }
    found.extend(["Cargo.toml", "deny.toml", "clippy.toml", "rustfmt.toml"].map(|name| root().join(name)));
    assert!(found.len() > 500, "only {} files found", found.len());
    let mut wide = Vec::new();
    for path in &found {
        let below = path.strip_prefix(root()).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        for (number, line) in text.lines().enumerate() {
            let columns = line.chars().count();
            if columns > COLUMNS && is_comment(path, line) {
                wide.push(format!("{}:{} has {columns} columns", below.display(), number + 1));
            }
        }
    }
    assert!(wide.is_empty(), "comments wider than {COLUMNS} columns:\n{}", wide.join("\n"));
}
