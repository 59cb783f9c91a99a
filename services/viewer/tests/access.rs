//! Only users who may look receive anything of the robot.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use std::process::{Command, Output, Stdio};

use serde_json::Value;
use support::{OPERATOR, Running, until, with_robot};

/// A user who may not look.
const STRANGER: u32 = 65533;

/// A tool without packages, for any user who may run Python.
fn look(user: u32, address: &str, port: &str, wanted: u32) -> Command {
    let mut command = python(user, include_str!("look.py"));
    command.args([address, port, &wanted.to_string()]);
    command
}

fn python(user: u32, program: &str) -> Command {
    let mut command = Command::new("setpriv");
    command.args([format!("--reuid={user}"), format!("--regid={user}"), "--clear-groups".to_owned()]);
    command.args(["--", "/usr/bin/python3", "-c", program]);
    command.current_dir("/").stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Connects, sends nothing, and writes what it receives.
const LISTEN: &str = "
import socket, sys
connection = socket.create_connection((sys.argv[1], int(sys.argv[2])), 60)
answer = b''
while data := connection.recv(65536):
    answer += data
print(answer.decode('latin1'))
";

fn seen(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Open files of a process.
fn files(process: &Running) -> usize {
    std::fs::read_dir(format!("/proc/{}/fd", process.0.id())).unwrap().count()
}

/// Largest memory of a process so far, kB.
fn memory_kb(process: &Running) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", process.0.id())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.split_whitespace().next().unwrap().parse().unwrap()
}

fn only_root(check: &str) -> bool {
    let is_root = rustix::process::geteuid().is_root();
    if !is_root {
        notes::left_out(check, "only root can act as another user");
    }
    is_root
}

#[test]
fn another_user_receives_nothing_and_disturbs_no_view() {
    if !only_root("what another user sees through the viewer") {
        return;
    }
    with_robot(&[], |port, said, viewer| {
        // The one who may look is there first, and for the whole test.
        let operator = look(OPERATOR, "127.0.0.1", port, 400).spawn().unwrap();
        let before = files(viewer);
        // Also from a socket of IPv6, which the kernel lists elsewhere.
        for address in ["127.0.0.1", "::ffff:127.0.0.1"] {
            let stranger = seen(&look(STRANGER, address, port, 1).output().unwrap());
            assert_eq!(stranger["messages"], 0, "{stranger}");
            // Reset, because its request arrived before the answer, or refused; nothing else.
            let answer = stranger["answer"].as_str().unwrap();
            assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 403"), "{stranger}");
            assert!(!answer.contains("motor") && !answer.contains("nims"), "{stranger}");
        }
        let reader = python(STRANGER, LISTEN).args(["127.0.0.1", port]).output().unwrap();
        let answer = String::from_utf8_lossy(&reader.stdout);
        assert!(answer.starts_with("HTTP/1.1 403 Forbidden"), "{reader:?}");
        let line = said.until("refused");
        assert!(line.contains(&STRANGER.to_string()) && line.contains("[viewer]"), "{line}");
        // A thousand connections at once: each ends, none is kept.
        let crowd = seen(&look(STRANGER, "127.0.0.1", port, 0).arg("1000").output().unwrap());
        assert_eq!((&crowd["ended"], &crowd["messages"]), (&Value::from(1000), &Value::from(0)), "{crowd}");
        until("the viewer has closed them", || files(viewer) <= before + 1);
        assert!(memory_kb(viewer) < 100_000, "{} kB", memory_kb(viewer));
        let output = operator.wait_with_output().unwrap();
        let operator = seen(&output);
        assert_eq!((&operator["samples"], &operator["protocol"]), (&Value::from(400), &"foxglove.sdk.v1".into()));
        println!("{} kB at most; the operator's view: {operator}; the crowd: {crowd}", memory_kb(viewer));
        // A new view after all this, and that of root.
        for user in [OPERATOR, 0] {
            let late = seen(&look(user, "127.0.0.1", port, 5).output().unwrap());
            assert_eq!(late["samples"], 5, "{late}");
        }
    });
}

/// An address that other machines reach is open to these by choice, and still not to other users of this one.
#[test]
fn another_user_of_this_machine_is_refused_at_every_address() {
    if !only_root("what another user sees through a viewer with another address") {
        return;
    }
    with_robot(&["--address", "0.0.0.0"], |port, _, _| {
        for address in ["127.0.0.1", "127.0.0.7"].map(str::to_owned).into_iter().chain(own_addresses()) {
            let stranger = seen(&look(STRANGER, &address, port, 1).output().unwrap());
            assert_eq!(stranger["messages"], 0, "{address}: {stranger}");
            let operator = seen(&look(OPERATOR, &address, port, 1).output().unwrap());
            assert_eq!(operator["samples"], 1, "{address}: {operator}");
            println!("tried {address}");
        }
    });
}

/// Addresses of this machine beyond the loopback.
fn own_addresses() -> Vec<String> {
    let output = Command::new("hostname").arg("-I").output();
    let text = output.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default();
    text.split_whitespace().filter(|address| address.contains('.')).map(str::to_owned).collect()
}
