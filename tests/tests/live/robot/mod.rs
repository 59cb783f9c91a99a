//! A running robot for tests that count its cycles: `nims up` on a virtual motor box.
#![allow(dead_code, unused_imports)] // each test uses a part of it

mod moves;
mod starvation;
mod steady;
mod swapped;

pub use moves::goto;
pub use steady::steadily;
pub use swapped::{Late, SWAPS};

use bus::{Bus, Client, Domain, Subscriber, TestDomain, clock};
use messages::{
    GotoPath, MotorAuthority, MotorInput, MotorSlots, OperatorRequest, RecorderStatus, Request, TruthNode, text_of,
};
use robot_state::answers::Reason;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Three cables, and four, in the same room.
pub const THREE_CABLES: &str = "demo3";
pub const FOUR_CABLES: &str = "demo4";
/// Position of the node at the start in these system files, m, and the other end of the moves here.
pub const START: [f64; 3] = [4.8, 3.0, 0.3];
pub const GOAL: [f64; 3] = [5.4, 3.6, 0.7];
/// Longest wait for any event; it is exceeded only by an error, because a machine may stand still for seconds.
const LONG: Duration = Duration::from_secs(60);
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

/// Two robots at once would take processor time from each other.
static ONE_ROBOT: Mutex<()> = Mutex::new(());

/// Waits until no robot of another test runs, and keeps others waiting.
pub fn alone() -> MutexGuard<'static, ()> {
    ONE_ROBOT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A robot with processes, in a separate domain and folder.
pub struct Robot {
    supervisor: Child,
    folder: tempfile::TempDir,
    file: &'static str,
    runs: usize,
    pub bus: Bus,
    authority: Subscriber<MotorAuthority>,
    truth: Subscriber<TruthNode>,
    slots_channel: Subscriber<MotorSlots>,
    clients: HashMap<String, Client>,
    pub last: MotorAuthority,
    /// Every fault that has been named so far.
    pub named: u32,
    pub seen: TruthNode,
    pub slots: MotorSlots,
    /// Target of the last move of `fly`, m.
    pub goal: [f64; 3],
    /// Whether something was broken on purpose.
    broken: bool,
    pub domain: TestDomain,
    _alone: MutexGuard<'static, ()>,
}

/// A copy of the example files, because a robot stores its files beside them.
pub fn copy_configs(folder: &Path) -> PathBuf {
    let configs = folder.join("configs");
    for place in ["robots", "systems", "missions", "sensors", "ground"] {
        std::fs::create_dir_all(configs.join(place)).unwrap();
        for entry in std::fs::read_dir(root().join("configs").join(place)).unwrap() {
            let entry = entry.unwrap();
            std::fs::copy(entry.path(), configs.join(place).join(entry.file_name())).unwrap();
        }
    }
    configs
}

impl Robot {
    /// Three cables, with more text at the end of the system file.
    pub fn up(more: &str) -> Self {
        Self::up_with(THREE_CABLES, more, |_| ())
    }

    /// With that system file, after `change` has edited its folder of configurations.
    pub fn up_with(file: &'static str, more: &str, change: impl FnOnce(&Path)) -> Self {
        let mut robot = Self::begin(file, more, change);
        robot.until("the robot is up", |robot| robot.last.header.cycle > 50);
        robot
    }

    /// Started, but perhaps not up yet.
    pub fn begin(file: &'static str, more: &str, change: impl FnOnce(&Path)) -> Self {
        let alone = alone();
        let folder = tempfile::tempdir().unwrap();
        let configs = copy_configs(folder.path());
        change(&configs);
        let domain = Domain::for_test();
        let mut supervisor = start(folder.path(), file, &domain, more, 1);
        // A start first clears the domain, so the observer opens it afterwards.
        while domain.alive().is_empty() && supervisor.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(2));
        }
        let bus = Bus::join(&domain, "observer").unwrap();
        Self {
            supervisor,
            folder,
            file,
            runs: 1,
            authority: bus.deep_subscriber("motor/authority").unwrap(),
            truth: bus.deep_subscriber("truth/node").unwrap(),
            slots_channel: bus.deep_subscriber("motor/slots").unwrap(),
            bus,
            clients: HashMap::new(),
            last: MotorAuthority::default(),
            named: 0,
            seen: TruthNode::default(),
            slots: MotorSlots::default(),
            goal: START,
            broken: false,
            domain,
            _alone: alone,
        }
    }

    /// Starts again in the same domain, however the last start ended.
    pub fn up_again(&mut self, more: &str) {
        assert!(self.supervisor.try_wait().unwrap().is_some(), "the earlier run has not ended");
        self.runs += 1;
        self.clients.clear();
        self.supervisor = start(self.folder.path(), self.file, &self.domain, more, self.runs);
        // The old ports ended with the old processes.
        while self.domain.alive().iter().all(|node| node.name == "observer") {
            assert!(self.supervisor.try_wait().unwrap().is_none(), "it ended\n{}", self.printed());
            std::thread::sleep(Duration::from_millis(2));
        }
        self.bus = Bus::join(&self.domain, "observer").unwrap();
        self.authority = self.bus.deep_subscriber("motor/authority").unwrap();
        self.truth = self.bus.deep_subscriber("truth/node").unwrap();
        self.slots_channel = self.bus.deep_subscriber("motor/slots").unwrap();
        self.last = MotorAuthority::default();
        self.until("the robot is up again", |robot| robot.last.header.cycle > 50);
    }

    /// Changes the system file for the next start.
    pub fn change_system(&self, change: impl FnOnce(String) -> String) {
        let path = self.folder().join("configs/systems").join(format!("{}.toml", self.file));
        std::fs::write(&path, change(std::fs::read_to_string(&path).unwrap())).unwrap();
    }

    /// The system file as started, with the added text.
    pub fn system_file(&self) -> PathBuf {
        system_file(self.folder.path(), self.file)
    }

    /// The folder of all its files.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The folder of the present run.
    pub fn run(&self) -> PathBuf {
        run_of(self.folder.path(), self.runs)
    }

    /// Time that the virtual motor box reported as left out in the present run, ms; rates and distances of drives refer
    /// to the rest.
    pub fn left_out_ms(&self) -> u64 {
        let said = std::fs::read_to_string(self.run().join("log/motor-box.txt")).unwrap_or_default();
        let words = said.lines().filter_map(|line| line.split_once(motor_box::LEFT_OUT));
        words.filter_map(|(before, _)| before.trim_end().rsplit(' ').next()?.parse::<u64>().ok()).sum()
    }

    /// Output of the supervisors so far.
    pub fn printed(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("said")).unwrap_or_default()
    }

    /// The operator's command.
    pub fn nims(&self, args: &[&str]) -> Output {
        // Options of the robot's own command first: behind `--` they belong to a plugged program.
        let mut command = Command::new(program());
        command.args(["--domain", self.domain.name()]).args(args).current_dir(self.folder()).output().unwrap()
    }

    /// Runs the operator's command; returns its answer.
    pub fn accepted(&self, args: &[&str]) -> String {
        let output = self.nims(args);
        assert!(output.status.success(), "{args:?}: {}\n{}", String::from_utf8_lossy(&output.stderr), self.printed());
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Checks that a command is refused in one sentence with these words, and changes nothing.
    pub fn refused(&self, args: &[&str], words: &[&str]) -> Option<i32> {
        let output = self.nims(args);
        let sentence = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{args:?} was accepted");
        assert_eq!(sentence.trim_end().lines().count(), 1, "{sentence}");
        for word in words {
            assert!(sentence.contains(word), "{args:?}: no {word:?} in {sentence}");
        }
        output.status.code()
    }

    /// Runs a command whose request is rejected in one sentence; returns the reason that the process gave.
    pub fn rejected(&self, args: &[&str]) -> Reason {
        let mut requests = self.bus.subscriber::<OperatorRequest>("operator/request").unwrap();
        let begun_ns = clock::now_ns();
        self.refused(args, &[]);
        loop {
            let answered = requests.receive().unwrap();
            let answered = answered.filter(|request| request.header.published_ns >= begun_ns && request.answered == 1);
            if let Some(reason) = answered.and_then(|request| Reason::from_request(&request)) {
                return reason;
            }
            assert!(clock::now_ns() < begun_ns + LONG.as_nanos() as u64, "{args:?}: no answer on operator/request");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Output of `nims status`; null if there is none.
    pub fn status(&self) -> Value {
        serde_json::from_slice(&self.nims(&["status", "--json"]).stdout).unwrap_or(Value::Null)
    }

    /// A row of the process table.
    pub fn row(&self, process: &str) -> Option<Value> {
        self.status()["processes"].as_array()?.iter().find(|row| row["name"] == process).cloned()
    }

    /// State in the process table.
    pub fn state(&self, process: &str) -> String {
        self.row(process).map_or("no row".to_owned(), |row| row["state"].as_str().unwrap_or_default().to_owned())
    }

    /// Its id in the process table, also of a program that is not on the bus.
    pub fn pid_in_table(&self, process: &str) -> Option<u32> {
        self.row(process)?["pid"].as_u64().map(|pid| pid as u32)
    }

    /// Ends it with a signal; returns its exit code, if it ended by itself.
    pub fn down(&mut self, signal: Signal) -> Option<i32> {
        let _ = kill_process(Pid::from_child(&self.supervisor), signal);
        self.ended()
    }

    /// Waits until the supervisor ends, as requested; returns its exit code.
    pub fn ended(&mut self) -> Option<i32> {
        let give_up = clock::now_ns() + 2 * LONG.as_nanos() as u64;
        loop {
            if let Some(status) = self.supervisor.try_wait().unwrap() {
                return status.code();
            }
            assert!(clock::now_ns() < give_up, "nims up does not end\n{}", self.printed());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    pub fn supervisor_pid(&self) -> u32 {
        self.supervisor.id()
    }

    /// Output of `nims up` at its end.
    pub fn answer(&self) -> Value {
        let text = std::fs::read_to_string(answer_of(self.folder.path(), self.runs)).unwrap();
        serde_json::from_str(&text).unwrap_or(Value::Null)
    }

    /// Receives samples until one fulfils the condition.
    pub fn until(&mut self, what: &str, wanted: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + LONG.as_nanos() as u64;
        loop {
            self.poll_others();
            while let Some(sample) = self.authority.receive().unwrap() {
                self.record(sample);
                if wanted(self) {
                    return;
                }
            }
            self.in_time(what, give_up);
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// The same for conditions that are slow to check or come from elsewhere: checked now and then, after all present
    /// samples.
    pub fn until_reported(&mut self, what: &str, wanted: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + LONG.as_nanos() as u64;
        loop {
            self.poll();
            if wanted(self) {
                return;
            }
            self.in_time(what, give_up);
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn in_time(&self, what: &str, give_up: u64) {
        let MotorAuthority { mode, faults, .. } = self.last;
        let periods = robot_state::Periods::from_authority(&self.last).summary();
        assert!(
            clock::now_ns() < give_up,
            "{what}: in vain; mode {mode}, faults {faults:#x}, {periods}\n{}",
            self.printed()
        );
    }

    /// Repeats a request until it is accepted.
    pub fn ask(&mut self, process: &str, request: Request) {
        let give_up = clock::now_ns() + LONG.as_nanos() as u64;
        loop {
            let answer = self.request(process, &request);
            if matches!(answer, Some((true, _))) {
                return;
            }
            assert!(clock::now_ns() < give_up, "still rejected: {answer:?}\n{}", self.printed());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Injects a fault into the motor box.
    pub fn fault(&mut self, text: &str) {
        self.fault_of("motor-box", text);
    }

    /// Injects a fault into that process.
    pub fn fault_of(&mut self, process: &str, text: &str) {
        self.broken = true;
        let (accepted, sentence) = self.request(process, &Request::Fault { text: text.to_owned() }).unwrap();
        assert!(accepted, "{sentence}");
    }

    /// Waits until the recorder is in that state of [`RecorderStatus`].
    pub fn until_recorder(&mut self, state: u8) {
        let mut states = self.bus.subscriber::<RecorderStatus>("recorder/status").unwrap();
        let give_up = clock::now_ns() + LONG.as_nanos() as u64;
        loop {
            self.poll();
            if states.latest().unwrap().is_some_and(|row| row.state == state) {
                return;
            }
            self.in_time(&format!("the recorder in state {state}"), give_up);
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// One request and whether it was accepted, with the answer's sentence; `None` if the process does not exist or
    /// does not answer.
    pub fn request(&mut self, process: &str, request: &Request) -> Option<(bool, String)> {
        self.answered(process, request).map(|answer| (answer.accepted == 1, text_of(&answer.answer)))
    }

    /// One request and the reason of its answer; `None` if the process does not exist or does not answer.
    pub fn reason(&mut self, process: &str, request: &Request) -> Option<Reason> {
        self.answered(process, request).and_then(|answer| Reason::from_request(&answer))
    }

    fn answered(&mut self, process: &str, request: &Request) -> Option<OperatorRequest> {
        let request = request.encode().unwrap();
        if !self.clients.contains_key(process) {
            self.clients.insert(process.to_owned(), self.bus.client(process).unwrap());
        }
        let answer = self.clients.get_mut(process)?.ask(&request, LONG).ok();
        if answer.is_none() {
            self.clients.remove(process);
        }
        answer
    }

    /// The request to fly a mission of the folder of missions, which is first copied into the run.
    pub fn mission(&self, name: &str) -> Request {
        let text = std::fs::read_to_string(self.folder().join(format!("configs/missions/{name}.toml"))).unwrap();
        let hash = config::store_mission(&self.run(), &text).unwrap();
        Request::Run { mission: name.to_owned(), hash, continues: false }
    }

    /// Receives everything published so far into `last`, `seen` and `slots`.
    pub fn poll(&mut self) {
        while let Some(sample) = self.authority.receive().unwrap() {
            self.record(sample);
        }
        self.poll_others();
    }

    fn record(&mut self, sample: MotorAuthority) {
        self.last = sample;
        self.named |= sample.faults;
    }

    fn poll_others(&mut self) {
        self.seen = self.truth.latest().unwrap().unwrap_or(self.seen);
        self.slots = self.slots_channel.latest().unwrap().unwrap_or(self.slots);
    }

    /// The process of that name, if it runs.
    pub fn pid(&self, process: &str) -> Option<u32> {
        self.domain.alive().iter().find(|node| node.name == process).map(|node| node.pid)
    }

    pub fn signal(&self, process: &str, signal: Signal) {
        kill(self.pid(process).unwrap(), signal);
    }

    /// Removes the supervisor's records in shared memory, as a power-off does.
    pub fn forget(&self) {
        for entry in std::fs::read_dir(self.domain.root()).unwrap().flatten() {
            if entry.path().extension().is_some_and(|ending| ending == "json" || ending == "txt") {
                std::fs::remove_file(entry.path()).unwrap();
            }
        }
        assert!(!self.domain.root().join("running.json").exists());
    }

    /// Kills all processes at once.
    pub fn kill_all(&mut self) {
        let _ = kill_process(Pid::from_child(&self.supervisor), Signal::KILL);
        self.kill_others();
        self.supervisor.wait().unwrap();
    }

    fn kill_others(&self) {
        for node in self.domain.alive() {
            if node.pid != std::process::id() {
                kill(node.pid, Signal::KILL);
            }
        }
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        if self.supervisor.try_wait().ok().flatten().is_none() {
            let _ = kill_process(Pid::from_child(&self.supervisor), Signal::INT);
        }
        for _ in 0..1000 {
            if self.supervisor.try_wait().ok().flatten().is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.supervisor.kill();
        let _ = self.supervisor.wait();
        self.kill_others();
        println!("{} ms did not pass in the virtual motor box", self.left_out_ms());
        if std::thread::panicking() {
            if let Some(evidence) = self.starvation() {
                steady::starved(evidence);
            }
            if std::env::var_os("NIMS_KEEP").is_some() {
                self.folder.disable_cleanup(true);
                println!("the robot's runs are kept in {}", self.folder.path().display());
            }
        }
    }
}

fn kill(pid: u32, signal: Signal) {
    if let Some(pid) = i32::try_from(pid).ok().and_then(Pid::from_raw) {
        // It may have ended in this instant.
        let _ = kill_process(pid, signal);
    }
}

/// `nims up` with more text at the end of the system file; the file itself is unchanged for the next start.
fn start(folder: &Path, file: &str, domain: &Domain, more: &str, run: usize) -> Child {
    let text = std::fs::read_to_string(folder.join(format!("configs/systems/{file}.toml"))).unwrap();
    let path = system_file(folder, file);
    std::fs::write(&path, text + more).unwrap();
    let said = std::fs::OpenOptions::new().append(true).create(true).open(folder.join("said")).unwrap();
    Command::new(program())
        .args(["up", "--domain", domain.name(), "--json", "--run"])
        .arg(run_of(folder, run))
        .arg(&path)
        // Nothing reads it unless a test does.
        .env("NOTIFY_SOCKET", folder.join("notify"))
        .env("WATCHDOG_USEC", "1000000")
        .stdout(std::fs::File::create(answer_of(folder, run)).unwrap())
        .stderr(said)
        .spawn()
        .unwrap()
}

fn system_file(folder: &Path, file: &str) -> PathBuf {
    folder.join(format!("configs/systems/{file}-up.toml"))
}

/// Samples of a channel in a run's file, without their times.
pub fn samples_of<T: messages::Message>(run: &Path, channel: &str) -> Vec<T> {
    runlog::read_channel::<T>(run, channel).unwrap().into_iter().map(|(_, sample)| sample).collect()
}

fn run_of(folder: &Path, run: usize) -> PathBuf {
    folder.join(format!("run-{run}"))
}

fn answer_of(folder: &Path, run: usize) -> PathBuf {
    folder.join(format!("answer-{run}.json"))
}

pub fn program() -> PathBuf {
    let path = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    assert!(path.is_file(), "{} is missing: run `cargo build --workspace --bins` first", path.display());
    path
}
