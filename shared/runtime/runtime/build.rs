//! Records the commit in a release build. A development build records none, because each commit would rebuild
//! everything.

#[path = "stamp.rs"]
mod stamp;

use std::path::Path;

fn main() {
    let release = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let folder = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    let folder = Path::new(&folder);
    println!("cargo::rerun-if-env-changed=NIMS_COMMIT");
    println!("cargo::rerun-if-changed=build.rs");
    if release {
        for path in stamp::watched(folder) {
            println!("cargo::rerun-if-changed={}", path.display());
        }
    }
    // For builds from an archive without git.
    let given = std::env::var("NIMS_COMMIT").ok().filter(|given| !given.is_empty());
    let found = || release.then(|| stamp::commit_of(folder)).flatten();
    println!("cargo::rustc-env=NIMS_STAMP={}", given.or_else(found).unwrap_or_default());
}
