//! A robot as it is run, for tests that count its cycles: `nims up` on the virtual motor box of demo3.
#![allow(dead_code)] // each test uses a part of it

use bus::{Bus, Client, Domain, Subscriber, TestDomain, clock};
use messages::{MotorAuthority, OperatorRequest, TruthNode, put_text, text_of};
use rustix::process::{Pid, Signal, kill_process};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Longest wait for anything: the machine may stand still for a quarter of a second now and then.
const LONG: Duration = Duration::from_secs(20);

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

/// Two robots at once would take each other's time.
static ONE_ROBOT: Mutex<()> = Mutex::new(());

/// A robot with processes, in a domain and a folder of its own.
pub struct Robot {
    supervisor: Child,
    folder: tempfile::TempDir,
    runs: usize,
    pub bus: Bus,
    authority: Subscriber<MotorAuthority>,
    pub truth: Subscriber<TruthNode>,
    clients: HashMap<String, Client>,
    pub last: MotorAuthority,
    pub there: bool,
    pub domain: TestDomain,
    _alone: MutexGuard<'static, ()>,
}

impl Robot {
    pub fn up(more: &str) -> Self {
        Self::up_with(more, |_| ())
    }

    /// With more text at the end of its box file, and whatever `change` does to its folder of configurations.
    pub fn up_with(more: &str, change: impl FnOnce(&Path)) -> Self {
        let alone = ONE_ROBOT.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().unwrap();
        let configs = folder.path().join("configs");
        for place in ["robots", "boxes", "missions", "sensors", "scenes"] {
            std::fs::create_dir_all(configs.join(place)).unwrap();
            for entry in std::fs::read_dir(root().join("configs").join(place)).unwrap() {
                let entry = entry.unwrap();
                std::fs::copy(entry.path(), configs.join(place).join(entry.file_name())).unwrap();
            }
        }
        change(&configs);
        let domain = Domain::for_test();
        let supervisor = start(&folder, &domain, more, 1);
        let bus = Bus::join(&domain, "observer").unwrap();
        let (authority, truth) = (bus.subscriber("motor/authority").unwrap(), bus.subscriber("truth/node").unwrap());
        let mut robot = Self {
            supervisor,
            folder,
            runs: 1,
            bus,
            authority,
            truth,
            clients: HashMap::new(),
            last: MotorAuthority::default(),
            there: false,
            domain,
            _alone: alone,
        };
        robot.until("the robot is up", |robot| robot.last.header.cycle > 50);
        robot
    }

    /// The next start in the same domain, after the last one has ended in whatever way.
    pub fn up_again(&mut self, more: &str) {
        assert!(self.supervisor.try_wait().unwrap().is_some(), "the last one still runs");
        self.runs += 1;
        self.clients.clear();
        self.supervisor = start(&self.folder, &self.domain, more, self.runs);
        // The old ports went with the old processes.
        self.bus = Bus::join(&self.domain, "observer").unwrap();
        self.authority = self.bus.subscriber("motor/authority").unwrap();
        self.truth = self.bus.subscriber("truth/node").unwrap();
        self.last = MotorAuthority::default();
        self.until("the robot is up again", |robot| robot.last.header.cycle > 50);
    }

    /// Where everything of it lies.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The folder of the present run.
    pub fn run(&self) -> PathBuf {
        run_of(&self.folder, self.runs)
    }

    /// What the supervisors have said so far.
    pub fn said(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("said")).unwrap_or_default()
    }

    /// The operator's command.
    pub fn nims(&self, args: &[&str]) -> Output {
        let mut command = Command::new(program());
        command.args(["--domain", self.domain.name()]).args(args).current_dir(self.folder()).output().unwrap()
    }

    /// The operator's command; what it answered.
    pub fn told(&self, args: &[&str]) -> String {
        let output = self.nims(args);
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Ends it with a signal; its exit code, if it had the time to give one.
    pub fn down(&mut self, signal: Signal) -> Option<i32> {
        let _ = kill_process(Pid::from_child(&self.supervisor), signal);
        let give_up = clock::now_ns() + 2 * LONG.as_nanos() as u64;
        loop {
            if let Some(status) = self.supervisor.try_wait().unwrap() {
                return status.code();
            }
            assert!(clock::now_ns() < give_up, "nims up does not end\n{}", self.said());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Takes in every sample until one is as wanted.
    pub fn until(&mut self, what: &str, wanted: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + LONG.as_nanos() as u64;
        loop {
            while let Some(sample) = self.authority.receive().unwrap() {
                self.last = sample;
                if wanted(self) {
                    return;
                }
            }
            assert!(
                clock::now_ns() < give_up,
                "{what}: in vain; mode {}, {:#x}\n{}",
                self.last.mode,
                self.last.faults,
                self.said()
            );
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Asks until it is accepted.
    pub fn ask(&mut self, process: &str, verb: u8, args: &[f64]) {
        let give_up = clock::now_ns() + LONG.as_nanos() as u64;
        loop {
            let answer = self.request(process, verb, args, "");
            if matches!(answer, Some((true, _))) {
                return;
            }
            assert!(clock::now_ns() < give_up, "refused for ever: {answer:?}\n{}", self.said());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Breaks something in the motor box.
    pub fn fault(&mut self, text: &str) {
        self.fault_of("motor-box", text);
    }

    /// Breaks something in that process.
    pub fn fault_of(&mut self, process: &str, text: &str) {
        let (accepted, sentence) = self.request(process, OperatorRequest::VERB_FAULT, &[], text).unwrap();
        assert!(accepted, "{sentence}");
    }

    /// One request and its answer; none where the process is not there or does not answer.
    pub fn request(&mut self, process: &str, verb: u8, args: &[f64], text: &str) -> Option<(bool, String)> {
        let mut request = OperatorRequest { verb, ..OperatorRequest::default() };
        request.args[..args.len()].copy_from_slice(args);
        put_text(&mut request.text, text);
        if !self.clients.contains_key(process) {
            self.clients.insert(process.to_owned(), self.bus.client(process).unwrap());
        }
        let answer = self.clients.get_mut(process)?.ask(&request, LONG).ok();
        if answer.is_none() {
            self.clients.remove(process);
        }
        answer.map(|answer| (answer.accepted == 1, text_of(&answer.answer)))
    }

    /// A move of some seconds, there or back, and it is under way. Where the machine stood still meanwhile and the robot stopped for it, the
    /// move is begun anew.
    pub fn fly(&mut self) {
        for _ in 0..5 {
            // Gives up what is left of a move; without one it is refused, which is as good.
            self.request("motor-io", OperatorRequest::VERB_STOP, &[], "").unwrap();
            self.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
            let to = if self.there { [4.8, 3.0, 0.3] } else { [5.4, 3.6, 0.7] };
            self.there = !self.there;
            self.ask("planner", OperatorRequest::VERB_GOTO, &[to[0], to[1], to[2], 0.12]);
            self.until("the motion", |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
            let cycle = self.last.header.cycle + 100;
            self.until("a second of it", |robot| robot.last.header.cycle > cycle);
            if (self.last.mode, self.last.faults) == (MotorAuthority::MODE_FOLLOWING, 0) {
                return;
            }
        }
        panic!("this machine does not let the robot fly for a second: {:#x}", self.last.faults);
    }

    /// Everything that has been published so far is in `last`.
    pub fn look(&mut self) {
        while let Some(sample) = self.authority.receive().unwrap() {
            self.last = sample;
        }
    }

    /// Puts the robot back to holding at a known position.
    pub fn reset(&mut self) {
        self.ask("motor-io", OperatorRequest::VERB_RESET, &[]);
        self.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING && robot.last.faults == 0);
        if self.last.position_known == messages::MotorState::POSITION_FROM_BEFORE_THE_CUT {
            self.ask("motor-io", OperatorRequest::VERB_CONFIRM_POSITION, &[]);
        }
    }

    /// The process of that name, if it lives.
    pub fn pid(&self, process: &str) -> Option<u32> {
        self.domain.alive().iter().find(|node| node.name == process).map(|node| node.pid)
    }

    pub fn signal(&self, process: &str, signal: Signal) {
        kill(self.pid(process).unwrap(), signal);
    }

    /// Sudden end of everything.
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
    }
}

fn kill(pid: u32, signal: Signal) {
    if let Some(pid) = i32::try_from(pid).ok().and_then(Pid::from_raw) {
        // It may have ended in this instant.
        let _ = kill_process(pid, signal);
    }
}

/// `nims up` with more text at the end of the box file.
fn start(folder: &tempfile::TempDir, domain: &Domain, more: &str, run: usize) -> Child {
    let text = std::fs::read_to_string(root().join("configs/boxes/demo3.toml")).unwrap();
    let path = folder.path().join("configs/boxes/demo3.toml");
    std::fs::write(&path, text + more).unwrap();
    let said = std::fs::OpenOptions::new().append(true).create(true).open(folder.path().join("said")).unwrap();
    Command::new(program())
        .args(["up", "--domain", domain.name(), "--json", "--run"])
        .arg(run_of(folder, run))
        .arg(&path)
        .stdout(Stdio::null())
        .stderr(said)
        .spawn()
        .unwrap()
}

fn run_of(folder: &tempfile::TempDir, run: usize) -> PathBuf {
    folder.path().join(format!("run-{run}"))
}

pub fn program() -> PathBuf {
    let path = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    assert!(path.is_file(), "there is no {}: `cargo build --workspace --bins` first", path.display());
    path
}
