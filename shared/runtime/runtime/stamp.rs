// The commit of a build. Used by the build script, and tested as a part of the library.

use std::path::{Path, PathBuf};
use std::process::Command;

fn git(folder: &Path, arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").arg("-C").arg(folder).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Returns the commit of the checkout that contains a folder, with `-dirty` appended if tracked files differ from it;
/// `None` without git or outside a checkout.
pub fn commit_of(folder: &Path) -> Option<String> {
    let commit = git(folder, &["rev-parse", "--short=10", "HEAD"]).filter(|commit| !commit.is_empty())?;
    let changed = git(folder, &["status", "--porcelain", "--untracked-files=no"])?;
    Some(if changed.is_empty() { commit } else { commit + "-dirty" })
}

/// Returns the files that change whenever the result of [`of`] changes: every tracked file, and the files that git
/// writes at a commit or a checkout. Empty without git or outside a checkout.
pub fn watched(folder: &Path) -> Vec<PathBuf> {
    let own = ["HEAD", "logs/HEAD"].iter().filter_map(|name| {
        git(folder, &["rev-parse", "--path-format=absolute", "--git-path", name]).map(PathBuf::from)
    });
    let tracked = || {
        let root = PathBuf::from(git(folder, &["rev-parse", "--show-toplevel"])?);
        let names = git(&root, &["ls-files"])?;
        Some(names.lines().map(|name| root.join(name)).collect::<Vec<_>>())
    };
    own.chain(tracked().unwrap_or_default()).filter(|path| path.exists()).collect()
}
