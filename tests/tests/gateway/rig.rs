//! A gateway beside a robot, and clients of both kinds: the command and the plain protocol.

use crate::robot::{Robot, program};
use bus::clock;
use gateway_protocol::{Accepted, Call, Decoder, Origin, REPLY_LIMITS, Reply, VERSION, encode};
use messages::Request;
use rustix::process::{Signal, geteuid};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};
use std::time::Duration;

/// Longest wait for a reply or an event.
pub const LONG: Duration = Duration::from_secs(60);

/// The robot's user may do everything.
pub const OWNER: &str = "";

/// A gateway, which is ended when this value is dropped.
pub struct Gateway {
    pub child: Child,
    pub socket: PathBuf,
}

impl Gateway {
    /// Starts the gateway of a robot with these roles in its system file.
    pub fn start(robot: &Robot, roles: &str) -> Self {
        let folder = robot.folder();
        let text = std::fs::read_to_string(folder.join("configs/systems/demo3.toml")).unwrap();
        let system = folder.join("configs/systems/gateway.toml");
        // The runs of these tests lie in the folder of the robot.
        std::fs::write(&system, format!("runs = \"../..\"\n{text}\n[gateway]\n{roles}\n")).unwrap();
        let socket = folder.join("robot.sock");
        let log = std::fs::OpenOptions::new().append(true).create(true).open(folder.join("gateway-said")).unwrap();
        let child = Command::new(program().with_file_name("gateway"))
            .args(["--domain", robot.domain.name(), "--socket"])
            .arg(&socket)
            .arg("--system")
            .arg(&system)
            .arg("--state")
            .arg(folder.join("state"))
            .stderr(log)
            .spawn()
            .unwrap();
        let gateway = Self { child, socket };
        gateway.until("it listens", |gateway| UnixStream::connect(&gateway.socket).is_ok());
        gateway
    }

    /// Started, and joined to the robot.
    pub fn joined(robot: &Robot, roles: &str) -> Self {
        let gateway = Self::start(robot, roles);
        gateway.until_joined();
        gateway
    }

    pub fn until_joined(&self) {
        self.until("it has joined the robot", |gateway| {
            matches!(gateway.client().call(&Call::Robot { id: 1 }), Reply::Robot { robot: Some(_), .. })
        });
    }

    pub fn until(&self, what: &str, done: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + LONG.as_nanos() as u64;
        while !done(self) {
            assert!(clock::now_ns() < give_up, "{what}: in vain");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn client(&self) -> Client {
        Client::open(&self.socket)
    }

    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    pub fn lives(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }
}

impl Drop for Gateway {
    fn drop(&mut self) {
        let _ = rustix::process::kill_process(rustix::process::Pid::from_child(&self.child), Signal::TERM);
        let _ = self.child.wait();
    }
}

/// A client that speaks the protocol by itself.
pub struct Client {
    pub stream: UnixStream,
    pub decoder: Decoder,
}

impl Client {
    pub fn raw(socket: &Path) -> Self {
        let stream = UnixStream::connect(socket).unwrap();
        stream.set_read_timeout(Some(LONG)).unwrap();
        Self { stream, decoder: Decoder::new(REPLY_LIMITS) }
    }

    pub fn open(socket: &Path) -> Self {
        let mut client = Self::raw(socket);
        let welcome = client.call(&Call::Hello { version: VERSION, origin: Origin::Python, token: None, from: None });
        assert!(matches!(welcome, Reply::Welcome { .. }), "{welcome:?}");
        client
    }

    pub fn send(&mut self, call: &Call, body: &[u8]) {
        self.stream.write_all(&encode(&call.header().unwrap(), body)).unwrap();
    }

    /// The next reply; `None` if the gateway has closed the connection.
    pub fn next(&mut self) -> Option<(Reply, Vec<u8>)> {
        let mut bytes = [0; 4096];
        loop {
            if let Some(frame) = self.decoder.next_frame().unwrap() {
                return Some((Reply::read(&frame.header).unwrap(), frame.body));
            }
            match self.stream.read(&mut bytes) {
                Ok(0) => return None,
                Err(error) if error.kind() == ErrorKind::ConnectionReset => return None,
                Err(error) => panic!("no reply: {error}"),
                Ok(length) => self.decoder.push(&bytes[..length]),
            }
        }
    }

    pub fn call(&mut self, call: &Call) -> Reply {
        self.call_with(call, &[])
    }

    pub fn call_with(&mut self, call: &Call, body: &[u8]) -> Reply {
        self.send(call, body);
        loop {
            let (reply, _) = self.next().expect("the connection is open");
            if !matches!(reply, Reply::Definition { .. } | Reply::Sample { .. }) {
                return reply;
            }
        }
    }

    pub fn ask(&mut self, request: Request) -> (u16, Accepted) {
        answer(&self.call(&Call::Ask { id: 9, request, process: None, held: false, at_ns: None, pressed_ns: None }))
    }
}

pub fn answer(reply: &Reply) -> (u16, Accepted) {
    match reply {
        Reply::Answer { reason, accepted, .. } => (*reason, *accepted),
        other => panic!("{other:?}"),
    }
}

/// The operator's command through the gateway.
pub fn nims(gateway: &Gateway, folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(program());
    command.arg("--gateway").arg(&gateway.socket).args(args).current_dir(folder).output().unwrap()
}

pub fn told(gateway: &Gateway, folder: &Path, args: &[&str]) -> String {
    let output = nims(gateway, folder, args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The entry for the user of this test.
pub fn me(role: &str) -> String {
    format!("{role} = [\"{}\"]", geteuid().as_raw())
}
