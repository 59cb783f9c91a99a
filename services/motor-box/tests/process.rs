//! The virtual motor box as a process: on the bus, and on its ports.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::Duration;

use bus::{Bus, Domain, clock};
use messages::{OperatorRequest, Request, TruthNode, text_of};
use motor_box::FaultRequest;
use serial::{Port, Transport};

/// A process that ends with the test.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Ended {
    /// Requests its end and returns its exit code.
    fn terminate(&mut self) -> Option<i32> {
        let pid = rustix::process::Pid::from_raw(self.0.id().try_into().unwrap()).unwrap();
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
        self.0.wait().unwrap().code()
    }
}

fn system_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/systems").join(name)
}

fn motor_box() -> Command {
    Command::new(env!("CARGO_BIN_EXE_motor-box"))
}

fn wait_for(what: &str, mut there: impl FnMut() -> bool) {
    for _ in 0..500 {
        if there() {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    panic!("{what} did not come within ten seconds");
}

#[test]
fn it_publishes_truth_and_takes_faults() {
    let domain = Domain::for_test();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut truths = bus.subscriber::<TruthNode>("truth/node").unwrap();
    let mut child = Ended(
        motor_box().arg("--system").arg(system_file("demo4.toml")).arg("--domain").arg(domain.name()).spawn().unwrap(),
    );
    let mut seen: Vec<TruthNode> = Vec::new();
    wait_for("truth", || {
        while let Some(truth) = truths.receive().unwrap() {
            seen.push(truth);
        }
        seen.len() >= 30
    });
    assert_eq!(truths.lost(), 0);
    let last = seen.last().unwrap();
    assert_eq!(last.cable_count, 4);
    assert!((last.position_m[2] - 0.3).abs() < 0.01, "{:?}", last.position_m);
    assert!(last.tension_n[..4].iter().all(|&tension| tension > 1.0) && last.slack == [0; 8]);
    assert!(seen.windows(2).all(|pair| pair[0].header.stamp_ns < pair[1].header.stamp_ns));
    assert!(last.header.stamp_ns <= clock::now_ns());

    let mut client = bus.client("motor-box").unwrap();
    let mut ask = |text: &str| {
        let request = Request::Fault { text: text.to_owned() }.encode().unwrap();
        client.ask(&request, Duration::from_secs(5)).unwrap()
    };
    let nonsense = ask("explode 1");
    assert_eq!(nonsense.accepted, OperatorRequest::BAD_INPUT);
    let nobody = ask("stall 7");
    assert_eq!(nobody.accepted, OperatorRequest::BAD_INPUT, "{}", text_of(&nobody.answer));
    let sentence = "explode 1".parse::<FaultRequest>().unwrap_err().to_string();
    let mut field = nonsense.answer;
    messages::put_sentence(&mut field, &sentence);
    assert_eq!(nonsense.answer, field, "what the library says, as much as has room");
    assert_eq!(ask("break 2 on").accepted, 1);
    wait_for("a broken line", || {
        let mut slack = false;
        while let Some(truth) = truths.receive().unwrap() {
            slack |= truth.slack[1] == 1;
        }
        slack
    });

    let link = domain.root().join("drive0");
    assert!(link.exists());
    assert_eq!(ask("unplug 1").accepted, 1);
    assert!(!link.exists());
    assert_eq!(ask("plug 1").accepted, 1);
    assert!(link.exists());
    assert_eq!(child.terminate(), Some(0));
    assert!(!link.exists(), "the port goes with the box");
}

#[test]
fn one_program_after_another_finds_its_port_answering() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = Ended(
        motor_box()
            .arg("--system")
            .arg(system_file("fast3.toml"))
            .arg("--ports-only")
            .arg(folder.path())
            .spawn()
            .unwrap(),
    );
    let link = folder.path().join("drive1");
    wait_for("the port", || link.exists());
    for _ in 0..2 {
        let mut port = Port::open(&std::sync::Arc::from(link.to_str().unwrap()), 230_400).unwrap();
        // 80 5a: status, without an error.
        port.write_all(&[0x80, 0x5A], port.now_ns() + 1_000_000_000).unwrap();
        let mut answer = [0; 6];
        let n = port.fill(&mut answer, port.now_ns() + 1_000_000_000).unwrap();
        assert_eq!(answer[..n], [0, 0, 0, 0, 0x87, 0xBC]);
    }
    assert_eq!(child.terminate(), Some(0));
    assert!(!link.exists());
}

#[test]
fn bad_input_is_one_sentence_and_code_two() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = std::fs::read_to_string(system_file("demo3.toml")).unwrap();
    text = text.replace("{domain}/drive0", "/dev/ttyUSB0");
    text = text.replace("../robots/lab3.toml", system_file("../robots/lab3.toml").to_str().unwrap());
    let real = folder.path().join("real.toml");
    std::fs::write(&real, &text).unwrap();
    let outside = folder.path().join("outside.toml");
    let moved = text
        .replace("/dev/ttyUSB0", "{domain}/drive0")
        .replace("start_m = [4.8, 3.0, 0.3]", "start_m = [40.0, 3.0, 0.3]");
    std::fs::write(&outside, moved).unwrap();
    for (file, parts) in [
        (real, &["/dev/ttyUSB0", "{domain}/"][..]),
        (outside, &["(40.000, 3.000, 0.300) m"]),
        (folder.path().join("none.toml"), &["none.toml"]),
    ] {
        let ended = motor_box().arg("--system").arg(&file).arg("--ports-only").arg(folder.path()).output().unwrap();
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(2), "{said}");
        assert!(parts.iter().all(|part| said.contains(part)) && said.trim().lines().count() == 1, "{said}");
    }
    assert!(!folder.path().join("drive0").exists());
}
