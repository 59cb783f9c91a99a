//! A robot on the virtual motor box, its gateway and its page, each in a folder and a domain of its own, and browsers.

#![allow(dead_code)] // each test uses a part of it

use bus::{Domain, TestDomain};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::channel;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// Longest wait for an event: it is exceeded only by an error, because a machine may stand still for seconds.
pub const LONG: Duration = Duration::from_secs(60);

/// Two robots at once would take processor time from each other.
static ONE_ROBOT: Mutex<()> = Mutex::new(());

/// A process that is ended when it is dropped.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = kill_process(Pid::from_child(&self.0), Signal::INT);
        let begun = Instant::now();
        while begun.elapsed() < LONG && self.0.try_wait().ok().flatten().is_none() {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A robot with its gateway and its page. They end in this order.
pub struct Rig {
    page: Process,
    _gateway: Process,
    robot: Option<Process>,
    pub address: String,
    socket: PathBuf,
    folder: tempfile::TempDir,
    domain: TestDomain,
    _alone: MutexGuard<'static, ()>,
}

fn program(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_BIN_EXE_nims-page")).with_file_name(name);
    assert!(path.is_file(), "{} is missing: run `cargo build --workspace --bins` first", path.display());
    path
}

/// The example files, because a robot stores its files beside them.
fn copy_configs(folder: &Path) {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    for place in ["robots", "systems", "missions", "sensors", "ground"] {
        let to = folder.join("configs").join(place);
        std::fs::create_dir_all(&to).unwrap();
        for entry in std::fs::read_dir(from.join(place)).unwrap() {
            let entry = entry.unwrap();
            if entry.path().is_file() {
                std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
            }
        }
    }
}

/// Starts the page and its gateway by one command, which ends with its standard input. Returns what it prints first, up
/// to the code, and whether it ends well.
pub fn started_and_ended() -> (String, bool) {
    let (folder, domain) = (tempfile::tempdir().unwrap(), Domain::for_test());
    copy_configs(folder.path());
    let mut command = Command::new(program("nims-page"));
    command.args(["start", "--parent", "--no-browser", "--port", "0", "--domain", domain.name(), "--state"]);
    command.arg(folder.path().join("page")).arg(folder.path().join("configs/systems/demo3.toml"));
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
    let printed = lines.by_ref().find(|line| line.contains("#code=")).unwrap_or_default();
    drop(child.stdin.take());
    lines.for_each(drop);
    (printed, child.wait().unwrap().success())
}

impl Rig {
    /// Starts all three; the page is for this machine only.
    pub fn up() -> Self {
        Self::up_at("127.0.0.1")
    }

    /// Starts all three; the page listens at this address.
    pub fn up_at(listens: &str) -> Self {
        let alone = ONE_ROBOT.lock().unwrap_or_else(PoisonError::into_inner);
        let (folder, domain) = (tempfile::tempdir().unwrap(), Domain::for_test());
        copy_configs(folder.path());
        std::fs::create_dir(folder.path().join("state")).unwrap();
        let (system, socket) = (folder.path().join("configs/systems/demo3.toml"), folder.path().join("robot.sock"));
        let mut robot = Command::new(program("nims"));
        robot.args(["up", "--domain", domain.name(), "--run"]).arg(folder.path().join("runs/first")).arg(&system);
        let robot = Process(robot.stdout(Stdio::null()).stderr(log(folder.path(), "robot")).spawn().unwrap());
        let mut gateway = Command::new(program("gateway"));
        gateway.args(["--domain", domain.name(), "--socket"]).arg(&socket).arg("--system").arg(&system);
        gateway.arg("--state").arg(folder.path().join("state")).stderr(log(folder.path(), "gateway"));
        let gateway = Process(gateway.spawn().unwrap());
        let mut page = Command::new(program("nims-page"));
        page.args(["serve", "--address", listens, "--port", "0", "--gateway"])
            .arg(&socket)
            .arg("--state")
            .arg(folder.path().join("page"));
        let mut page = page.stderr(Stdio::piped()).spawn().unwrap();
        let mut said = BufReader::new(page.stderr.take().unwrap()).lines();
        let line = said.by_ref().map_while(Result::ok).find(|line| line.contains("://127.0.0.1:")).unwrap();
        // What it says later is read, so that it never waits for a reader.
        std::thread::spawn(move || said.map_while(Result::ok).for_each(|line| println!("{line}")));
        let address = line.split("://").nth(1).unwrap().trim_end_matches('/').to_owned();
        Self {
            page: Process(page),
            _gateway: gateway,
            robot: Some(robot),
            address,
            socket,
            folder,
            domain,
            _alone: alone,
        }
    }

    fn nims(&self, args: &[&str]) -> String {
        let begun = Instant::now();
        loop {
            let mut command = Command::new(program("nims"));
            command.arg("--gateway").arg(&self.socket).args(args).current_dir(self.folder.path());
            let output = command.output().unwrap();
            if output.status.success() {
                return String::from_utf8(output.stdout).unwrap();
            }
            assert!(begun.elapsed() < LONG, "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// A command of the robot's user, past the gateway.
    pub fn command(&self, verb: &str) {
        let output = Command::new(program("nims")).args(["--domain", self.domain.name(), verb]).output().unwrap();
        assert!(output.status.success(), "{verb}: {}", String::from_utf8_lossy(&output.stderr));
    }

    /// A new token.
    pub fn token(&self, holder: &str, role: &str) -> String {
        let printed = self.nims(&["token", "list"]);
        if printed.lines().any(|line| line.split_whitespace().next() == Some(holder)) {
            self.revoke(holder);
        }
        let printed = self.nims(&["token", "add", holder, role]);
        let token = printed.split_whitespace().find(|word| word.len() == 64);
        token.unwrap_or_else(|| panic!("no token: {printed}")).to_owned()
    }

    /// A code for one browser, as `nims page pair` prints it.
    pub fn code(&self, holder: &str, role: &str) -> String {
        // Waits for the gateway, which starts at the same time as the page.
        self.nims(&["token", "list"]);
        let mut command = Command::new(program("nims-page"));
        command.args(["pair", holder, "--role", role, "--gateway"]).arg(&self.socket);
        let output = command.arg("--state").arg(self.folder.path().join("page")).output().unwrap();
        let printed = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let port = self.address.rsplit(':').next().unwrap();
        assert!(printed.contains(&format!(":{port}/#code=")), "{printed}");
        let code = printed.split("#code=").nth(1).unwrap().lines().next().unwrap();
        code.to_owned()
    }

    /// The answer of a command of the page.
    pub fn page_json(&self, args: &[&str]) -> Value {
        let mut command = Command::new(program("nims-page"));
        let output = command.args(args).arg("--json").arg("--gateway").arg(&self.socket).output().unwrap();
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    pub fn revoke(&self, holder: &str) {
        self.nims(&["token", "revoke", holder]);
    }

    /// Adds a finished run of before: the short flight of the golden test.
    pub fn add_run(&self, name: &str) {
        let folder = self.folder.path().join("runs").join(name);
        std::fs::create_dir_all(&folder).unwrap();
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/run.mcap");
        std::fs::copy(golden, folder.join("run.mcap")).unwrap();
        let manifest = json!({ "name": name, "started_utc": "2026-01-01 10:00:00 UTC", "ended_utc": "2026-01-01 10:00:30 UTC",
            "ended_because": "it was the end of the day", "files": ["run.mcap"] });
        std::fs::write(folder.join("manifest.json"), manifest.to_string()).unwrap();
    }

    /// Ends the robot; returns the folder of its run.
    pub fn end_robot(&mut self) -> PathBuf {
        self.robot = None;
        self.folder.path().join("runs/first")
    }

    pub fn signal_page(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.page.0), signal).unwrap();
    }

    /// Waits for a mode by the command line, without the page.
    pub fn until_mode(&self, mode: &str) {
        let begun = Instant::now();
        loop {
            let status: Value = serde_json::from_str(&self.nims(&["status", "--json"])).unwrap();
            if status["mode"] == mode {
                return;
            }
            assert!(begun.elapsed() < LONG, "{mode}: in vain, {status}");
        }
    }

    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Processor time of the page so far, s.
    pub fn page_cpu_s(&self) -> f64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.page.0.id())).unwrap();
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
        // utime and stime, in ticks of 10 ms on every Linux
        (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
    }

    /// Memory of the page, MB.
    pub fn page_memory_mb(&self) -> f64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.page.0.id())).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1000.0
    }

    pub fn browser(&self, token: Option<&str>) -> Browser {
        let begun = Instant::now();
        loop {
            if let Some(browser) = self.try_browser(token) {
                return browser;
            }
            assert!(begun.elapsed() < LONG, "no conversation begins");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// `None` if the page has no place, or its gateway is not there yet.
    pub fn try_browser(&self, token: Option<&str>) -> Option<Browser> {
        Self::try_browser_at(&self.address, token)
    }

    /// A browser whose connection takes this time in each direction.
    pub fn far_browser(&self, token: Option<&str>, delay: Duration) -> Browser {
        let proxy = delayed(self.address.clone(), delay);
        let begun = Instant::now();
        loop {
            if let Some(browser) = Self::try_browser_at(&proxy, token) {
                return browser;
            }
            assert!(begun.elapsed() < LONG, "no conversation begins");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn try_browser_at(address: &str, token: Option<&str>) -> Option<Browser> {
        let stream = TcpStream::connect(address).ok()?;
        stream.set_read_timeout(Some(LONG)).unwrap();
        let mut request = format!("ws://{address}/ws").into_client_request().unwrap();
        request.headers_mut().insert("origin", format!("http://{address}").parse().unwrap());
        let (socket, _) = tungstenite::client(request, stream).ok()?;
        let mut browser = Browser { socket, welcome: Value::Null, last_id: 0, seen: (0.0, Instant::now()) };
        browser.send(&json!({ "call": "hello", "token": token }));
        browser.welcome = browser.next()?;
        (browser.welcome["type"] == "welcome").then_some(browser)
    }
}

/// Passes connections on with a delay; returns the address at which it listens.
fn delayed(to: String, delay: Duration) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        for near in listener.incoming().map_while(Result::ok) {
            let Ok(far) = TcpStream::connect(&to) else { continue };
            for (from, into) in [(&near, &far), (&far, &near)] {
                let _ = into.set_nodelay(true);
                let (mut from, mut into) = (from.try_clone().unwrap(), into.try_clone().unwrap());
                let (pieces, later) = channel::<(Instant, Vec<u8>)>();
                std::thread::spawn(move || {
                    let mut bytes = [0; 65536];
                    while let Ok(length @ 1..) = from.read(&mut bytes) {
                        if pieces.send((Instant::now() + delay, bytes[..length].to_vec())).is_err() {
                            return;
                        }
                    }
                });
                std::thread::spawn(move || {
                    for (due, piece) in later {
                        std::thread::sleep(due.saturating_duration_since(Instant::now()));
                        if into.write_all(&piece).is_err() {
                            break;
                        }
                    }
                    let _ = into.shutdown(Shutdown::Both);
                });
            }
        }
    });
    address
}

fn log(folder: &Path, name: &str) -> std::fs::File {
    std::fs::File::create(folder.join(format!("{name}-said"))).unwrap()
}

/// A browser, without a screen.
pub struct Browser {
    socket: WebSocket<TcpStream>,
    pub welcome: Value,
    last_id: u64,
    /// Time of the server in the newest state, ms, and when it came.
    seen: (f64, Instant),
}

impl Browser {
    /// What a sign of this browser carries.
    pub fn sign(&self) -> Value {
        let (seen_ms, came) = self.seen;
        json!({ "made_ms": seen_ms + came.elapsed().as_secs_f64() * 1e3, "seen_ms": seen_ms })
    }

    pub fn beat(&mut self) {
        let sign = self.sign();
        self.send(&json!({ "call": "beat", "sign": sign }));
    }

    pub fn send(&mut self, value: &Value) {
        self.send_text(&value.to_string());
    }

    pub fn send_text(&mut self, text: &str) {
        self.socket.send(Message::text(text)).unwrap();
    }

    /// `false` if the conversation has ended.
    pub fn try_send(&mut self, value: &Value) -> bool {
        self.socket.send(Message::text(value.to_string())).is_ok()
    }

    pub fn try_send_text(&mut self, text: &str) -> bool {
        self.socket.send(Message::text(text)).is_ok()
    }

    pub fn try_send_bytes(&mut self, bytes: Vec<u8>) -> bool {
        self.socket.send(Message::binary(bytes)).is_ok()
    }

    /// The next message; `None` after the last one.
    fn next(&mut self) -> Option<Value> {
        loop {
            match self.socket.read() {
                Ok(Message::Text(text)) => {
                    let told: Value = serde_json::from_str(&text).unwrap();
                    if let Some(at_ms) = told["at_ms"].as_f64() {
                        self.seen = (at_ms, Instant::now());
                    }
                    return Some(told);
                }
                Ok(Message::Close(_)) | Err(_) => return None,
                Ok(_) => {}
            }
        }
    }

    /// Takes a message; `false` after the last one.
    pub fn take_one(&mut self) -> bool {
        self.next().is_some()
    }

    pub fn until(&mut self, what: &str, done: impl Fn(&Value) -> bool) -> Value {
        let (begun, mut last) = (Instant::now(), Value::Null);
        while begun.elapsed() < LONG {
            let told = self.next().unwrap_or_else(|| panic!("{what}: the conversation ended after {last}"));
            if done(&told) {
                return told;
            }
            last = told;
        }
        panic!("{what}: in vain, last {last}");
    }

    pub fn until_state(&mut self, what: &str, done: impl Fn(&Value) -> bool) -> Value {
        self.until(what, |told| told["type"] == "state" && done(told))
    }

    pub fn until_closed(&mut self) {
        let begun = Instant::now();
        while self.next().is_some() {
            assert!(begun.elapsed() < LONG, "the conversation goes on");
        }
    }

    /// Sends a call and returns its reply.
    pub fn call(&mut self, mut call: Value) -> Value {
        self.last_id += 1;
        let id = self.last_id;
        call["id"] = json!(id);
        if call["call"] == "held" && call["sign"].is_null() {
            call["sign"] = self.sign();
        }
        self.send(&call);
        self.until("a reply", |told| told["id"] == id && told["reply"].is_string())
    }

    pub fn ask(&mut self, request: Value) -> Value {
        self.call(json!({ "call": "ask", "request": request }))
    }

    /// Requests a motion until it is accepted: the planner may not have seen yet that the one before is over.
    pub fn insist(&mut self, call: &Value) {
        let begun = Instant::now();
        loop {
            let answer = self.call(call.clone());
            if answer["accepted"] == "accepted" {
                return;
            }
            assert!(begun.elapsed() < LONG, "in vain: {answer}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Holds the control of a motion until the robot is in that mode. On a machine that stands still the signs come too
    /// late and the motion ends; then it is requested again.
    pub fn hold_until(&mut self, request: &Value, mode: &str) {
        let begun = Instant::now();
        loop {
            self.insist(&json!({ "call": "held", "request": request }));
            for _ in 0..100 {
                self.beat();
                if self.until_state("a state", |_| true)["mode"] == mode {
                    return;
                }
            }
            assert!(begun.elapsed() < LONG, "{mode}: in vain");
        }
    }
}

/// Armed and zeroed by the holder of a token.
pub fn ready(flyer: &mut Browser, at_m: [f64; 3]) {
    flyer.until_state("the robot is up", |state| state["cycle"]["number"].as_u64().is_some_and(|cycle| cycle > 50));
    for request in [json!({ "verb": "arm" }), json!({ "verb": "zero-at", "position_m": at_m })] {
        let answer = flyer.ask(request);
        assert_eq!(answer["accepted"], "accepted", "{answer}");
    }
    flyer.until_state("the position is known", |state| state["position_known"] == 2 && state["within_m"].is_f64());
}
