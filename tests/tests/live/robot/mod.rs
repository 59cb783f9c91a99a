//! A running robot for tests that count its cycles: `nims up` on a virtual motor box.
#![allow(dead_code, unused_imports)] // each test uses a part of it

mod steady;

pub use steady::steadily;

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
/// Faults of a robot whose machine delays the control chain for some cycles.
const STARVED: u32 = MotorAuthority::FAULT_COMMAND_LOST
    | MotorAuthority::FAULT_ESTIMATE_LOST
    | MotorAuthority::FAULT_LONG_GAP
    | MotorAuthority::FAULT_COMPUTER;

/// Cycles with a long wait, and lost periods, within so many consecutive cycles that show a starved robot.
const STARVED_CYCLES: u64 = 3;
const CLOSE_CYCLES: usize = 10;
/// A thread that waited longer than this for a processor had no time for its part of the cycle, ns: motor-io's share of
/// the period.
const LONG_WAIT_NS: u64 = 3_000_000;

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

/// Two robots at once would take processor time from each other.
static ONE_ROBOT: Mutex<()> = Mutex::new(());

/// A robot with processes, in a separate domain and folder.
pub struct Robot {
    supervisor: Child,
    folder: tempfile::TempDir,
    file: &'static str,
    runs: usize,
    pub bus: Bus,
    authority: Subscriber<MotorAuthority>,
    truth: Subscriber<TruthNode>,
    slots: Subscriber<MotorSlots>,
    clients: HashMap<String, Client>,
    pub last: MotorAuthority,
    /// Every fault that has been named so far.
    pub named: u32,
    pub seen: TruthNode,
    pub seats: MotorSlots,
    /// Target of the last move of `fly`, m.
    pub goal: [f64; 3],
    /// Whether something was broken on purpose.
    broken: bool,
    pub domain: TestDomain,
    _alone: MutexGuard<'static, ()>,
}

/// A straight move at that speed, m/s.
pub fn goto(to_m: [f64; 3], speed_m_s: f64) -> Request {
    Request::Goto { to_m, path: GotoPath::Line, speed_m_s: Some(speed_m_s) }
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
        let alone = ONE_ROBOT.lock().unwrap_or_else(PoisonError::into_inner);
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
            slots: bus.deep_subscriber("motor/slots").unwrap(),
            bus,
            clients: HashMap::new(),
            last: MotorAuthority::default(),
            named: 0,
            seen: TruthNode::default(),
            seats: MotorSlots::default(),
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
            assert!(self.supervisor.try_wait().unwrap().is_none(), "it ended\n{}", self.said());
            std::thread::sleep(Duration::from_millis(2));
        }
        self.bus = Bus::join(&self.domain, "observer").unwrap();
        self.authority = self.bus.deep_subscriber("motor/authority").unwrap();
        self.truth = self.bus.deep_subscriber("truth/node").unwrap();
        self.slots = self.bus.deep_subscriber("motor/slots").unwrap();
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
        let words = said.lines().filter_map(|line| line.split_once(" ms did not pass in the motor box"));
        words.filter_map(|(before, _)| before.rsplit(' ').next()?.parse::<u64>().ok()).sum()
    }

    /// Output of the supervisors so far.
    pub fn said(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("said")).unwrap_or_default()
    }

    /// The operator's command.
    pub fn nims(&self, args: &[&str]) -> Output {
        // Options of the robot's own command first: behind `--` they belong to a plugged program.
        let mut command = Command::new(program());
        command.args(["--domain", self.domain.name()]).args(args).current_dir(self.folder()).output().unwrap()
    }

    /// Runs the operator's command; returns its answer.
    pub fn told(&self, args: &[&str]) -> String {
        let output = self.nims(args);
        assert!(output.status.success(), "{args:?}: {}\n{}", String::from_utf8_lossy(&output.stderr), self.said());
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
            if let Some(reason) = answered.and_then(|request| Reason::of(&request)) {
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
            assert!(clock::now_ns() < give_up, "nims up does not end\n{}", self.said());
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
            self.look_around();
            while let Some(sample) = self.authority.receive().unwrap() {
                self.note(sample);
                if wanted(self) {
                    return;
                }
            }
            self.not_in_vain(what, give_up);
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// The same for conditions that are slow to check or come from elsewhere: checked now and then, after all present
    /// samples.
    pub fn until_said(&mut self, what: &str, wanted: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + LONG.as_nanos() as u64;
        loop {
            self.look();
            if wanted(self) {
                return;
            }
            self.not_in_vain(what, give_up);
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn not_in_vain(&self, what: &str, give_up: u64) {
        let MotorAuthority { mode, faults, .. } = self.last;
        let periods = robot_state::Periods::from_authority(&self.last).summary();
        assert!(
            clock::now_ns() < give_up,
            "{what}: in vain; mode {mode}, faults {faults:#x}, {periods}\n{}",
            self.said()
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
            assert!(clock::now_ns() < give_up, "still rejected: {answer:?}\n{}", self.said());
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
            self.look();
            if states.latest().unwrap().is_some_and(|row| row.state == state) {
                return;
            }
            self.not_in_vain(&format!("the recorder in state {state}"), give_up);
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
        self.answered(process, request).and_then(|answer| Reason::of(&answer))
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

    /// Starts a move of some seconds, there or back. If the machine stood still meanwhile and the robot stopped for it,
    /// the move starts again.
    pub fn fly(&mut self) {
        self.fly_at(0.12);
    }

    /// The same at that speed, m/s.
    pub fn fly_at(&mut self, speed_m_s: f64) {
        for _ in 0..5 {
            // Discards the rest of a move; without one the request is refused, which has the same effect.
            self.request("motor-io", &Request::Stop).unwrap();
            self.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
            // Wherever an earlier move was interrupted, the farther end is a move away.
            self.goal = if self.distance_m(START) < self.distance_m(GOAL) { GOAL } else { START };
            self.ask("planner", goto(self.goal, speed_m_s));
            self.until("the motion", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
            let cycle = self.last.header.cycle + 100;
            self.until("a second of it", |robot| robot.last.header.cycle > cycle);
            if (self.last.mode, self.last.faults) == (MotorAuthority::MODE_FOLLOWING, 0) {
                self.named = 0;
                return;
            }
        }
        panic!("this machine does not let the robot fly for a second: {:#x}", self.last.faults);
    }

    /// Waits for the end of the move. If the machine starved the robot and it stopped for that, requests a resume.
    pub fn arrive(&mut self) {
        for _ in 0..5 {
            self.until("the end of the move", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
            if self.last.faults & STARVED == 0 {
                return;
            }
            self.ask("motor-io", Request::Resume);
            self.until("it goes on", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
        }
        panic!("this machine does not let the robot end its move: {:#x}", self.last.faults);
    }

    /// Armed, at a known position.
    pub fn arm(&mut self) {
        self.ask("motor-io", Request::Arm);
        self.ask("motor-io", Request::ZeroAt { position_m: START });
    }

    /// Receives everything published so far into `last`, `seen` and `seats`.
    pub fn look(&mut self) {
        while let Some(sample) = self.authority.receive().unwrap() {
            self.note(sample);
        }
        self.look_around();
    }

    fn note(&mut self, sample: MotorAuthority) {
        self.last = sample;
        self.named |= sample.faults;
    }

    fn look_around(&mut self) {
        self.seen = self.truth.latest().unwrap().unwrap_or(self.seen);
        self.seats = self.slots.latest().unwrap().unwrap_or(self.seats);
    }

    /// Runs for so many cycles.
    pub fn for_cycles(&mut self, cycles: u64) {
        self.look();
        let last = self.last.header.cycle + cycles;
        self.until("some cycles", |robot| robot.last.header.cycle >= last);
    }

    /// Speed of the node, m/s, by the truth.
    pub fn speed_m_s(&self) -> f64 {
        self.seen.velocity_m_s.iter().map(|value| value * value).sum::<f64>().sqrt()
    }

    /// Distance of the node from that point, m, by the truth.
    pub fn distance_m(&self, from: [f64; 3]) -> f64 {
        self.seen.position_m.iter().zip(from).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    }

    /// Returns the robot to holding at a known position.
    pub fn reset(&mut self) {
        self.ask("motor-io", Request::Reset);
        self.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING && robot.last.faults == 0);
        if self.last.position_known == messages::MotorState::POSITION_RESTORED {
            self.ask("motor-io", Request::ConfirmPosition);
        }
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

    /// The kernel's figures in the run files of a robot without injected faults, if they explain lost periods: cycles
    /// close together in which the kernel kept threads of the robot waiting for a processor, and in which as many
    /// periods were lost.
    fn starvation(&self) -> Option<String> {
        if self.broken {
            return None;
        }
        (1..=self.runs).find_map(|run| {
            let folder = run_of(self.folder.path(), run);
            let inputs: Vec<(u64, MotorInput)> = runlog::read_channel(&folder, "motor/input").unwrap_or_default();
            let samples: Vec<(u64, MotorAuthority)> =
                runlog::read_channel(&folder, "motor/authority").unwrap_or_default();
            let waited = inputs.windows(2).map(|pair| waited_ns(&pair[0].1, &pair[1].1));
            let waits: HashMap<u64, u64> =
                inputs.iter().skip(1).map(|(_, input)| input.header.cycle).zip(waited).collect();
            samples.windows(CLOSE_CYCLES).find_map(|window| {
                let lost = |sample: &MotorAuthority| sample.lost_computer + sample.lost_on_ports();
                let lost = lost(&window[CLOSE_CYCLES - 1].1).saturating_sub(lost(&window[0].1));
                let waits = window.iter().filter_map(|(_, sample)| waits.get(&sample.header.cycle));
                let waited_ns: u64 = waits.filter(|wait| **wait > LONG_WAIT_NS).sum();
                (lost >= STARVED_CYCLES && waited_ns >= STARVED_CYCLES * LONG_WAIT_NS).then(|| {
                    let (cycle, waited_ms) = (window[0].1.header.cycle, waited_ns / 1_000_000);
                    format!(
                        "its threads waited {waited_ms} ms for a processor within {CLOSE_CYCLES} cycles from {cycle} on"
                    )
                })
            })
        })
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

/// The longest time that one of the threads of the robot or of the virtual motor box waited for a processor from one
/// cycle to the next, ns.
fn waited_ns(before: &MotorInput, after: &MotorInput) -> u64 {
    let own = [(before.run_delay_ns, after.run_delay_ns), (before.box_left_out_ns, after.box_left_out_ns)];
    let chain = before.chain_delay_ns.into_iter().zip(after.chain_delay_ns);
    // A previous figure of 0 means unknown.
    let grown = own.into_iter().chain(chain).filter(|(before, _)| *before != 0);
    grown.map(|(before, after)| after.saturating_sub(before)).max().unwrap_or(0)
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
