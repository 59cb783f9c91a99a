//! The robot in flight, with standbys: planned swaps, and SIGKILL of whoever is in charge, at random instants. What happened is read from
//! the run file.
//!
//! `NIMS_SWAPS=100 NIMS_RATE_HZ=100 cargo test --workspace --test swaps` does each a hundred times at the usual rate.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use bus::{Bus, Domain, Subscriber, TestDomain, clock};
use messages::{CONTROLLERS, ESTIMATORS, MotorAuthority, MotorSlots, SLOT_NAMES, SLOTS};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

const BOX: &str = "configs/boxes/demo3.toml";
const START: &str = "4.8,3.0,0.3";
const ROLES: [&str; 2] = ["controller", "estimator"];
/// Everything twice: a second controller with another law, a second estimator with another method; and standbys that are believed
/// sooner and started again at once, so that a second is enough for a death and what follows it.
fn standbys() -> String {
    let mut text = "[arbiter]\nqualify_s = 0.2\nprobation_s = 0.2\nquarantine_falls = 100\n".to_owned();
    let seats = [
        ("controller", "controller", ""),
        ("controller-b", "controller", "standby = true\nlaw = \"p-feedforward\"\n"),
        ("estimator", "estimator", ""),
        ("estimator-b", "estimator", "standby = true\nlaw = \"kalman\"\n"),
    ];
    for (name, role, more) in seats {
        let restart = "restart = true\nrestart_pause_s = 0.1\nrestart_forgive_s = 0.1\n";
        text += &format!("[[process]]\nname = \"{name}\"\nrole = \"{role}\"\n{restart}{more}");
    }
    text
}

/// A processor that ten processes share with the start of an eleventh may let one wait for milliseconds: at half the usual rate that
/// explains no missed cycle. `NIMS_RATE_HZ=100` on a machine with nothing else to do.
fn rate_hz() -> f64 {
    std::env::var("NIMS_RATE_HZ").map_or(50.0, |rate| rate.parse().unwrap())
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

fn program() -> PathBuf {
    let path = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    assert!(path.is_file(), "there is no {}: `cargo build --workspace --bins` first", path.display());
    path
}

fn signal(pid: u64, name: &str) {
    assert!(pid > 1, "0 would be everybody here");
    let _ = Command::new("kill").args([format!("-{name}"), pid.to_string()]).stderr(Stdio::null()).status();
}

struct Robot {
    supervisor: Child,
    folder: tempfile::TempDir,
    authority: Subscriber<MotorAuthority>,
    slots: Subscriber<MotorSlots>,
    last: MotorAuthority,
    seats: MotorSlots,
    _bus: Bus,
    domain: TestDomain,
    _alone: MutexGuard<'static, ()>,
}

/// One robot at a time: two of them would take each other's cycles away.
static ALONE: Mutex<()> = Mutex::new(());

impl Robot {
    fn up(more: &str) -> Self {
        let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().unwrap();
        let configs = folder.path().join("configs");
        for place in ["robots", "boxes", "missions"] {
            std::fs::create_dir_all(configs.join(place)).unwrap();
            for entry in std::fs::read_dir(root().join("configs").join(place)).unwrap() {
                let entry = entry.unwrap();
                std::fs::copy(entry.path(), configs.join(place).join(entry.file_name())).unwrap();
            }
        }
        // To and fro, long enough not to end in the middle of something.
        let mut mission = "name = \"to and fro\"\nspeed_m_s = 0.15\n".to_owned();
        for _ in 0..20 {
            mission += "[[leg]]\npolyline = { points_m = [[5.6, 3.4, 0.6], [4.8, 4.0, 0.9], [4.0, 3.4, 0.6], [4.8, 3.0, 0.3]] }\n";
        }
        std::fs::write(configs.join("missions/fro.toml"), mission).unwrap();
        let path = folder.path().join(BOX);
        let text = std::fs::read_to_string(&path).unwrap();
        let rate = format!("rate_hz = {:.1}", rate_hz());
        assert!(text.contains("rate_hz = 100.0"), "the rate is said otherwise in {BOX}");
        std::fs::write(&path, text.replacen("rate_hz = 100.0", &rate, 1) + more).unwrap();
        let domain = Domain::for_test();
        let supervisor = Command::new(program())
            .args(["up", "--domain", domain.name(), "--json", "--run"])
            .arg(folder.path().join("run"))
            .arg(&path)
            .stdout(Stdio::piped())
            .stderr(std::fs::File::create(folder.path().join("stderr")).unwrap())
            .spawn()
            .unwrap();
        let bus = Bus::join(&domain, "observer").unwrap();
        let authority = bus.subscriber("motor/authority").unwrap();
        let slots = bus.subscriber("motor/slots").unwrap();
        let (last, seats) = (MotorAuthority::default(), MotorSlots::default());
        let mut robot = Self { supervisor, folder, authority, slots, last, seats, _bus: bus, domain, _alone: alone };
        robot.until("the robot is up", 20.0, |robot| {
            robot.last.header.cycle > 10 && robot.status()["mission"].is_object()
        });
        robot.ask(&["arm"]);
        robot.ask(&["zero", "--at", START]);
        robot.until("an estimate", 5.0, |robot| robot.status()["position_m"].is_array());
        // A cycle without readings has no estimate, and then the planner has nowhere to begin.
        robot.until("the mission is accepted", 5.0, |robot| robot.nims(&["run", "fro"]).status.success());
        robot.until("the mission has begun", 5.0, |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
        robot
    }

    fn nims(&self, args: &[&str]) -> Output {
        Command::new(program()).args(["--domain", self.domain.name()]).args(args).output().unwrap()
    }

    fn ask(&self, args: &[&str]) -> String {
        let output = self.nims(args);
        assert!(output.status.success(), "{args:?}: {}{}", String::from_utf8_lossy(&output.stderr), self.said());
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// A standby that is late in the very cycle that was announced does not get the place, and one that is late just after it does not
    /// keep it, rightly; then once more.
    ///
    /// How often the place changed hands.
    fn swap(&mut self, role: &str) -> u64 {
        let mut changes = 1;
        for _ in 0..3 {
            let output = self.nims(&["swap", role]);
            if output.status.success() {
                return changes;
            }
            let why = String::from_utf8_lossy(&output.stderr).into_owned();
            let given_back = why.contains("missed a cycle just after it had taken over");
            assert!(given_back || why.contains("was not there in the announced cycle"), "{why}{}", self.said());
            changes += 2 * u64::from(given_back);
            self.until_doubled();
        }
        panic!("three times no swap\n{}", self.said());
    }

    fn status(&self) -> Value {
        serde_json::from_slice(&self.nims(&["status", "--json"]).stdout).unwrap_or(Value::Null)
    }

    fn said(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("stderr")).unwrap_or_default()
    }

    fn until(&mut self, what: &str, seconds: f64, done: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + (seconds * 1e9) as u64;
        loop {
            self.last = self.authority.latest().unwrap().unwrap_or(self.last);
            self.seats = self.slots.latest().unwrap().unwrap_or(self.seats);
            if done(self) {
                return;
            }
            let (MotorAuthority { mode, missed, late, .. }, MotorSlots { phase, cause, .. }) = (self.last, self.seats);
            assert!(
                clock::now_ns() < give_up,
                "{what}: not within {seconds} s; mode {mode}, phases {phase:?}, causes {cause:?}, {missed} missed, {late} late\n{}",
                self.said()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Both roles have somebody in charge and a standby.
    fn until_doubled(&mut self) {
        self.until("a standby in both roles", 30.0, |robot| {
            let has = |role: usize, phase: u8| robot.seats.phase[SLOTS * role..][..SLOTS].contains(&phase);
            let role = |role| has(role, MotorSlots::PHASE_ACTIVE) && has(role, MotorSlots::PHASE_QUALIFIED);
            role(CONTROLLERS) && role(ESTIMATORS) && robot.seats.fade == [1.0; 2]
        });
    }

    fn flies(&self) -> bool {
        self.last.mode == MotorAuthority::MODE_FOLLOWING
    }

    fn lead(&self, role: usize) -> usize {
        usize::from(self.seats.in_charge[role])
    }

    /// Of a process that lives: one that is about to be started again has none, and 0 would be everybody here.
    fn pid(&self, name: &str) -> u64 {
        let give_up = clock::now_ns() + 5_000_000_000;
        loop {
            let status = self.status();
            let rows = status["processes"].as_array().cloned().unwrap_or_default();
            let pid = rows.iter().find(|row| row["name"] == name).and_then(|row| row["pid"].as_u64());
            if let Some(pid) = pid.filter(|pid| *pid > 1) {
                return pid;
            }
            assert!(clock::now_ns() < give_up, "no {name} in {status}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn process(&self, role: usize) -> String {
        match SLOT_NAMES[self.lead(role)] {
            "a" => ROLES[role].to_owned(),
            slot => format!("{}-{slot}", ROLES[role]),
        }
    }

    fn run(&self) -> PathBuf {
        self.folder.path().join("run")
    }

    /// Ends the robot and computes its run again: every bit of every decision is as recorded. A process that was killed may have left
    /// a last sample without the one that says what it was made from.
    fn end_and_replay(&mut self, kills: u64) {
        self.end();
        let replayed = nims::replay::run(&self.run(), &nims::replay::Changes::default(), &mut |_| {}).unwrap();
        println!("{} samples computed again", replayed.equal());
        assert_eq!(replayed.different(), 0, "{:#?}", replayed.channels);
        for tally in &replayed.channels {
            let left: u64 = tally.not_compared.values().sum();
            assert!(tally.equal > 0 && left <= kills, "{tally:#?}");
        }
    }

    fn end(&mut self) {
        signal(u64::from(self.supervisor.id()), "INT");
        let give_up = clock::now_ns() + 40_000_000_000;
        while self.supervisor.try_wait().unwrap().is_none() {
            assert!(clock::now_ns() < give_up, "nims up does not end\n{}", self.said());
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        if self.supervisor.try_wait().ok().flatten().is_none() {
            signal(u64::from(self.supervisor.id()), "INT");
            for _ in 0..500 {
                if self.supervisor.try_wait().ok().flatten().is_some() {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            let _ = self.supervisor.kill();
        }
        for node in self.domain.alive() {
            if node.pid != std::process::id() {
                signal(u64::from(node.pid), "KILL");
            }
        }
    }
}

/// Cycles between a tick that was late and a command that is missing because of it: the answer to the cycle before or after it.
const FROZEN_CYCLES: u64 = 5;

#[derive(Debug, Default, PartialEq)]
struct Account {
    /// Cycles missed that nothing else explains.
    missed: u64,
    /// Cycles missed beside a late tick of motor-io: the machine stood still.
    frozen: u64,
    /// Cycles missed while the virtual drives, which nobody has disturbed, were silent, or had just taken half as long again as usual: the
    /// machine ran neither them nor the chain.
    starved: u64,
    /// How often the slot in charge changed, per role.
    changes: [u64; 2],
    stops: u64,
    steps_beyond: u64,
}

/// What the run file says of the time from `first` on.
fn account(run: &Path, first: u64, last: u64) -> Account {
    let samples: Vec<MotorAuthority> = runlog::read_channel::<MotorAuthority>(run, "motor/authority")
        .unwrap()
        .into_iter()
        .map(|(_, sample)| sample)
        .filter(|sample| (first..=last).contains(&sample.header.cycle))
        .collect();
    let states = runlog::read_channel::<messages::MotorState>(run, "motor/state").unwrap();
    assert!(samples.len() as u64 > (last - first) * 95 / 100, "the run file lacks cycles");
    let grows = |count: fn(&MotorAuthority) -> u64| -> Vec<u64> {
        samples.windows(2).filter(|two| count(&two[1]) > count(&two[0])).map(|two| two[1].header.cycle).collect()
    };
    let mut took_ns: Vec<u64> = samples.iter().map(|sample| sample.bus_ns).collect();
    took_ns.sort_unstable();
    let usual_ns = took_ns[took_ns.len() / 2];
    let (late, silent) = (grows(|sample| sample.late), grows(|sample| sample.skipped));
    let mut account = Account::default();
    for two in samples.windows(2) {
        let (before, now) = (&two[0], &two[1]);
        let missed = now.missed - before.missed;
        if late.iter().any(|late| late.abs_diff(now.header.cycle) <= FROZEN_CYCLES) {
            account.frozen += missed;
        } else if silent.contains(&now.header.cycle) || 2 * before.bus_ns > 3 * usual_ns {
            account.starved += missed;
        } else {
            account.missed += missed;
            if missed > 0 {
                let MotorAuthority { header, verdict, active_controller, active_estimator, wake_ns, skipped, .. } = now;
                println!(
                    "cycle {} missed: verdicts {verdict:?}, last used {active_controller} on {active_estimator}, woken after {wake_ns} ns, \
                     {} skipped in this cycle; the drives took {} ns before, usually {usual_ns} ns",
                    header.cycle,
                    skipped - before.skipped,
                    before.bus_ns
                );
            }
        }
        for role in 0..2 {
            account.changes[role] += u64::from(now.in_charge[role] != before.in_charge[role]);
        }
        account.stops += u64::from(now.mode != MotorAuthority::MODE_FOLLOWING);
    }
    // 4 x 0.5 m/s² x the period in the files used here.
    let limit = 2.0 / rate_hz() + 1e-9;
    for two in states.windows(2) {
        let (before, now) = (&two[0].1, &two[1].1);
        let next = now.header.cycle == before.header.cycle + 1 && (first..=last).contains(&now.header.cycle);
        let steps = now.command_m_s.iter().zip(&before.command_m_s).map(|(v, w)| (v - w).abs());
        account.steps_beyond += u64::from(next && steps.fold(0.0, f64::max) > limit);
    }
    account
}

#[test]
fn swaps_and_deaths_at_random_instants_cost_no_cycle() {
    let rounds: u64 = std::env::var("NIMS_SWAPS").map_or(20, |count| count.parse().unwrap());
    let mut robot = Robot::up(&standbys());
    robot.until_doubled();
    let first = robot.last.header.cycle;
    // Knuth's multiplier; the instants are to be irregular, not unpredictable.
    let mut random = 20u64;
    let mut pause = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        std::thread::sleep(Duration::from_millis((random >> 33) % 400));
    };
    let mut changes = [0; 2];
    for round in 0..rounds {
        robot.until_doubled();
        assert!(robot.flies(), "the robot does not fly: mode {}\n{}", robot.last.mode, robot.said());
        let role = (round % 2) as usize;
        let lead = robot.lead(role);
        pause();
        // Without a name: the standby that is there takes over, and the old one becomes the standby.
        changes[role] += robot.swap(ROLES[role]);
        robot.until("the standby is in charge", 3.0, |robot| robot.lead(role) == 1 - lead);

        // Both that are in charge die, at instants that have nothing to do with each other.
        robot.until_doubled();
        assert!(robot.flies(), "the robot does not fly: mode {}\n{}", robot.last.mode, robot.said());
        let leads = [CONTROLLERS, ESTIMATORS].map(|role| robot.lead(role));
        let pids = [CONTROLLERS, ESTIMATORS].map(|role| robot.pid(&robot.process(role)));
        let first = (round / 2 % 2) as usize;
        for role in [first, 1 - first] {
            pause();
            signal(pids[role], "KILL");
        }
        robot.until("the standbys are in charge", 3.0, |robot| {
            [0, 1].map(|role| robot.lead(role)) == leads.map(|lead| 1 - lead)
        });
        changes = changes.map(|count| count + 1);
    }
    robot.until_doubled();
    let last = robot.last.header.cycle;
    robot.end_and_replay(2 * rounds);
    let account = account(&robot.run(), first, last);
    println!("{rounds} rounds, cycles {first} to {last}: {account:?}");
    let Account { frozen, starved, .. } = account;
    assert_eq!(account, Account { changes, frozen, starved, ..Account::default() });
}

#[test]
fn another_law_is_started_and_takes_over_in_flight() {
    let mut robot = Robot::up("");
    let refused = robot.nims(&["swap", "controller", "no-such-law"]);
    let sentence = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && sentence.contains("nims: "), "{sentence}");
    for (role, law, keep) in [("controller", "p-feedforward", false), ("estimator", "kalman", true)] {
        let mut args = vec!["swap", role, law];
        if keep {
            args.push("--keep");
        }
        let sentence = robot.ask(&args);
        assert!(sentence.contains(&format!("{role}-b is in charge")), "{sentence}");
    }
    robot.until("who is in charge is known", 1.0, |robot| robot.seats.in_charge == [1, 1]);
    robot.until("the old controller is gone, the old estimator stands by", 5.0, |robot| {
        robot.seats.phase[..3] == [MotorSlots::PHASE_EMPTY, MotorSlots::PHASE_ACTIVE, MotorSlots::PHASE_QUALIFIED]
    });
    assert_eq!(robot.last.mode, MotorAuthority::MODE_FOLLOWING);
    let busy = robot.nims(&["swap", "controller", "lq-endpoint", "--slot", "b"]);
    assert_eq!(busy.status.code(), Some(2), "{}", String::from_utf8_lossy(&busy.stderr));
    robot.end_and_replay(0);
}
