//! Conformance of the virtual motor box with unmodified clients, of the drives' makers and of others.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use nims_tests::python;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// A motor box process that ends with the test.
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
    assert!(program.is_file(), "{} is missing: run `cargo build --workspace --bins` first", program.display());
    program
}

/// Attempts, in case this computer had no time for the motor box: the box leaves such time out, but a client uses the
/// wall clock.
const TRIES: usize = 4;

/// A client and the motor box that it talks to.
struct Judge {
    system: PathBuf,
    script: &'static str,
    /// After the port.
    arguments: &'static [&'static str],
    cycles: u64,
}

#[test]
fn the_drive_makers_client_reports_no_errors() {
    let system = workspace().join("configs/systems/demo3.toml");
    let (script, arguments) = ("conformance_basicmicro.py", &["230400", "2000"]);
    Judge { system, script, arguments, cycles: 2000 }.judge();
}

/// The client takes a pseudo-terminal for a UART, on which there is one unit.
#[test]
fn the_makers_client_of_moteus_reports_no_errors() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(workspace().join("configs/systems/moteus4.toml")).unwrap();
    let (head, rest) = text.split_once("[[motor_io.ports]]").unwrap();
    let (_, tail) = rest.split_once("[realtime]").unwrap();
    let port = |unit: usize| {
        format!(
            "[[motor_io.ports]]\npath = \"{{domain}}/drive{}\"\nprotocol = \"moteus\"\nbaud = 921600\n\
             units = [{{ address = {unit}, cables = [{unit}] }}]\n",
            unit - 1
        )
    };
    let ports: String = (1..=4).map(port).collect();
    let robots = workspace().join("configs/robots");
    let text = format!("{head}{ports}[realtime]{tail}").replace("../robots", robots.to_str().unwrap());
    let system = folder.path().join("uart4.toml");
    std::fs::write(&system, text).unwrap();
    Judge { system, script: "conformance_moteus.py", arguments: &["1", "2000"], cycles: 2000 }.judge();
}

#[test]
fn a_client_of_others_agrees_with_the_virtual_roboteq() {
    let system = workspace().join("configs/systems/roboteq3.toml");
    Judge { system, script: "conformance_roboteq.py", arguments: &["2000"], cycles: 2000 }.judge();
}

/// An exchange about which the client reported errors.
struct Talked {
    /// The motor box left time out.
    starved: bool,
    said: String,
}

impl Judge {
    fn judge(&self) {
        for attempt in 1.. {
            match self.talk() {
                Ok(()) => return,
                Err(Talked { starved: true, said }) if attempt < TRIES => {
                    println!("the box was starved, once more: {said}")
                }
                Err(Talked { said, .. }) => panic!("{said}"),
            }
        }
    }

    fn talk(&self) -> Result<(), Talked> {
        let python = python();
        let folder = tempfile::tempdir().unwrap();
        let box_said = folder.path().join("said");
        let child = Command::new(program("motor-box"))
            .arg("--system")
            .arg(&self.system)
            .arg("--ports-only")
            .arg(folder.path())
            .stderr(std::fs::File::create(&box_said).unwrap())
            .spawn()
            .unwrap();
        let mut motor_box = Ended(child);
        let port = folder.path().join("drive0");
        let begin = Instant::now();
        while !port.exists() {
            if let Some(status) = motor_box.0.try_wait().unwrap() {
                panic!("motor-box ended at once: {status}");
            }
            assert!(begin.elapsed() < Duration::from_secs(120), "motor-box created no port at {}", port.display());
            std::thread::sleep(Duration::from_millis(20));
        }

        let talked = Command::new(python)
            .arg(workspace().join("tests/python").join(self.script))
            .arg(&port)
            .args(self.arguments)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&talked.stdout);
        assert!(motor_box.0.try_wait().unwrap().is_none(), "motor-box ended");
        if !talked.status.success() {
            let box_said = std::fs::read_to_string(&box_said).unwrap();
            let starved = box_said.contains(motor_box::LEFT_OUT);
            return Err(Talked {
                starved,
                said: format!("{said}{}{box_said}", String::from_utf8_lossy(&talked.stderr)),
            });
        }
        let seen: serde_json::Value = serde_json::from_str(&said).expect("the output is one text line of JSON");
        assert_eq!(seen["cycles"], self.cycles);
        Ok(())
    }
}
