//! The gateway over its real socket, with a robot on the virtual motor box: roles, hostile clients, deaths, missions by
//! content, runs.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "live/robot/mod.rs"]
mod robot;

use bus::clock;
use gateway_protocol::{Accepted, Call, Decoder, Origin, REPLY_LIMITS, Reply, VERSION, encode};
use messages::{GotoPath, MotorAuthority, OperatorRequest, Request, Slot, SlotRole, text_of};
use robot::{Robot, START, program, steadily};
use robot_state::Periods;
use rustix::process::{Signal, geteuid};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

/// Longest wait for a reply or an event.
const LONG: Duration = Duration::from_secs(60);
/// The robot's user may do everything.
const OWNER: &str = "";

/// A gateway, which is ended when this value is dropped.
struct Gateway {
    child: Child,
    socket: PathBuf,
}

impl Gateway {
    /// Starts the gateway of a robot with these roles in its system file.
    fn start(robot: &Robot, roles: &str) -> Self {
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
    fn joined(robot: &Robot, roles: &str) -> Self {
        let gateway = Self::start(robot, roles);
        gateway.until_joined();
        gateway
    }

    fn until_joined(&self) {
        self.until("it has joined the robot", |gateway| {
            matches!(gateway.client().call(&Call::Robot { id: 1 }), Reply::Robot { robot: Some(_), .. })
        });
    }

    fn until(&self, what: &str, done: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + LONG.as_nanos() as u64;
        while !done(self) {
            assert!(clock::now_ns() < give_up, "{what}: in vain");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn client(&self) -> Client {
        Client::open(&self.socket)
    }

    fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    fn lives(&mut self) -> bool {
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
struct Client {
    stream: UnixStream,
    decoder: Decoder,
}

impl Client {
    fn raw(socket: &Path) -> Self {
        let stream = UnixStream::connect(socket).unwrap();
        stream.set_read_timeout(Some(LONG)).unwrap();
        Self { stream, decoder: Decoder::new(REPLY_LIMITS) }
    }

    fn open(socket: &Path) -> Self {
        let mut client = Self::raw(socket);
        let welcome = client.call(&Call::Hello { version: VERSION, origin: Origin::Python, token: None });
        assert!(matches!(welcome, Reply::Welcome { .. }), "{welcome:?}");
        client
    }

    fn send(&mut self, call: &Call, body: &[u8]) {
        self.stream.write_all(&encode(&call.header().unwrap(), body)).unwrap();
    }

    /// The next reply; `None` if the gateway has closed the connection.
    fn next(&mut self) -> Option<(Reply, Vec<u8>)> {
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

    fn call(&mut self, call: &Call) -> Reply {
        self.call_with(call, &[])
    }

    fn call_with(&mut self, call: &Call, body: &[u8]) -> Reply {
        self.send(call, body);
        loop {
            let (reply, _) = self.next().expect("the connection is open");
            if !matches!(reply, Reply::Definition { .. } | Reply::Sample { .. }) {
                return reply;
            }
        }
    }

    fn ask(&mut self, request: Request) -> (u16, Accepted) {
        answer(&self.call(&Call::Ask { id: 9, request, process: None }))
    }
}

fn answer(reply: &Reply) -> (u16, Accepted) {
    match reply {
        Reply::Answer { reason, accepted, .. } => (*reason, *accepted),
        other => panic!("{other:?}"),
    }
}

/// The operator's command through the gateway.
fn nims(gateway: &Gateway, folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(program());
    command.arg("--gateway").arg(&gateway.socket).args(args).current_dir(folder).output().unwrap()
}

fn told(gateway: &Gateway, folder: &Path, args: &[&str]) -> String {
    let output = nims(gateway, folder, args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The entry for the user of this test.
fn me(role: &str) -> String {
    format!("{role} = [\"{}\"]", geteuid().as_raw())
}

/// Thirty actions, and the lowest role that may do each. What is allowed may fail for another reason.
fn actions() -> Vec<(&'static str, &'static str, Call, Vec<u8>)> {
    let nothing = || "nothing".to_owned();
    let mission = b"not a mission";
    let hash = config::mission_hash("not a mission");
    let run = Request::Run { mission: nothing(), hash, continues: false };
    let plug = Request::Plug { name: "BAD NAME".to_owned(), folder: "/".to_owned(), command: vec![], replace: false };
    let lengths_m = [1.0; 3].into_iter().collect();
    let requests = vec![
        ("stop", "hold", Request::Hold),
        ("stop", "pause", Request::Pause),
        ("stop", "stop", Request::Stop),
        ("stop", "estop", Request::Estop),
        ("fly", "reset", Request::Reset),
        ("fly", "arm", Request::Arm),
        ("fly", "zero at", Request::ZeroAt { position_m: START }),
        ("fly", "zero lengths", Request::ZeroLengths { lengths_m }),
        ("fly", "confirm", Request::ConfirmPosition),
        ("fly", "jog", Request::Jog { cable: 9, distance_m: 0.1 }),
        ("fly", "resume", Request::Resume),
        ("fly", "speed", Request::Speed { rate: 0.5 }),
        ("fly", "swap", Request::Swap { role: SlotRole::Controller, slot: Slot::B }),
        ("fly", "admit", Request::Admit { role: SlotRole::Controller, slot: Slot::B }),
        ("fly", "goto", Request::Goto { to_m: [99.0; 3], path: GotoPath::Line, speed_m_s: None }),
        ("fly", "run", run),
        ("fly", "fault", Request::Fault { text: "no such fault".to_owned() }),
        ("fly", "start", Request::StartProcess { name: nothing(), slot: None, law: None }),
        ("fly", "stop-process", Request::StopProcess { name: nothing() }),
        ("fly", "restart", Request::RestartProcess { name: nothing() }),
        ("owner", "plug", plug),
        ("fly", "unplug", Request::Unplug { name: nothing() }),
        ("fly", "set", Request::Set { key: nothing(), value: "1".to_owned() }),
        ("fly", "disarm", Request::Disarm),
    ];
    let mut actions: Vec<_> = requests
        .into_iter()
        .map(|(role, name, request)| {
            let body = if name == "run" { mission.to_vec() } else { Vec::new() };
            (role, name, Call::Ask { id: 1, request, process: None }, body)
        })
        .collect();
    let plain = [
        ("look", "robot", Call::Robot { id: 1 }),
        ("look", "configuration", Call::Configuration { id: 1 }),
        ("look", "channels", Call::Channels { id: 1 }),
        ("look", "subscribe", Call::Subscribe { id: 1, channel: "motor/state".to_owned(), rate_hz: Some(1.0) }),
        ("look", "runs", Call::Runs { id: 1 }),
        ("owner", "tokens", Call::TokenList { id: 1 }),
    ];
    actions.extend(plain.map(|(role, name, call)| (role, name, call, Vec::new())));
    actions
}

#[test]
fn thirty_actions_pass_or_not_by_the_role() {
    let robot = Robot::up("");
    let order = ["look", "stop", "fly", "owner"];
    assert_eq!(actions().len(), 30);
    for role in order {
        let gateway = Gateway::joined(&robot, &if role == "owner" { OWNER.to_owned() } else { me(role) });
        let mut requests = robot.bus.subscriber::<OperatorRequest>("operator/request").unwrap();
        let rank = |role: &str| order.iter().position(|one| *one == role).unwrap();
        let (mut client, mut passed) = (gateway.client(), 0);
        for (needs, name, call, body) in actions() {
            let reply = client.call_with(&call, &body);
            let refused = matches!(reply, Reply::Answer { reason: 450 | 451, accepted: Accepted::Refused, .. });
            assert_eq!(!refused, rank(role) >= rank(needs), "{role}: {name}: {reply:?}");
            passed += usize::from(!refused);
            if refused {
                continue;
            }
            // It came from the process itself, not from the gateway.
            if let Reply::Answer { reason, sentence, .. } = &reply {
                assert!(!(450..500).contains(reason), "{role}: {name}: {sentence}");
            }
        }
        let expected = match role {
            "look" => 5,
            "stop" => 9,
            "fly" => 28,
            _ => 30,
        };
        assert_eq!(passed, expected, "{role}");
        // The run names the user, not the gateway.
        let own = (geteuid().as_raw(), std::process::id(), OperatorRequest::ORIGIN_PYTHON);
        let mut recorded = 0;
        while let Some(request) = requests.receive().unwrap() {
            if request.origin == OperatorRequest::ORIGIN_PYTHON {
                assert_eq!((request.uid, request.pid, request.origin), own, "{}", text_of(&request.requester));
                recorded += 1;
            }
        }
        assert!(recorded > 0 || role == "look");
    }
}

/// A mission of a home that only its user may enter, by content; the robot flies it to its end. A controller is swapped
/// in flight.
fn flies_its_own_mission(robot: &mut Robot, gateway: &Gateway, home: &Path) {
    let mission = "name = \"own\"\n[[leg]]\nline = { to_m = [4.9, 3.1, 0.4] }\n";
    std::fs::write(home.join("own.toml"), mission).unwrap();
    let flown = told(gateway, home, &["run", "own.toml", "--wait", "--json"]);
    assert!(flown.contains("\"done\":true"), "{flown}");
    robot.poll();
    assert!(robot.distance_m([4.9, 3.1, 0.4]) < 0.05, "{:?}", robot.seen.position_m);
    told(gateway, home, &["goto", "5.2,3.4,0.6", "--speed", "0.1"]);
    let swapped = told(gateway, home, &["swap", "controller", "default"]);
    assert!(swapped.contains("controller-b is in charge"), "{swapped}");
}

/// Commands with the same answer and exit code with and without the gateway.
const SAME: &[&[&str]] = &[
    &["arm"],
    &["zero", "--at", "4.8,3.0,0.3"],
    &["jog", "9", "0.1"],
    &["jog", "4", "0.1"],
    &["goto", "99,99,99"],
    &["goto", "4.8,3.0,0.5", "--speed", "9"],
    &["run", "no-such-mission"],
    &["speed", "50"],
    &["speed", "400"],
    &["resume"],
    &["restart", "nothing"],
    &["set", "controller.horizon_cycles"],
    &["set", "nothing", "1"],
    &["swap", "controller", "--slot", "b"],
    &["channel", "echo", "no/such"],
    &["fault", "nothing"],
    &["fault", "slack", "9"],
    &["confirm-position"],
    &["speed", "100"],
];

#[test]
fn a_command_is_the_same_through_the_gateway() {
    steadily(|| {
        let mut robot = Robot::up("");
        let gateway = Gateway::joined(&robot, &me("fly"));
        let home = tempfile::tempdir().unwrap();
        let same = |args: &[&str]| {
            let (mut direct, through) = (robot.nims(args), nims(&gateway, home.path(), args));
            // The domain of a test has a name of its own.
            let said = String::from_utf8_lossy(&direct.stderr).replace(robot.domain.name(), robot::THREE_CABLES);
            direct.stderr = said.into_bytes();
            assert_eq!(
                (
                    direct.status.code(),
                    String::from_utf8_lossy(&direct.stdout),
                    String::from_utf8_lossy(&direct.stderr)
                ),
                (
                    through.status.code(),
                    String::from_utf8_lossy(&through.stdout),
                    String::from_utf8_lossy(&through.stderr)
                ),
                "{args:?}"
            );
        };
        told(&gateway, home.path(), &["arm"]);
        told(&gateway, home.path(), &["zero", "--at", "4.8,3.0,0.3"]);
        for args in SAME {
            same(args);
        }
        // The status has the same facts.
        let keys = |output: Output| {
            let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
            value.as_object().unwrap().keys().cloned().collect::<Vec<_>>()
        };
        let args = ["status", "--json"];
        assert_eq!(keys(robot.nims(&args)), keys(nims(&gateway, home.path(), &args)));
        let listed = |output: Output| String::from_utf8_lossy(&output.stdout).lines().count();
        let args = ["channel", "list"];
        assert_eq!(listed(robot.nims(&args)), listed(nims(&gateway, home.path(), &args)));
        let hz = told(&gateway, home.path(), &["channel", "hz", "motor/state", "--for", "1", "--json"]);
        let hz: serde_json::Value = serde_json::from_str(&hz).unwrap();
        assert!(hz["channels"][0]["received"].as_u64().unwrap() > 10, "{hz}");
        flies_its_own_mission(&mut robot, &gateway, home.path());
        told(&gateway, home.path(), &["stop"]);
        told(&gateway, home.path(), &["estop"]);
        robot.until("emergency stop", |robot| robot.last.mode == MotorAuthority::MODE_EMERGENCY_STOP);
    });
}

/// Sends what no client should send.
fn malformed(number: usize) -> Vec<u8> {
    let hello = Call::Hello { version: VERSION, origin: Origin::Python, token: None }.header().unwrap();
    let other = Call::Hello { version: VERSION + 1, origin: Origin::Python, token: None }.header().unwrap();
    let greeted = |after: &[u8]| [encode(&hello, &[]), after.to_vec()].concat();
    match number % 8 {
        0 => vec![0xff; 8],
        1 => encode(b"not json", b"body"),
        2 => encode(&other, &[]),
        3 => greeted(&encode(br#"{"call":"fly","id":1}"#, &[])),
        4 => greeted(&u32::MAX.to_le_bytes()),
        5 => greeted(&[[2, 0, 0, 0], [0, 0, 0, 0xff]].concat()),
        6 => greeted(&encode(br#"{"call":"ask","id":1,"request":{"verb":"jog","cable":1}}"#, &[])),
        _ => greeted(&encode(&hello, &[])),
    }
}

#[test]
fn hostile_clients_delay_nobody() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.arm();
        let mut gateway = Gateway::joined(&robot, OWNER);
        let mut honest = gateway.client();
        robot.fly();
        let before = Periods::from_authority(&robot.last);
        // Readers that take nothing, of everything that is published.
        let Reply::Channels { channels, .. } = honest.call(&Call::Channels { id: 1 }) else { panic!() };
        let mut idle = Vec::new();
        for _ in 0..4 {
            let mut client = gateway.client();
            for (id, channel) in channels.iter().enumerate().take(60) {
                client.send(&Call::Subscribe { id: id as u64, channel: channel.name.clone(), rate_hz: None }, &[]);
            }
            idle.push(client);
        }
        // Connections beyond the number of a user, without a word.
        let silent: Vec<UnixStream> = (0..300).filter_map(|_| UnixStream::connect(&gateway.socket).ok()).collect();
        let mut closed = 0;
        for number in 0..10_000 {
            let mut client = Client::raw(&gateway.socket);
            // The gateway may close it before everything is written.
            let _ = client.stream.write_all(&malformed(number));
            if number % 100 == 0 {
                while client.next().is_some() {}
                closed += 1;
            }
        }
        assert_eq!(closed, 100);
        drop(silent);
        assert!(gateway.lives());
        // A client that comes after all of this is served, and stops the robot.
        let mut late = gateway.client();
        assert!(matches!(late.call(&Call::Robot { id: 1 }), Reply::Robot { robot: Some(_), .. }));
        assert_eq!(late.ask(Request::Stop).1, Accepted::Accepted);
        robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        let after = Periods::from_authority(&robot.last);
        assert!(after.steered > before.steered);
        assert_eq!(after.answer, before.answer, "{after:?}");
    });
}

#[test]
fn a_slow_reader_loses_samples_and_is_told_how_many() {
    let mut robot = Robot::up("");
    robot.arm();
    let gateway = Gateway::joined(&robot, OWNER);
    robot.fly();
    let mut slow = gateway.client();
    let Reply::Channels { channels, .. } = gateway.client().call(&Call::Channels { id: 1 }) else { panic!() };
    for (id, channel) in channels.into_iter().enumerate().take(60) {
        slow.send(&Call::Subscribe { id: id as u64, channel: channel.name, rate_hz: None }, &[]);
    }
    // More than the socket and the queue hold.
    std::thread::sleep(Duration::from_secs(5));
    // It still does not read, and stops the robot.
    slow.send(&Call::Ask { id: 99, request: Request::Stop, process: None }, &[]);
    robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    let (mut samples, mut told) = (0_u64, 0);
    while told == 0 {
        let (reply, body) = slow.next().unwrap();
        if let Reply::Sample { dropped, .. } = reply {
            assert!(!body.is_empty());
            samples += 1;
            told = told.max(dropped);
        }
        assert!(samples < 1_000_000);
    }
}

/// Processor time of a process, s.
fn busy_s(pid: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
}

/// Without a free descriptor the gateway serves those that are connected, keeps the robot, and waits without turning.
#[test]
fn three_hundred_connections_without_descriptors_change_nothing_for_those_who_are_there() {
    let mut robot = Robot::up("");
    robot.arm();
    let mut gateway = Gateway::joined(&robot, OWNER);
    let mut honest = gateway.client();
    let pid = gateway.child.id();
    let open = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count() as u64;
    let limit = rustix::process::Rlimit { current: Some(open + 3), maximum: Some(open + 3) };
    let process = rustix::process::Pid::from_child(&gateway.child);
    rustix::process::prlimit(Some(process), rustix::process::Resource::Nofile, limit).unwrap();
    let crowd: Vec<UnixStream> = (0..300).filter_map(|_| UnixStream::connect(&gateway.socket).ok()).collect();
    assert_eq!(crowd.len(), 300);
    let (before_s, begun_ns) = (busy_s(pid), clock::now_ns());
    for _ in 0..40 {
        assert!(matches!(honest.call(&Call::Robot { id: 1 }), Reply::Robot { robot: Some(_), .. }));
        assert_eq!(honest.ask(Request::Hold).1, Accepted::Accepted);
        std::thread::sleep(Duration::from_millis(100));
    }
    // A process that turns takes whole seconds of these.
    let share = (busy_s(pid) - before_s) / ((clock::now_ns() - begun_ns) as f64 * 1e-9);
    assert!(share < 0.25, "{share} of a processor for forty answers");
    assert!(gateway.lives());
    drop(crowd);
    gateway.until("a newcomer is served", |gateway| {
        let mut client = Client::raw(&gateway.socket);
        let hello = Call::Hello { version: VERSION, origin: Origin::Python, token: None };
        // It may still be closed.
        let _ = client.stream.write_all(&encode(&hello.header().unwrap(), &[]));
        matches!(client.next(), Some((Reply::Welcome { .. }, _)))
    });
    assert_eq!(honest.ask(Request::Stop).1, Accepted::Accepted);
}

/// Whatever was requested before a stop, the robot does not move after it.
#[test]
fn a_motion_that_was_requested_before_a_stop_never_begins_after_it() {
    steadily(|| {
        let mut robot = Robot::up("");
        robot.arm();
        robot.ask("motor-io", Request::ZeroAt { position_m: START });
        let gateway = Gateway::joined(&robot, OWNER);
        let mut client = gateway.client();
        let stops = [Request::Stop, Request::Hold, Request::Pause];
        // The planner takes them up only after the stop.
        for stop in &stops {
            robot.signal("planner", Signal::STOP);
            let late = Request::Goto { to_m: robot::GOAL, path: GotoPath::Line, speed_m_s: Some(0.1) };
            client.send(&Call::Ask { id: 1, request: late, process: None }, &[]);
            // Sent to the planner, which does not answer.
            std::thread::sleep(Duration::from_millis(200));
            client.send(&Call::Ask { id: 2, request: stop.clone(), process: None }, &[]);
            let mut answers = Vec::new();
            while answers.len() < 2 {
                let Some((Reply::Answer { id, reason, accepted, .. }, _)) = client.next() else { panic!() };
                answers.push((id, reason, accepted));
                if id == 2 {
                    robot.signal("planner", Signal::CONT);
                }
            }
            answers.sort_by_key(|(id, ..)| *id);
            assert_eq!((answers[0].1, answers[1].2), (455, Accepted::Accepted), "{answers:?}");
            for _ in 0..20 {
                robot.for_cycles(5);
                assert_eq!(robot.last.mode, MotorAuthority::MODE_HOLDING, "{stop:?}");
            }
        }
        for round in 0..30_usize {
            let frame = |id, request| encode(&Call::Ask { id, request, process: None }.header().unwrap(), &[]);
            let mut bytes = Vec::new();
            let motions = 1 + round % 4;
            for id in 0..motions {
                let target = [START[0] + 0.3, START[1], START[2] + 0.1 * (1 + id) as f64];
                let motion = match round % 5 {
                    4 => Request::Jog { cable: 1, distance_m: 0.02 },
                    _ => Request::Goto { to_m: target, path: GotoPath::Line, speed_m_s: Some(0.1) },
                };
                bytes.extend(frame(id as u64, motion));
            }
            client.stream.write_all(&bytes).unwrap();
            // While they wait, while they are planned, or when they have begun.
            std::thread::sleep(Duration::from_millis(round as u64));
            client.stream.write_all(&frame(50, stops[round % 3].clone())).unwrap();
            let mut answers = 0;
            while answers <= motions {
                let Some((Reply::Answer { id, accepted, sentence, .. }, _)) = client.next() else { panic!() };
                assert!(id != 50 || accepted == Accepted::Accepted, "{sentence}");
                answers += 1;
            }
            // A motion that began before the stop comes to rest; then none begins.
            robot.for_cycles(3);
            robot.until("at rest", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
            for _ in 0..10 {
                robot.for_cycles(5);
                assert_eq!(robot.last.mode, MotorAuthority::MODE_HOLDING, "round {round}");
            }
            // Drops one that was paused.
            assert_eq!(client.ask(Request::Stop).1, Accepted::Accepted);
        }
    });
}

#[test]
fn the_gateway_outlives_the_robot_and_its_own_death_stops_nothing() {
    let mut robot = Robot::up("");
    robot.arm();
    let mut gateway = Gateway::joined(&robot, OWNER);
    robot.fly();
    // Killed in flight: the motion continues, and the next gateway finds the robot.
    gateway.kill();
    robot.for_cycles(50);
    assert_ne!(robot.last.mode, MotorAuthority::MODE_STOPPING);
    drop(gateway);
    let mut gateway = Gateway::joined(&robot, OWNER);
    let mut client = gateway.client();
    assert_eq!(client.ask(Request::Stop).1, Accepted::Accepted);
    client.call(&Call::Subscribe { id: 4, channel: "motor/authority".to_owned(), rate_hz: Some(5.0) });
    // The robot without its supervisor is still stopped through the gateway.
    robot.down(Signal::KILL);
    let (_, accepted) = client.ask(Request::Estop);
    assert_eq!(accepted, Accepted::Accepted);
    robot.until("emergency stop", |robot| robot.last.mode == MotorAuthority::MODE_EMERGENCY_STOP);
    for node in robot.domain.alive() {
        if !["gateway", "observer"].contains(&node.name.as_str()) {
            robot.signal(&node.name, Signal::KILL);
        }
    }
    gateway.until("no robot runs", |gateway| gateway.client().ask(Request::Arm).0 == 452);
    // The remains of its socket are no motor-io either.
    assert!(matches!(client.ask(Request::Estop).0, 452 | 455));
    assert!(matches!(client.call(&Call::Robot { id: 1 }), Reply::Robot { robot: None, .. }));
    // The next life, on the same connection: requests and the subscription go on.
    robot.up_again("");
    gateway.until_joined();
    client.ask(Request::Reset);
    let life = robot.last.header.life;
    let give_up = clock::now_ns() + LONG.as_nanos() as u64;
    loop {
        let (reply, body) = client.next().unwrap();
        if let Reply::Sample { id: 4, .. } = reply
            && bytemuck::pod_read_unaligned::<MotorAuthority>(&body).header.life == life
        {
            break;
        }
        assert!(clock::now_ns() < give_up);
    }
    assert_eq!(client.ask(Request::Arm).1, Accepted::Accepted);
    assert!(gateway.lives());
    // An orderly end leaves nothing behind, although the gateway was on the bus.
    robot.down(Signal::INT);
    gateway.until("no robot runs", |gateway| gateway.client().ask(Request::Arm).0 == 452);
}

#[test]
fn a_stop_needs_no_place_that_others_can_take() {
    let mut robot = Robot::up("");
    robot.arm();
    let gateway = Gateway::joined(&robot, OWNER);
    robot.fly();
    // Every place of motor-io's clients that is left.
    let mut held = Vec::new();
    let buses: Vec<bus::Bus> =
        (0..40).map(|i| bus::Bus::join(&robot.domain, &format!("greedy-{i}")).unwrap()).collect();
    for bus in &buses {
        held.extend(bus.client("motor-io").ok());
    }
    assert!(held.len() < 40, "there is a place for each: {}", held.len());
    let mut client = gateway.client();
    assert_eq!(client.ask(Request::Stop).1, Accepted::Accepted);
    assert_eq!(client.ask(Request::Estop).1, Accepted::Accepted);
    robot.until("emergency stop", |robot| robot.last.mode == MotorAuthority::MODE_EMERGENCY_STOP);
}

#[test]
fn a_finished_run_is_fetched_whole_and_only_a_finished_one() {
    let mut robot = Robot::up("");
    robot.for_cycles(100);
    let run = robot.run().file_name().unwrap().to_str().unwrap().to_owned();
    let gateway = Gateway::joined(&robot, OWNER);
    let home = tempfile::tempdir().unwrap();
    let refused = nims(&gateway, home.path(), &["fetch", &run]);
    assert_eq!(refused.status.code(), Some(2), "{}", String::from_utf8_lossy(&refused.stderr));
    robot.down(Signal::INT);
    gateway.until("the run is finished", |gateway| told(gateway, home.path(), &["runs"]).contains(&run));
    told(&gateway, home.path(), &["fetch", &run, "copy"]);
    let same = |name: &str| {
        std::fs::read(robot.run().join(name)).unwrap() == std::fs::read(home.path().join("copy").join(name)).unwrap()
    };
    assert!(same("run.mcap") && same("manifest.json") && same("log/motor-io.txt"));
    // A report from the copy needs no robot; one of a closed folder is made through the gateway, and is the same.
    let from_copy = told(&gateway, home.path(), &["info", "copy"]);
    assert!(from_copy.contains("motor/input"), "{from_copy}");
    let contents = |text: &str| text.lines().filter(|line| !line.starts_with("file ")).collect::<Vec<_>>().join("\n");
    assert_eq!(contents(&told(&gateway, home.path(), &["info", &run])), contents(&from_copy));
    told(&gateway, home.path(), &["report", &run]);
    let page = std::fs::read_to_string(home.path().join(format!("{run}.html"))).unwrap();
    assert!(page.contains("<html") && !robot.run().join("report.html").exists());
    let refused = nims(&gateway, home.path(), &["info", "no-such-run"]);
    assert_eq!(refused.status.code(), Some(2), "{}", String::from_utf8_lossy(&refused.stderr));
    for name in ["../state", "..", "/etc", "no-such-run"] {
        let refused = nims(&gateway, home.path(), &["fetch", name, "other"]);
        assert_eq!(refused.status.code(), Some(2), "{name}");
    }
    assert!(!home.path().join("other").exists());
}

/// A plug-in in Python, which knows nothing but the socket: its readings are a channel as that of any sensor.
#[test]
fn a_plug_in_publishes_through_the_gateway() {
    let mut robot = Robot::up("");
    robot.arm();
    let declared = "[[plugin]]\nname = \"soil\"\nquantity = [\"moisture\", \"temperature\"]\nunit = [\"%\", \"°C\"]\nrate_hz = 50.0\nlever_m = [0.0, 0.0, -0.5]\n";
    let gateway = Gateway::joined(&robot, declared);
    let script = "import nims_gateway\nwith nims_gateway.Sensor() as sensor:\n    sent = 0\n    while sent < 20:\n        sent += \
                  sensor.send([sent, None], age_s=0.25)\n        nims_gateway.time.sleep(0.05)\n    try:\n        \
                  sensor.send([1.0])\n    except nims_gateway.Refused as refused:\n        print(refused.reason, refused)\n";
    let mut readings = robot.bus.subscriber::<messages::Reading>("sensor/soil").unwrap();
    let python = std::env::var("NIMS_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let mut plugin = Command::new(python);
    plugin.args(["-c", script]).env("PYTHONPATH", robot::root().join("scripts/python")).env("NIMS_NAME", "soil");
    plugin.env("NIMS_GATEWAY", &gateway.socket).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut plugin = plugin.spawn().unwrap();
    let mut values = Vec::new();
    while plugin.try_wait().unwrap().is_none() {
        while let Some(reading) = readings.receive().unwrap() {
            assert!(reading.count == 2 && reading.value[1].is_nan() && reading.lever_m == [0.0, 0.0, -0.5]);
            assert_eq!(reading.header.stamp_ns - reading.header.oldest_input_ns, 250_000_000);
            let words = (text_of(&reading.quantity), text_of(&reading.unit));
            assert_eq!(words, ("moisture,temperature".to_owned(), "%,°C".to_owned()));
            values.push(reading.value[0]);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let output = plugin.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && said.starts_with("456 "), "{said}{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(values, (0..20).map(f64::from).collect::<Vec<_>>());
    // The channel ends with the connection, and is in the run.
    gateway.until("the channel is closed", |gateway| {
        let Reply::Channels { channels, .. } = gateway.client().call(&Call::Channels { id: 1 }) else { panic!() };
        channels.iter().all(|row| row.name != "sensor/soil" || row.processes.iter().all(|name| name != "gateway"))
    });
    // Without systemd it says so; nothing is started as the robot's user instead.
    if !Path::new("/run/systemd/system").exists() {
        let start = Request::StartProcess { name: "soil".to_owned(), slot: None, law: None };
        assert_eq!(gateway.client().ask(start).0, 471);
    }
    robot.down(Signal::INT);
    let listed = Command::new(program()).args(["info", robot.run().to_str().unwrap()]).output().unwrap();
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    assert!(listed.contains("sensor/soil"), "{listed}");
}

#[test]
fn a_token_acts_with_its_own_role() {
    let mut robot = Robot::up("");
    robot.arm();
    let gateway = Gateway::joined(&robot, OWNER);
    let home = tempfile::tempdir().unwrap();
    let secret = told(&gateway, home.path(), &["token", "add", "tablet", "stop"]);
    assert!(told(&gateway, home.path(), &["token", "list"]).contains("tablet"));
    let with_token = |args: &[&str]| {
        let mut command = Command::new(program());
        command.arg("--gateway").arg(&gateway.socket).args(args).env("NIMS_TOKEN", secret.trim());
        command.current_dir(home.path()).output().unwrap()
    };
    assert!(with_token(&["stop"]).status.success());
    let refused = with_token(&["arm"]);
    let sentence = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(1) && sentence.contains("tablet") && sentence.contains("arm"), "{sentence}");
    told(&gateway, home.path(), &["token", "revoke", "tablet"]);
    assert_eq!(with_token(&["stop"]).status.code(), Some(1));
}

#[test]
fn the_example_of_the_page_speaks_with_the_gateway() {
    let mut robot = Robot::up("");
    robot.arm();
    let gateway = Gateway::joined(&robot, OWNER);
    let page = std::fs::read_to_string(robot::root().join("docs/gateway.md")).unwrap();
    let example = page.split("```python\n").nth(1).unwrap().split("```").next().unwrap();
    let python = std::env::var("NIMS_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let output = Command::new(python).args(["-c", example]).arg(&gateway.socket).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("holding") && said.matches("cycle ").count() >= 3, "{said}");
    // Its text has no more lines than a page.
    assert!(example.lines().count() <= 60);
}
