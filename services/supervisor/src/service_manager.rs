//! Messages to the service manager that started this program, as sd_notify(3) defines them: that the robot is ready,
//! a status line, and the sign of life for its watchdog. Without a service manager nothing is sent.
//!
//! Invariant: a message never blocks. The published crates wait while the manager's queue is full; the supervisor's
//! heartbeat would stop meanwhile, and motor-io would stop the robot. What does not fit is sent again by the next pass:
//! the queue of a kernel without settings has place for ten messages.

use bus::clock;
use std::ffi::{OsStr, OsString};
use std::io::ErrorKind;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::process::Command;
use std::time::Duration;

/// Socket of the service manager: a path, or `@` and an abstract name.
const SOCKET: &str = "NOTIFY_SOCKET";
/// Time without a sign of life after which the manager ends the service, µs.
const WATCHDOG_US: &str = "WATCHDOG_USEC";
/// The process that the watchdog is for; absent: every process.
const WATCHDOG_PID: &str = "WATCHDOG_PID";
/// Signs of life per watchdog time: the manual of sd_watchdog_enabled(3) advises at least two.
const SIGNS: u64 = 4;

/// The connection to the service manager.
#[derive(Debug, Default)]
pub struct ServiceManager {
    socket: Option<(UnixDatagram, SocketAddr)>,
    /// Pause between two signs of life, ns; `None`: the manager has no watchdog for this process.
    pause_ns: Option<u64>,
    last_sign_ns: u64,
    status: String,
    /// Time of the last request for more time to start, ns.
    extended_ns: Option<u64>,
    /// The robot is up, and the manager's queue had no place for that message.
    is_ready_unsent: bool,
}

impl ServiceManager {
    /// The manager that the environment names.
    pub fn of_environment() -> Self {
        Self::new(|name| std::env::var_os(name))
    }

    fn new(variable: impl Fn(&str) -> Option<OsString>) -> Self {
        let number = |name: &str| variable(name).and_then(|text| text.to_str()?.parse::<u64>().ok());
        let meant = number(WATCHDOG_PID).is_none_or(|pid| pid == u64::from(std::process::id()));
        let pause_ns = number(WATCHDOG_US).filter(|us| *us > 0 && meant).map(|us| us.saturating_mul(1000) / SIGNS);
        Self { socket: variable(SOCKET).and_then(|name| connect(&name)), pause_ns, ..Self::default() }
    }

    /// Whether a service manager has started this program.
    #[must_use]
    pub fn is_there(&self) -> bool {
        self.socket.is_some()
    }

    /// The robot is up.
    pub fn ready(&mut self) {
        self.is_ready_unsent = !self.send("READY=1");
    }

    /// The start goes on: the manager waits at least for that long from now on, or from the last call, if that was
    /// within a tenth of this time. An earlier limit of the manager that is later stays.
    pub fn extend_start(&mut self, time: Duration) {
        let now = clock::now_ns();
        let pause_ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX) / 10;
        if self.extended_ns.is_none_or(|last_ns| now.saturating_sub(last_ns) >= pause_ns)
            && self.send(&format!("EXTEND_TIMEOUT_USEC={}", time.as_micros()))
        {
            self.extended_ns = Some(now);
        }
    }

    /// The end has begun.
    pub fn stopping(&self) {
        self.send("STOPPING=1");
    }

    /// The line that `systemctl status` shows; a line that it has already is not sent again.
    pub fn set_status(&mut self, line: &str) {
        // One line per variable: a further line would be a further variable.
        if self.socket.is_some() && self.status != line && self.send(&format!("STATUS={}", line.replace('\n', " "))) {
            line.clone_into(&mut self.status);
        }
    }

    /// A pass of the supervision is complete: sends the sign of life if it is due.
    pub fn supervised(&mut self) {
        if self.is_ready_unsent {
            self.ready();
        }
        let now = clock::now_ns();
        if self.pause_ns.is_some_and(|pause_ns| now >= self.last_sign_ns + pause_ns) {
            self.last_sign_ns = now;
            self.send("WATCHDOG=1");
        }
    }

    /// Returns false if the manager's queue is full. A message that cannot be sent at all counts as sent.
    fn send(&self, message: &str) -> bool {
        self.socket.as_ref().is_none_or(|(socket, address)| {
            let sent = socket.send_to_addr(message.as_bytes(), address);
            !sent.is_err_and(|error| error.kind() == ErrorKind::WouldBlock)
        })
    }
}

/// Keeps the variables from a process that the supervisor starts: only the supervisor reports.
pub fn hide_from(command: &mut Command) {
    for name in [SOCKET, WATCHDOG_US, WATCHDOG_PID] {
        command.env_remove(name);
    }
}

fn connect(name: &OsStr) -> Option<(UnixDatagram, SocketAddr)> {
    let bytes = name.as_bytes();
    let address = match bytes.strip_prefix(b"@") {
        Some(abstract_name) => SocketAddr::from_abstract_name(abstract_name).ok()?,
        None => SocketAddr::from_pathname(name).ok().filter(|_| bytes.starts_with(b"/"))?,
    };
    let socket = UnixDatagram::unbound().ok()?;
    socket.set_nonblocking(true).ok()?;
    Some((socket, address))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// A manager, and what it has received.
    struct Fake {
        socket: UnixDatagram,
        variables: HashMap<&'static str, OsString>,
        _folder: tempfile::TempDir,
    }

    impl Fake {
        fn new(watchdog_us: &str) -> Self {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("notify");
            let socket = UnixDatagram::bind(&path).unwrap();
            socket.set_nonblocking(true).unwrap();
            let variables = HashMap::from([(SOCKET, path.into_os_string()), (WATCHDOG_US, watchdog_us.into())]);
            Self { socket, variables, _folder: folder }
        }

        fn client(&self) -> ServiceManager {
            ServiceManager::new(|name| self.variables.get(name).cloned())
        }

        fn received(&self) -> Vec<String> {
            let mut buffer = [0; 512];
            let mut received = Vec::new();
            while let Ok(bytes) = self.socket.recv(&mut buffer) {
                received.push(String::from_utf8_lossy(&buffer[..bytes]).into_owned());
            }
            received
        }
    }

    #[test]
    fn readiness_status_and_end_are_reported_once() {
        let fake = Fake::new("");
        let mut client = fake.client();
        client.set_status("Disarmed");
        client.set_status("Disarmed");
        client.extend_start(Duration::from_secs(45));
        client.extend_start(Duration::from_secs(45));
        client.ready();
        client.supervised();
        client.set_status("two\nlines");
        client.stopping();
        assert_eq!(
            fake.received(),
            ["STATUS=Disarmed", "EXTEND_TIMEOUT_USEC=45000000", "READY=1", "STATUS=two lines", "STOPPING=1"]
        );
    }

    #[test]
    fn a_sign_of_life_comes_several_times_per_watchdog_time() {
        let fake = Fake::new("400000");
        let mut client = fake.client();
        let began = clock::now_ns();
        let mut passes = 0;
        while clock::now_ns() < began + 450_000_000 {
            client.supervised();
            passes += 1;
            clock::sleep_until(clock::now_ns() + 1_000_000);
        }
        let signs = fake.received();
        // Four in 400 ms and the first at once; fewer where the machine stalled, never more.
        let most = 1 + (clock::now_ns() - began) / 100_000_000;
        assert!(signs.iter().all(|sign| sign == "WATCHDOG=1"), "{signs:?}");
        assert!((2..=most as usize).contains(&signs.len()) || passes < 100, "{} of {passes}", signs.len());
        clock::sleep_until(clock::now_ns() + 200_000_000);
        assert!(fake.received().is_empty(), "without supervision there is no sign of life");
    }

    #[test]
    fn a_watchdog_of_another_process_and_a_missing_manager_get_nothing() {
        let mut fake = Fake::new("1000");
        fake.variables.insert(WATCHDOG_PID, "1".into());
        fake.client().supervised();
        assert!(fake.received().is_empty());
        fake.variables.insert(WATCHDOG_PID, std::process::id().to_string().into());
        fake.client().supervised();
        assert_eq!(fake.received(), ["WATCHDOG=1"]);
        for none in ["", "relative", "/proc/nothing/there"] {
            fake.variables.insert(SOCKET, none.into());
            let mut client = fake.client();
            client.supervised();
            client.ready();
            client.set_status("x");
        }
        let mut client = ServiceManager::new(|_| None);
        client.supervised();
        client.set_status("x");
    }

    #[test]
    fn an_abstract_socket_is_reached() {
        let name = format!("nims-test-notify-{}", std::process::id());
        let socket = UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(name.as_bytes()).unwrap()).unwrap();
        ServiceManager::new(|variable| (variable == SOCKET).then(|| format!("@{name}").into())).ready();
        let mut buffer = [0; 64];
        let bytes = socket.recv(&mut buffer).unwrap();
        assert_eq!(&buffer[..bytes], b"READY=1");
    }

    #[test]
    fn a_manager_that_does_not_read_blocks_nothing() {
        let fake = Fake::new("");
        let mut client = fake.client();
        // More than any queue of datagrams holds: net.unix.max_dgram_qlen is 10, or 512 under systemd.
        for number in 0..5000 {
            client.set_status(&number.to_string());
        }
        let received = fake.received();
        assert!(received.len() < 5000 && received.first().is_some_and(|first| first == "STATUS=0"));
        while client.send("STATUS=full") {}
        client.ready();
        assert!(!fake.received().contains(&"READY=1".to_owned()));
        client.set_status("5000");
        client.supervised();
        client.supervised();
        assert_eq!(fake.received(), ["STATUS=5000", "READY=1"], "readiness comes with the next pass");
    }
}
