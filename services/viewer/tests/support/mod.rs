//! What the tests of the viewer have in common.

#![allow(clippy::unwrap_used, clippy::expect_used)]
// Each test program uses a part.
#![allow(dead_code)]

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use bus::Domain;

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
