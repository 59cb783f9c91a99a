//! The oldest Rust that the project promises is the same in every place.

// `clippy.toml` permits `unwrap` in test functions only, and this file has helpers.
#![allow(clippy::unwrap_used)]

use architecture::{packages, root};

/// The value of a key in a file: the quoted text after `key =`.
fn rust_version(manifest: &std::path::Path) -> Option<String> {
    let text = std::fs::read_to_string(manifest).unwrap();
    let line = text.lines().find(|line| line.starts_with("rust-version = "))?;
    line.split('"').nth(1).map(str::to_owned)
}

#[test]
fn the_oldest_toolchain_is_the_same_everywhere() {
    let promised = rust_version(&root().join("Cargo.toml")).expect("the workspace has a rust-version");
    for (name, package) in packages().unwrap() {
        let manifest = package.folder.join("Cargo.toml");
        let text = std::fs::read_to_string(&manifest).unwrap();
        let inherits = text.contains("rust-version.workspace = true");
        match rust_version(&manifest) {
            Some(own) => assert_eq!(own, promised, "{name}"),
            None => assert!(inherits, "{name} promises no rust-version"),
        }
    }
    for document in ["README.md", "CONTRIBUTING.md"] {
        let text = std::fs::read_to_string(root().join(document)).unwrap();
        let words = format!("{promised} or later");
        assert!(text.contains(&words), "{document} does not say `{words}`, which rust-version in Cargo.toml promises");
    }
}
