// The commit of a build. Used by the build script, and tested as a part of the library.

use std::path::Path;
use std::process::Command;

/// Returns the commit of the checkout that contains a folder, with `-dirty` appended if tracked files differ from it;
/// `None` without git or outside a checkout.
pub fn of(folder: &Path) -> Option<String> {
    let git = |arguments: &[&str]| -> Option<String> {
        let output = Command::new("git").arg("-C").arg(folder).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let commit = git(&["rev-parse", "--short=10", "HEAD"]).filter(|commit| !commit.is_empty())?;
    let changed = git(&["status", "--porcelain", "--untracked-files=no"])?;
    Some(if changed.is_empty() { commit } else { commit + "-dirty" })
}
