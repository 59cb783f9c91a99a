//! The page in a real browser: the walk of `web/walk/walk.mjs`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod rig;

use rig::Rig;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Folder for pictures of each view.
const PICTURES: &str = "NIMS_PAGE_PICTURES";

fn chromium() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .flat_map(|folder| ["chromium", "chromium-browser"].map(|name| folder.join(name)))
        .find(|path| path.is_file())
}

#[test]
fn a_person_with_a_tablet_pairs_flies_and_stops() {
    let web = Path::new(env!("CARGO_MANIFEST_DIR")).join("web");
    let Some(chromium) = chromium() else {
        return notes::left_out("the page in a real browser", "there is no chromium here: apt-get install chromium");
    };
    assert!(web.join("node_modules").is_dir(), "the packages of the page are missing: run scripts/page");
    // As on a robot's network: over HTTPS, with the page's own certificate.
    let rig = Rig::up_at("0.0.0.0");
    rig.add_run("earlier");
    let code = rig.code("tablet", "fly");
    // Without a graphics processor the browser computes its pictures, and would take the time of the robot's processes.
    let mut walk = Command::new("nice");
    walk.args(["-n", "19", "node"]).arg(web.join("walk/walk.mjs")).arg(format!("https://{}", rig.address)).arg(code);
    walk.env("NIMS_CHROMIUM", chromium);
    if let Some(folder) = std::env::var_os(PICTURES) {
        walk.arg(folder);
    }
    let output = walk.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    println!("{said}");
    assert!(output.status.success(), "{said}");
}
