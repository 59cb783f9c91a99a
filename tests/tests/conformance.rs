//! The virtual motor box speaks to a client that this project did not write: the drive maker's own, unmodified.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use nims_tests::python;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// Ends the box whatever becomes of the test.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// A program of this workspace; the test runs from target/PROFILE/deps.
fn program(name: &str) -> PathBuf {
    let program = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join(name);
    assert!(program.is_file(), "there is no {}: `cargo build --workspace --bins` first", program.display());
    program
}

#[test]
fn the_drive_makers_client_is_content() {
    let python = python();
    let folder = tempfile::tempdir().unwrap();
    let child = Command::new(program("motor-box"))
        .arg("--box")
        .arg(workspace().join("configs/boxes/demo3.toml"))
        .arg("--ports-only")
        .arg(folder.path())
        .spawn()
        .unwrap();
    let mut motor_box = Ended(child);
    let port = folder.path().join("drive0");
    let begin = Instant::now();
    while !port.exists() {
        if let Some(status) = motor_box.0.try_wait().unwrap() {
            panic!("motor-box ended at once: {status}");
        }
        assert!(begin.elapsed() < Duration::from_secs(20), "motor-box made no port at {}", port.display());
        std::thread::sleep(Duration::from_millis(20));
    }

    let talked = Command::new(python)
        .arg(workspace().join("tests/python/conformance_basicmicro.py"))
        .arg(&port)
        .args(["230400", "2000"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&talked.stdout);
    let complained = String::from_utf8_lossy(&talked.stderr);
    assert!(talked.status.success(), "{said}{complained}");
    let seen: serde_json::Value = serde_json::from_str(&said).expect("one line of JSON");
    assert_eq!(seen["cycles"], 2000);
    assert!(motor_box.0.try_wait().unwrap().is_none(), "the box lives on");
}
