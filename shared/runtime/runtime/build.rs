//! Passes the commit to release builds. Development builds contain none, because each commit would cause a full
//! rebuild.

#[path = "stamp.rs"]
mod stamp;

use std::path::Path;

fn main() {
    let release = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    println!("cargo::rerun-if-env-changed=NIMS_COMMIT");
    // This file does not exist, so a release build runs this script every time.
    println!("cargo::rerun-if-changed={}", if release { "always" } else { "build.rs" });
    // For builds from an archive without git.
    let given = std::env::var("NIMS_COMMIT").ok().filter(|given| !given.is_empty());
    let folder = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let found = || release.then(|| stamp::of(Path::new(&folder))).flatten();
    println!("cargo::rustc-env=NIMS_STAMP={}", given.or_else(found).unwrap_or_default());
}
