//! A recorder process for tests.

#![allow(dead_code)] // not every test needs all of it

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bus::{Bus, Domain};
use messages::Heartbeat;

/// A recorder process that is killed when dropped.
pub struct Recording(Child);

impl Drop for Recording {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Recording {
    pub fn start(domain: &Domain, run: &Path, bus: &Bus) -> Self {
        Self::start_with(domain, run, bus, &[])
    }

    pub fn start_with(domain: &Domain, run: &Path, bus: &Bus, more: &[&str]) -> Self {
        Self::start_as(Command::new(env!("CARGO_BIN_EXE_recorder")), domain, run, bus, more)
    }

    /// Starts a recorder whose files cannot exceed `bytes`, as on a full disk.
    pub fn start_limited(domain: &Domain, run: &Path, bus: &Bus, bytes: usize) -> Self {
        let mut command = Command::new("sh");
        let script = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", bytes / 512);
        command.args(["-c", &script, env!("CARGO_BIN_EXE_recorder")]);
        Self::start_as(command, domain, run, bus, &[])
    }

    fn start_as(mut command: Command, domain: &Domain, run: &Path, bus: &Bus, more: &[&str]) -> Self {
        let mut beats = bus.subscriber::<Heartbeat>("system/heartbeat/recorder").unwrap();
        let child = command
            .args(["--domain", domain.name(), "--run"])
            .arg(run)
            .args(more)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let this = Self(child);
        until("the recorder is ready", || {
            std::iter::from_fn(|| beats.receive().unwrap()).any(|beat| beat.state == Heartbeat::STATE_READY)
        });
        this
    }

    pub fn signal(&mut self, signal: rustix::process::Signal) -> Option<i32> {
        let pid = rustix::process::Pid::from_child(&self.0);
        rustix::process::kill_process(pid, signal).unwrap();
        self.0.wait().unwrap().code()
    }

    /// Returns the private memory, kB.
    pub fn private_kb(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.0.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).unwrap();
        line.trim().trim_end_matches(" kB").parse().unwrap()
    }

    /// Returns the processor time, in hundredths of a second.
    pub fn ticks(&self) -> u64 {
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.0.id())).unwrap();
        let fields: Vec<&str> = stat.rsplit(") ").next().unwrap().split(' ').collect();
        fields[11].parse::<u64>().unwrap() + fields[12].parse::<u64>().unwrap()
    }
}

pub fn until(what: &str, mut done: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !done() {
        assert!(begin.elapsed() < Duration::from_secs(20), "{what}: not within 20 s");
        std::thread::sleep(Duration::from_millis(5));
    }
}
