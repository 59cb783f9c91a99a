//! The page's own conversation with the server, run by Node.js without a browser: slow and dead connections.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;
use std::process::Command;

#[test]
fn the_page_knows_what_is_late_and_gives_up_what_is_dead() {
    let web = Path::new(env!("CARGO_MANIFEST_DIR")).join("web");
    let esbuild = web.join("node_modules/.bin/esbuild");
    if !esbuild.exists() {
        return notes::left_out("the page's conversation with the server", "the page is not built: scripts/page");
    }
    let folder = tempfile::tempdir().unwrap();
    let bundle = folder.path().join("link.cjs");
    let built = Command::new(esbuild)
        .arg(web.join("src/link.ts"))
        .args(["--bundle", "--format=cjs", "--log-level=warning"])
        .arg(format!("--outfile={}", bundle.display()))
        .status()
        .unwrap();
    assert!(built.success());
    let output = Command::new("node").arg(web.join("walk/conversation.cjs")).arg(&bundle).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
