//! The robot as it is run: `nims up` on the virtual motor box, missions, and the death of each process.
//!
//! `NIMS_DRIFT_S=60` lets the robot that has lost its controller hang for so long, s.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use bus::{Bus, Domain, Subscriber, TestDomain, clock};
use messages::{MotorAuthority, RecorderStatus, TruthNode};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

const BOX: &str = "configs/boxes/demo3.toml";
/// The same room with four lines.
const FOUR_LINES: &str = "configs/boxes/demo4.toml";
/// Where the box file lets the node hang at the start, m.
const START: &str = "4.8,3.0,0.3";
/// The drives' watchdog in the box file, s, and the speed of the moves below, m/s.
const WATCHDOG_S: f64 = 0.3;
const SPEED_M_S: f64 = 0.2;
/// Ten steps of the encoder: less than that in 0.3 s is holding.
const STILL_M: f64 = 0.001;
/// How far the node swings on its lines after a stop.
const SWING_M: f64 = 0.01;
const GOAL: [f64; 3] = [5.4, 3.6, 0.7];
/// Of the robot file, m/s², and the control period of the box file, s.
const ACCELERATION_M_S2: f64 = 0.5;
const PERIOD_S: f64 = 0.01;
/// A stop is commanded in so many cycles from the first one without a command.
const STOP_CYCLES: u64 = 3;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

fn program() -> PathBuf {
    let path = std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("nims");
    assert!(path.is_file(), "there is no {}: `cargo build --workspace --bins` first", path.display());
    path
}

/// A robot that runs, in a domain and a folder of its own.
struct Robot {
    supervisor: Child,
    folder: tempfile::TempDir,
    authority: Subscriber<MotorAuthority>,
    truth: Subscriber<TruthNode>,
    last: MotorAuthority,
    /// Every fault that motor-io has named so far.
    named: u32,
    seen: TruthNode,
    file: &'static str,
    _bus: Bus,
    domain: TestDomain,
}

impl Robot {
    fn up() -> Self {
        Self::up_as(BOX, "")
    }

    /// With more text at the end of the box file.
    fn up_as(file: &'static str, more: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        // The last known lengths are kept beside the runs: each test has its own.
        let configs = folder.path().join("configs");
        for place in ["robots", "boxes", "missions"] {
            std::fs::create_dir_all(configs.join(place)).unwrap();
            for entry in std::fs::read_dir(root().join("configs").join(place)).unwrap() {
                let entry = entry.unwrap();
                std::fs::copy(entry.path(), configs.join(place).join(entry.file_name())).unwrap();
            }
        }
        let path = folder.path().join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text + more).unwrap();
        let domain = Domain::for_test();
        let (supervisor, bus) = Self::start(folder.path(), file, &domain, "run");
        let authority = bus.subscriber("motor/authority").unwrap();
        let truth = bus.subscriber("truth/node").unwrap();
        let mut robot = Self {
            supervisor,
            folder,
            authority,
            truth,
            last: MotorAuthority::default(),
            named: 0,
            seen: TruthNode::default(),
            file,
            _bus: bus,
            domain,
        };
        robot.until("the robot is up", 20.0, |robot| {
            robot.last.header.cycle > 10 && robot.status()["mission"].is_object()
        });
        robot
    }

    fn start(folder: &Path, file: &str, domain: &Domain, run: &str) -> (Child, Bus) {
        let supervisor = Command::new(program())
            .args(["up", "--domain", domain.name(), "--json", "--run"])
            .arg(folder.join(run))
            .arg(folder.join(file))
            .stdout(Stdio::piped())
            .stderr(std::fs::File::create(folder.join(format!("{run}.stderr"))).unwrap())
            .spawn()
            .unwrap();
        (supervisor, Bus::join(domain, "observer").unwrap())
    }

    fn nims(&self, args: &[&str]) -> Output {
        Command::new(program()).args(["--domain", self.domain.name()]).args(args).output().unwrap()
    }

    fn ask(&self, args: &[&str]) {
        let output = self.nims(args);
        assert!(output.status.success(), "{args:?}: {}{}", String::from_utf8_lossy(&output.stderr), self.said());
    }

    fn status(&self) -> Value {
        serde_json::from_slice(&self.nims(&["status", "--json"]).stdout).unwrap_or(Value::Null)
    }

    /// What the supervisor has said so far.
    fn said(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("run.stderr")).unwrap_or_default()
    }

    /// Takes in what the channels have.
    fn look(&mut self) {
        while let Some(sample) = self.authority.receive().unwrap() {
            self.last = sample;
            self.named |= sample.faults;
        }
        while let Some(sample) = self.truth.receive().unwrap() {
            self.seen = sample;
        }
    }

    fn until(&mut self, what: &str, seconds: f64, done: impl Fn(&Self) -> bool) {
        let give_up = clock::now_ns() + (seconds * 1e9) as u64;
        loop {
            self.look();
            if done(self) {
                return;
            }
            assert!(
                clock::now_ns() < give_up,
                "{what}: not within {seconds} s; mode {}, {}\n{}",
                self.last.mode,
                self.status(),
                self.said()
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn pause(&mut self, seconds: f64) {
        std::thread::sleep(Duration::from_secs_f64(seconds));
        self.look();
    }

    /// Arms, says where it is, starts a move of about five seconds and waits until it is under way.
    fn fly(&mut self) {
        self.ask(&["arm"]);
        self.ask(&["zero", "--at", START]);
        self.until("an estimate", 5.0, |robot| robot.status()["position_m"].is_array());
        // A cycle without readings has no estimate, and then the planner has nowhere to begin.
        let speed = SPEED_M_S.to_string();
        let goto = ["goto", "5.4,3.6,0.7", "--speed", &speed];
        self.until("the move is accepted", 5.0, |robot| robot.nims(&goto).status.success());
        self.until("the move has begun", 5.0, |robot| {
            robot.last.mode == MotorAuthority::MODE_FOLLOWING && robot.speed() > 0.1
        });
    }

    fn speed(&self) -> f64 {
        self.seen.velocity_m_s.iter().map(|value| value * value).sum::<f64>().sqrt()
    }

    fn pid(&self, name: &str) -> u32 {
        let status = self.status();
        let row = status["processes"]
            .as_array()
            .unwrap()
            .iter()
            .find(|row| row["name"] == name)
            .unwrap_or_else(|| panic!("no {name} in {status}"));
        row["pid"].as_u64().unwrap() as u32
    }

    /// When it was killed, ns.
    fn kill(&mut self, name: &str) -> u64 {
        let pid = rustix::process::Pid::from_raw(self.pid(name) as i32).unwrap();
        self.look();
        let now_ns = clock::now_ns();
        rustix::process::kill_process(pid, rustix::process::Signal::KILL).unwrap();
        now_ns
    }

    /// What the run file says of the time after the controller or the estimator was killed without a standby: a commanded stop in so many
    /// cycles, a travel of what that takes, no drift, taut lines.
    fn stopped_in_time(&self, killed_ns: u64, drift_s: f64) {
        let run = self.folder.path().join("run");
        let after = |stamp_ns: u64| stamp_ns > killed_ns;
        let cycles: Vec<MotorAuthority> =
            runlog::read_channel(&run, "motor/authority").unwrap().into_iter().map(|(_, sample)| sample).collect();
        let begin = cycles.iter().position(|cycle| after(cycle.header.stamp_ns)).unwrap();
        let (before, cycles) = (cycles[begin - 1], &cycles[begin..]);
        let first = cycles.iter().position(|cycle| cycle.missed > before.missed).unwrap();
        let stop = cycles.iter().position(|cycle| cycle.mode != MotorAuthority::MODE_FOLLOWING).unwrap();
        // The cycle that was under way, and the one whose command was there already.
        assert!(first <= 2, "{first} cycles until one is missed");
        // Where the drives gave no readings there was nothing to answer to; those cycles are counted as skipped.
        let skipped = cycles[stop].skipped - cycles[first].skipped;
        let missing = cycles[stop].header.cycle - cycles[first].header.cycle + 1 - skipped;
        assert!(missing <= STOP_CYCLES, "the stop is commanded in cycle {missing} without a command");

        let truth: Vec<TruthNode> =
            runlog::read_channel(&run, "truth/node").unwrap().into_iter().map(|(_, sample)| sample).collect();
        let (earlier, later): (Vec<_>, Vec<_>) = truth.into_iter().partition(|sample| !after(sample.header.stamp_ns));
        let start = earlier.last().unwrap();
        let speed = start.velocity_m_s.iter().map(|v| v * v).sum::<f64>().sqrt();
        let still_ns = cycles[stop].header.stamp_ns + 1_500_000_000;
        // Where motor-io itself stood still, the drives went on for that long.
        let frozen_s: f64 = cycles[..stop + 50]
            .windows(2)
            .map(|two| (two[1].header.stamp_ns - two[0].header.stamp_ns) as f64 * 1e-9 - 1.5 * PERIOD_S)
            .map(|late_s| late_s.max(0.0))
            .sum();
        let bound = speed * speed / (2.0 * ACCELERATION_M_S2) + (3.0 * PERIOD_S + frozen_s) * speed + 0.01;
        let far =
            |from: &[f64; 3], to: &[f64; 3]| from.iter().zip(to).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        let travel = later
            .iter()
            .take_while(|sample| sample.header.stamp_ns < still_ns)
            .fold(0.0, |most: f64, sample| most.max(far(&start.position_m, &sample.position_m)));
        assert!(travel <= bound, "{travel} m, allowed {bound} m at {speed} m/s");

        // The node swings on its lines, so its mean place over a second is what may drift.
        let held: Vec<_> = later.iter().filter(|sample| sample.header.stamp_ns > still_ns).collect();
        let mean = |some: &[&TruthNode]| {
            [0, 1, 2].map(|i| some.iter().map(|sample| sample.position_m[i]).sum::<f64>() / some.len() as f64)
        };
        assert!(held.len() as f64 > 80.0 * drift_s, "{} samples of {drift_s} s", held.len());
        let drift = far(&mean(&held[..100]), &mean(&held[held.len() - 100..]));
        assert!(drift <= 0.02 * drift_s / 60.0, "{drift} m of drift in {drift_s} s");
        let least = later
            .iter()
            .flat_map(|sample| &sample.tension_n[..usize::from(sample.cable_count)])
            .copied()
            .fold(f64::MAX, f64::min);
        assert!(least > 1.0, "a line at {least} N");
        println!(
            "{speed:.3} m/s: one missed {first} cycles after the kill, the stop commanded in cycle {missing} without a command, {:.1} mm of \
             travel (allowed {:.1}), {:.2} mm of drift in {drift_s} s, least tension {least:.1} N",
            1e3 * travel,
            1e3 * bound,
            1e3 * drift
        );
    }

    fn taut(&self) -> bool {
        let cables = usize::from(self.seen.cable_count);
        let expected = if self.file == FOUR_LINES { 4 } else { 3 };
        cables == expected && self.seen.tension_n[..cables].iter().all(|tension| *tension > 1.0)
    }

    /// Waits until no drum turns. The node itself swings on the elastic lines by a millimetre or so for some seconds more.
    fn until_still(&mut self, seconds: f64) {
        let give_up = clock::now_ns() + (seconds * 1e9) as u64;
        loop {
            let before = self.seen.length_m;
            self.pause(0.3);
            if before.iter().zip(self.seen.length_m).all(|(a, b)| (a - b).abs() < STILL_M) {
                return;
            }
            assert!(clock::now_ns() < give_up, "the drums still turn after {seconds} s\n{}", self.said());
        }
    }

    fn distance(&self, from: [f64; 3]) -> f64 {
        self.seen.position_m.iter().zip(from).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    }

    /// Ctrl-C; what `nims up` answered.
    fn end(&mut self) -> (Option<i32>, Value) {
        signal(self.supervisor.id(), "INT");
        self.ended()
    }

    fn ended(&mut self) -> (Option<i32>, Value) {
        let give_up = clock::now_ns() + 40_000_000_000;
        loop {
            if let Some(status) = self.supervisor.try_wait().unwrap() {
                let mut text = String::new();
                std::io::Read::read_to_string(self.supervisor.stdout.as_mut().unwrap(), &mut text).unwrap();
                return (status.code(), serde_json::from_str(&text).unwrap_or(Value::Null));
            }
            assert!(clock::now_ns() < give_up, "nims up does not end\n{}", self.said());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Every run file is finished and sound.
    fn files_are_closed(&self) {
        let run = self.folder.path().join("run");
        let names: Vec<String> = std::fs::read_dir(&run)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        assert!(names.iter().any(|name| name == "run.mcap"), "{names:?}");
        assert!(!names.iter().any(|name| name.ends_with(".part")), "{names:?}");
        let report = runlog::info(&run).unwrap();
        assert!(report.files.iter().all(|file| file.finished), "{report}");
        assert!(
            report.channels.iter().any(|channel| channel.name == "motor/state" && channel.messages > 100),
            "{report}"
        );
    }

    /// The same domain comes up again and ends by itself.
    fn next_start_is_clean(&mut self) {
        let again = self.folder.path().join("again");
        let output = Command::new(program())
            .args(["up", "--domain", self.domain.name(), "--for", "0.5", "--run"])
            .arg(&again)
            .arg(self.folder.path().join(self.file))
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(again.join("run.mcap").is_file());
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        if self.supervisor.try_wait().ok().flatten().is_none() {
            signal(self.supervisor.id(), "INT");
            for _ in 0..1000 {
                if self.supervisor.try_wait().ok().flatten().is_some() {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
            let _ = self.supervisor.kill();
        }
        // A supervisor that was killed leaves its children.
        for node in self.domain.alive() {
            if node.pid != std::process::id() {
                signal(node.pid, "KILL");
            }
        }
    }
}

fn signal(pid: u32, name: &str) {
    assert!(pid > 1, "0 would be everybody here");
    let _ = Command::new("kill").args([format!("-{name}"), pid.to_string()]).stderr(Stdio::null()).status();
}

#[test]
fn a_move_is_flown_and_ctrl_c_in_the_next_leaves_a_held_robot_and_a_closed_file() {
    let mut robot = Robot::up();
    let second = robot.nims(&["up", robot.folder.path().join(BOX).to_str().unwrap()]);
    let sentence = String::from_utf8_lossy(&second.stderr).into_owned();
    assert_eq!(second.status.code(), Some(1), "{sentence}");
    assert_eq!(sentence.trim_end().lines().count(), 1, "{sentence}");
    assert!(sentence.contains(&robot.supervisor.id().to_string()), "{sentence}");

    // Nothing moves before it is armed, and it says why.
    let early = robot.nims(&["goto", "5.0,3.2,0.5"]);
    assert_eq!(early.status.code(), Some(1), "{}", String::from_utf8_lossy(&early.stderr));

    robot.fly();
    // A place where the node cannot be is bad input, whatever the robot does.
    let sky = robot.nims(&["goto", "5.0,3.2,9.5"]);
    assert_eq!(sky.status.code(), Some(2), "{}", String::from_utf8_lossy(&sky.stderr));
    robot.until("the move is done", 15.0, |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    robot.pause(0.3);
    assert!(robot.distance(GOAL) < SWING_M, "{} m from the goal", robot.distance(GOAL));

    let listed: Value = serde_json::from_slice(&robot.nims(&["channel", "list", "--json"]).stdout).unwrap();
    assert!(listed["channels"].as_array().unwrap().iter().any(|channel| channel["name"] == "motor/state"), "{listed}");
    let counted: Value =
        serde_json::from_slice(&robot.nims(&["channel", "hz", "motor/state", "--for", "1", "--json"]).stdout).unwrap();
    let hz = counted["channels"][0]["hz"].as_f64().unwrap();
    assert!(hz > 50.0 && hz < 120.0, "{counted}");
    let echoed = robot.nims(&["channel", "echo", "motor/authority", "-n", "2"]);
    let lines: Vec<Value> =
        String::from_utf8_lossy(&echoed.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 2);
    assert_eq!(lines[0]["mode"], "MODE_HOLDING", "{}", lines[0]);

    robot.ask(&["goto", START]);
    robot.until("the way back has begun", 5.0, |robot| robot.speed() > 0.1);
    let (code, answer) = robot.end();
    assert_eq!(code, Some(0), "{}", robot.said());
    assert_eq!(answer["mode"], "holding", "{answer}");
    robot.files_are_closed();
    // The last thing in the file is a robot that holds on taut lines.
    let truth = runlog::read_channel::<TruthNode>(&robot.folder.path().join("run"), "truth/node").unwrap();
    let (earlier, last) = (truth[truth.len() - 10].1, truth.last().unwrap().1);
    assert!(earlier.length_m.iter().zip(last.length_m).all(|(a, b)| (a - b).abs() < STILL_M), "{earlier:?} {last:?}");
    robot.seen = last;
    assert!(robot.taut(), "{last:?}");
    robot.next_start_is_clean();
}

#[test]
fn the_position_outlives_a_restart_but_has_to_be_confirmed() {
    let mut robot = Robot::up();
    robot.fly();
    robot.until("the move is done", 15.0, |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    robot.pause(1.0);
    assert_eq!(robot.end().0, Some(0), "{}", robot.said());
    // The virtual box hangs the node where its file says, so let that be where it was left.
    let path = robot.folder.path().join(BOX);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("start_m = [4.8, 3.0, 0.3]"));
    std::fs::write(&path, text.replace("start_m = [4.8, 3.0, 0.3]", "start_m = [5.4, 3.6, 0.7]")).unwrap();
    let (supervisor, _bus) = Robot::start(robot.folder.path(), BOX, &robot.domain, "second");
    robot.supervisor = supervisor;
    robot.last = MotorAuthority::default();
    // The old ports went with the old domain.
    robot.authority = _bus.subscriber("motor/authority").unwrap();
    robot.truth = _bus.subscriber("truth/node").unwrap();
    robot.until("the robot is up again", 20.0, |robot| {
        robot.last.header.cycle > 10 && robot.status()["mission"].is_object()
    });
    robot.ask(&["arm"]);
    assert_eq!(robot.last.position_known, messages::MotorState::POSITION_FROM_BEFORE_THE_CUT);
    let refused = robot.nims(&["goto", "5.0,3.2,0.5"]);
    let sentence = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{sentence}");
    assert!(sentence.contains("confirm-position"), "{sentence}");
    robot.ask(&["confirm-position"]);
    robot.until("a position", 5.0, |robot| robot.status()["position_m"].is_array());
    let found: Vec<f64> =
        robot.status()["position_m"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect();
    let off = found.iter().zip([5.4, 3.6, 0.7]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    assert!(off < 0.02, "{off} m beside where it was left");
    assert_eq!(robot.end().0, Some(0), "{}", robot.said());
}

/// The active controller or estimator dies without a standby: stop on the path, hold.
fn stops_on_the_path(file: &'static str, name: &str, cause: u32) {
    let mut robot = Robot::up_as(file, "");
    robot.fly();
    let before = robot.named;
    let killed_ns = robot.kill(name);
    robot.until("the robot holds", 5.0, |robot| {
        matches!(robot.last.mode, MotorAuthority::MODE_HOLDING | MotorAuthority::MODE_FAULTED)
    });
    assert_eq!(before, 0, "nothing was wrong before");
    assert_ne!(robot.named & cause, 0, "the cause is not named: faults {:#x}", robot.named);
    robot.until_still(5.0);
    assert!(robot.taut(), "{:?}", robot.seen);
    assert!(robot.distance(GOAL) > 0.3, "it stopped on the path, not at its end");
    let place = robot.seen.position_m;
    let drift_s = std::env::var("NIMS_DRIFT_S").map_or(2.0, |seconds| seconds.parse().unwrap());
    robot.pause(drift_s + 1.5);
    assert!(robot.taut() && robot.distance(place) < SWING_M, "it drifts: {place:?} {:?}", robot.seen.position_m);
    assert!(robot.said().contains(&format!("{name} was ended by signal 9")), "{}", robot.said());
    let (code, _) = robot.end();
    assert_eq!(code, Some(1), "a run in which {name} died is no success");
    robot.files_are_closed();
    robot.stopped_in_time(killed_ns, drift_s);
    robot.next_start_is_clean();
}

#[test]
fn without_its_controller_the_robot_stops_on_the_path_and_holds() {
    stops_on_the_path(BOX, "controller", MotorAuthority::FAULT_COMMAND_LOST);
}

#[test]
fn without_its_estimator_the_robot_stops_on_the_path_and_holds() {
    stops_on_the_path(BOX, "estimator", MotorAuthority::FAULT_ESTIMATE_LOST);
}

#[test]
fn four_lines_stop_on_the_path_and_hold_without_their_controller() {
    stops_on_the_path(FOUR_LINES, "controller", MotorAuthority::FAULT_COMMAND_LOST);
}

#[test]
fn a_controller_that_stands_still_is_as_good_as_dead_until_it_goes_on() {
    let mut robot = Robot::up();
    robot.fly();
    let pid = robot.pid("controller");
    signal(pid, "STOP");
    robot.until("the robot holds", 5.0, |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    assert_ne!(robot.named & MotorAuthority::FAULT_COMMAND_LOST, 0, "faults {:#x}", robot.named);
    robot.until_still(5.0);
    assert!(robot.taut() && robot.distance(GOAL) > 0.3, "{:?}", robot.seen);
    robot.until("its silence is said", 5.0, |robot| robot.said().contains("controller has shown no sign of life"));
    signal(pid, "CONT");
    robot.until("its return is said", 5.0, |robot| robot.said().contains("controller is back"));
    let (code, _) = robot.end();
    assert_eq!(code, Some(0), "nothing died: {}", robot.said());
    robot.files_are_closed();
}

#[test]
fn an_emergency_stop_waits_aloud_for_a_motor_io_that_stands_still() {
    let mut robot = Robot::up();
    robot.fly();
    let pid = robot.pid("motor-io");
    signal(pid, "STOP");
    let said = robot.folder.path().join("estop.stderr");
    let mut estop = Command::new(program())
        .args(["--domain", robot.domain.name(), "estop"])
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(&said).unwrap())
        .spawn()
        .unwrap();
    robot.until("it speaks up", 5.0, |_| {
        std::fs::read_to_string(&said).unwrap_or_default().contains("use the hardware stop; still trying")
    });
    assert!(estop.try_wait().unwrap().is_none(), "it goes on trying");
    signal(pid, "CONT");
    robot.until("the emergency stop", 5.0, |robot| robot.last.mode == MotorAuthority::MODE_EMERGENCY_STOP);
    assert!(estop.wait().unwrap().success(), "{}", std::fs::read_to_string(&said).unwrap());
    robot.until_still(5.0);
    assert!(robot.taut(), "{:?}", robot.seen);
    robot.end();
}

#[test]
fn a_recorder_whose_file_cannot_grow_says_so_and_begins_another_while_the_robot_flies_on() {
    // A limit on the size of files stands in for a disk that is full; the shell ignores its signal for the recorder.
    let recorder = program().with_file_name("recorder");
    let more = format!(
        "\n[[process]]\nname = \"recorder\"\nrole = \"recorder\"\ncommand = ['/bin/sh', '-c', 'trap \"\" XFSZ; exec \"$0\" \"$@\"', '{}']\n",
        recorder.display()
    );
    let mut robot = Robot::up_as(BOX, &more);
    let mut states = robot._bus.subscriber::<RecorderStatus>("recorder/status").unwrap();
    robot.fly();
    let pid = robot.pid("recorder").to_string();
    let limit = |bytes: &str| {
        let set = Command::new("prlimit").args(["--pid", &pid, &format!("--fsize={bytes}:")]).status();
        assert!(set.unwrap().success(), "prlimit of util-linux is needed");
    };
    limit("1000");
    for wanted in [RecorderStatus::STATE_FAILED, RecorderStatus::STATE_RECORDING] {
        let give_up = clock::now_ns() + 10_000_000_000;
        while states.latest().unwrap().is_none_or(|row| row.state != wanted) {
            assert!(clock::now_ns() < give_up, "not in state {wanted}: {}", robot.status());
            robot.pause(0.02);
        }
        limit("unlimited");
    }
    robot.until("the move is done", 15.0, |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    assert_eq!(robot.named, 0, "the robot has not noticed: faults {:#x}", robot.named);
    assert!(robot.distance(GOAL) < SWING_M, "{} m from the goal", robot.distance(GOAL));
    let log = std::fs::read_to_string(robot.folder.path().join("run/log/recorder.txt")).unwrap();
    assert!(log.contains("trying another file in 5 s"), "{log}");
    assert_eq!(robot.end().0, Some(0), "{}", robot.said());
    assert!(robot.folder.path().join("run/run-0002.mcap").is_file());
    robot.files_are_closed();
}

#[test]
fn without_its_planner_the_robot_finishes_the_segment_and_holds() {
    let mut robot = Robot::up();
    robot.fly();
    robot.kill("planner");
    robot.until("the robot holds", 15.0, |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    robot.until_still(5.0);
    assert!(robot.distance(GOAL) < SWING_M && robot.taut(), "{} m from the end of the segment", robot.distance(GOAL));
    robot.end();
    robot.files_are_closed();
    robot.next_start_is_clean();
}

#[test]
fn without_its_recorder_the_mission_goes_on_and_a_new_file_begins() {
    let mut robot = Robot::up();
    robot.fly();
    robot.kill("recorder");
    robot.until("the loss is said", 5.0, |robot| robot.said().contains("recorder was ended by signal 9"));
    // A machine that lets the chain wait for three cycles stops the robot too; that is not the recorder's doing.
    let machine =
        MotorAuthority::FAULT_COMMAND_LOST | MotorAuthority::FAULT_ESTIMATE_LOST | MotorAuthority::FAULT_LONG_GAP;
    for _ in 0..3 {
        robot.until("the move is done", 15.0, |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
        if robot.last.faults & machine == 0 {
            break;
        }
        robot.ask(&["resume"]);
        robot.until("it goes on", 5.0, |robot| robot.last.mode == MotorAuthority::MODE_FOLLOWING);
    }
    assert!(robot.distance(GOAL) < SWING_M, "{} m from the goal", robot.distance(GOAL));
    robot.until("it records again", 5.0, |robot| robot.folder.path().join("run/run-0002.mcap.part").exists());
    robot.end();
    robot.files_are_closed();
    assert!(robot.folder.path().join("run/run-0002.mcap").is_file());
    robot.next_start_is_clean();
}

#[test]
fn without_motor_io_the_drives_stop_the_motors() {
    let mut robot = Robot::up();
    robot.fly();
    let pid = robot.pid("motor-io");
    robot.until("it is fast", 5.0, |robot| robot.speed() > 0.15);
    signal(pid, "KILL");
    robot.look();
    let place = robot.seen.position_m;
    robot.pause(WATCHDOG_S + 1.5);
    let travel = robot.distance(place);
    println!("travel after the kill: {:.1} mm", 1e3 * travel);
    // The gears of this robot hold an unpowered line, so nothing sinks afterwards. 50 ms pass between the kill and the look.
    assert!(travel < (WATCHDOG_S + 0.05) * SPEED_M_S + 0.01, "{travel} m");
    robot.until_still(5.0);
    assert!(robot.taut(), "{:?}", robot.seen);
    robot.until("the loss is said", 5.0, |robot| robot.said().contains("motor-io was ended by signal 9"));
    let (code, _) = robot.end();
    assert_eq!(code, Some(1));
    robot.files_are_closed();
    robot.next_start_is_clean();
}

#[test]
fn without_its_supervisor_the_robot_stops_and_the_next_one_cleans_up() {
    let mut robot = Robot::up();
    robot.fly();
    let children: Vec<u32> = ["motor-io", "controller", "recorder"].iter().map(|name| robot.pid(name)).collect();
    signal(robot.supervisor.id(), "KILL");
    robot.supervisor.wait().unwrap();
    robot.until("the robot holds", 6.0, |robot| robot.last.mode != MotorAuthority::MODE_FOLLOWING);
    robot.until_still(5.0);
    assert!(robot.taut());
    robot.next_start_is_clean();
    for pid in children {
        let state = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        assert!(state.is_empty() || state.contains(") Z"), "process {pid} is still there: {state}");
    }
    // The orphaned recorder was asked to end in good order.
    robot.files_are_closed();
}
