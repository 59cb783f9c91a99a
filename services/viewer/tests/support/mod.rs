//! What the tests of the viewer have in common.

#![allow(clippy::unwrap_used, clippy::expect_used)]
// Each test program uses a part.
#![allow(dead_code)]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use bus::{Bus, Domain, TestDomain};
use bytemuck::Zeroable;
use messages::{MotorState, SystemConfig, put_text};

/// A user who may look.
pub const OPERATOR: u32 = 65532;
/// Longest time to wait for an event; the machine may stall.
pub const LONG: Duration = Duration::from_secs(60);

/// A process that is killed when dropped.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The text lines of a pipe; each is waited for at most [`LONG`].
pub struct Lines(mpsc::Receiver<String>);

impl Lines {
    pub fn read(pipe: impl std::io::Read + Send + 'static) -> Self {
        let (send, receive) = mpsc::channel();
        std::thread::spawn(move || {
            for line in BufReader::new(pipe).lines().map_while(Result::ok) {
                let _ = send.send(line);
            }
        });
        Self(receive)
    }

    pub fn until(&self, what: &str) -> String {
        let begun = Instant::now();
        let mut said = String::new();
        while let Ok(line) = self.0.recv_timeout(LONG.saturating_sub(begun.elapsed())) {
            if line.contains(what) {
                return line;
            }
            said += &format!("{line}\n");
        }
        panic!("\"{what}\" was not printed, but:\n{said}");
    }
}

/// Starts a viewer; returns it and its messages.
pub fn start(domain: &Domain, more: &[&str]) -> (Running, Lines) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_viewer"))
        .args(["--domain", domain.name(), "--port", "0"])
        .args(more)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let said: ChildStderr = child.stderr.take().unwrap();
    (Running(child), Lines::read(said))
}

pub fn until(what: &str, mut done: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !done() {
        assert!(begin.elapsed() < LONG, "{what}: not within {LONG:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

pub fn stop(mut viewer: Running) {
    let pid = rustix::process::Pid::from_child(&viewer.0);
    rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
    assert_eq!(viewer.0.wait().unwrap().code(), Some(0));
}

/// A system file in which OPERATOR may look.
fn system(folder: &Path) -> PathBuf {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    for part in ["robots", "systems", "sensors"] {
        std::fs::create_dir(folder.join(part)).unwrap();
        for entry in std::fs::read_dir(configs.join(part)).unwrap().map(Result::unwrap) {
            if entry.file_type().unwrap().is_file() {
                std::fs::copy(entry.path(), folder.join(part).join(entry.file_name())).unwrap();
            }
        }
    }
    let path = folder.join("systems/demo3.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, format!("{text}\n[viewer]\nlook = [\"{OPERATOR}\"]\n")).unwrap();
    path
}

/// A robot that publishes its state and a parameter until this test ends, and its viewer.
pub fn with_robot(more: &[&str], check: impl FnOnce(&str, Lines, &Running) + Send) {
    let (domain, folder): (TestDomain, _) = (Domain::for_test(), tempfile::tempdir().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    let mut port = bus.publisher::<MotorState>("motor/state").unwrap();
    let mut config_port = bus.publisher::<SystemConfig>("system/config/estimator").unwrap();
    let system = system(folder.path());
    let (viewer, said) = start(&domain, &[&["--system", system.to_str().unwrap()], more].concat());
    let line = said.until("open ws://");
    let tcp_port = line.rsplit(':').next().unwrap().split(['\u{1b}', ' ']).next().unwrap().to_owned();
    std::thread::scope(|scope| {
        let (tcp_port, viewer) = (&tcp_port, &viewer);
        let checking = scope.spawn(move || check(tcp_port, said, viewer));
        for pass in 0_u32.. {
            if checking.is_finished() {
                break;
            }
            if pass.is_multiple_of(200) {
                let mut config = SystemConfig::zeroed();
                put_text(&mut config.parameters, &format!("[estimator]\nprocess_noise = {pass}.0\n"));
                config_port.send(&mut config).unwrap();
            }
            config_port.update_connections();
            port.send(&mut MotorState::zeroed()).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        checking.join().unwrap();
    });
    stop(viewer);
}
