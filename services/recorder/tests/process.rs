//! The recorder as a process, in a domain of its own: from the first sample to a kill.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bus::clock::{Pacer, now_ns};
use bus::{Bus, Domain};
use messages::{Heartbeat, LogEvent, Message, MotorState, Reading, RecorderStatus, TruthNode, put_text, text_of};
use runlog::{RunReader, info, read_channel, recover};
use tempfile::TempDir;

/// Ends the process whatever happens to the test.
struct Recording(Child);

impl Drop for Recording {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Recording {
    fn start(domain: &Domain, run: &Path, bus: &Bus) -> Self {
        Self::start_as("recorder", domain, run, bus)
    }

    fn start_as(name: &str, domain: &Domain, run: &Path, bus: &Bus) -> Self {
        let mut beats = bus.subscriber::<Heartbeat>(&format!("system/heartbeat/{name}")).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_recorder"))
            .args(["--domain", domain.name(), "--name", name, "--run"])
            .arg(run)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let this = Self(child);
        until("the recorder is ready", || {
            std::iter::from_fn(|| beats.receive().unwrap()).any(|beat| beat.state == Heartbeat::STATE_READY)
        });
        this
    }

    fn signal(&mut self, signal: rustix::process::Signal) -> Option<i32> {
        let pid = rustix::process::Pid::from_child(&self.0);
        rustix::process::kill_process(pid, signal).unwrap();
        self.0.wait().unwrap().code()
    }
}

impl Recording {
    /// Private memory, kB.
    fn private_kb(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.0.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).unwrap();
        line.trim().trim_end_matches(" kB").parse().unwrap()
    }

    /// Processor time, in hundredths of a second.
    fn ticks(&self) -> u64 {
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.0.id())).unwrap();
        let fields: Vec<&str> = stat.rsplit(") ").next().unwrap().split(' ').collect();
        fields[11].parse::<u64>().unwrap() + fields[12].parse::<u64>().unwrap()
    }
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !done() {
        assert!(begin.elapsed() < Duration::from_secs(20), "{what}: not within 20 s");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn state(seq: u64) -> MotorState {
    let mut state = MotorState::default();
    state.header.cycle = seq;
    state.header.stamp_ns = now_ns();
    state.length_m = [seq as f64 * 0.001; 8];
    state
}

fn numbers<T: Message>(run: &Path, channel: &str) -> Vec<u64> {
    read_channel::<T>(run, channel).unwrap().iter().map(|(_, sample)| sample.header().seq).collect()
}

#[test]
fn every_sample_from_the_first_on_is_in_the_file() {
    let (domain, run) = (Domain::for_test(), TempDir::new().unwrap());
    fs::write(run.path().join("box.toml"), "name = \"test\"\n").unwrap();
    let bus = Bus::join(&domain, "test").unwrap();
    // published before anybody listened: as much of it as the channel keeps
    let mut early = bus.publisher::<LogEvent>("system/log/early").unwrap();
    for _ in 0..3 {
        early.send(&mut LogEvent::default()).unwrap();
    }
    let mut recording = Recording::start(&domain, run.path(), &bus);
    early.update_connections();
    // a channel of the table, and one that only its maker knows: both from their first sample on
    let mut states = bus.publisher::<MotorState>("motor/state").unwrap();
    states.send(&mut state(1)).unwrap();
    let mut wind = bus.publisher::<Reading>("sensor/wind").unwrap();
    let mut reading = Reading { value: [3.5; 8], count: 1, ..Reading::default() };
    put_text(&mut reading.quantity, "wind");
    reading.header.stamp_ns = now_ns();
    wind.send(&mut reading).unwrap();
    let mut pacer = Pacer::new(2_000_000);
    for seq in 2..=500 {
        pacer.next();
        states.send(&mut state(seq)).unwrap();
        if seq % 5 == 0 {
            reading.header.stamp_ns = now_ns();
            wind.send(&mut reading).unwrap();
        }
    }
    let mut rows = bus.subscriber::<RecorderStatus>("recorder/status").unwrap();
    let mut counted = 0;
    until("the recorder reports 500 states", || {
        while let Some(row) = rows.receive().unwrap() {
            assert_eq!((row.lost, row.state), (0, RecorderStatus::STATE_RECORDING));
            if text_of(&row.channel) == "motor/state" {
                counted = row.messages;
            }
        }
        counted == 500
    });
    assert!(recording.private_kb() < 25_000, "{} kB of private memory", recording.private_kb());
    assert_eq!(recording.signal(rustix::process::Signal::TERM), Some(0));
    assert!(run.path().join("run.mcap").exists() && !run.path().join("run.mcap.part").exists());

    assert_eq!(numbers::<MotorState>(run.path(), "motor/state"), (1..=500).collect::<Vec<_>>());
    assert_eq!(numbers::<Reading>(run.path(), "sensor/wind"), (1..=101).collect::<Vec<_>>());
    assert_eq!(numbers::<LogEvent>(run.path(), "system/log/early"), [1, 2, 3]);
    let report = info(run.path()).unwrap();
    assert!(report.healthy, "{:?}", report.verdict);
    assert_eq!(report.attachments, ["box.toml"]);
    assert_eq!(report.about["domain"], domain.name());
    for channel in ["recorder/status", "system/heartbeat/recorder"] {
        assert!(report.channels.iter().any(|found| found.name == channel), "{channel}");
    }
    // one clock: what is in the file is in the order of its publication, give or take one look at the channels
    let mut reader = RunReader::open(run.path()).unwrap();
    let mut last = 0;
    while let Some(recorded) = reader.next_sample().unwrap() {
        assert!(recorded.log_time_ns + 1_000_000_000 > last);
        last = last.max(recorded.log_time_ns);
    }
}

#[test]
fn a_kill_loses_at_most_the_last_second_and_the_next_recorder_repairs_the_file() {
    let (domain, run) = (Domain::for_test(), TempDir::new().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    let mut recording = Recording::start(&domain, run.path(), &bus);
    let mut truths = bus.publisher::<TruthNode>("truth/node").unwrap();
    let mut pacer = Pacer::new(5_000_000);
    let mut published = Vec::new();
    for _ in 0..500 {
        pacer.next();
        let mut truth = TruthNode::default();
        truth.header.stamp_ns = now_ns();
        truths.send(&mut truth).unwrap();
        published.push(truth.header.stamp_ns);
    }
    assert_eq!(recording.signal(rustix::process::Signal::KILL), None);
    let killed_ns = now_ns();
    let part = run.path().join("run.mcap.part");
    assert!(part.exists());
    let copy = run.path().join("copy.mcap.part");
    fs::copy(&part, &copy).unwrap();
    let recovery = recover(&copy, &mut |_, _| {}).unwrap();
    assert!(recovery.damage.is_empty(), "a kill leaves whole chunks: {:?}", recovery.damage);
    let found: Vec<u64> = read_channel::<TruthNode>(&recovery.file, "truth/node")
        .unwrap()
        .iter()
        .map(|(_, truth)| truth.header.stamp_ns)
        .collect();
    assert_eq!(found, published[..found.len()], "without a gap from the first on");
    let lost_ns = killed_ns - found.last().unwrap();
    // by stamps: a machine that stood still for a while has published nothing in that time, and can delay the flush as long
    let stood_still: u64 = published.windows(2).map(|pair| (pair[1] - pair[0]).saturating_sub(20_000_000)).sum();
    assert!(lost_ns <= 1_000_000_000 + stood_still, "{lost_ns} ns lost, stood still for {stood_still} ns");
    fs::remove_file(recovery.file).unwrap();

    // the next recorder of the same run begins another file and repairs the first
    let mut recording = Recording::start(&domain, run.path(), &bus);
    let mut truth = TruthNode::default();
    truth.header.stamp_ns = now_ns();
    truths.send(&mut truth).unwrap();
    until("the first file is repaired", || run.path().join("run.mcap").exists() && !part.exists());
    assert_eq!(recording.signal(rustix::process::Signal::INT), Some(0));
    let after = numbers::<TruthNode>(&run.path().join("run-0002.mcap"), "truth/node");
    assert_eq!(after.last(), Some(&501));
    let report = info(run.path()).unwrap();
    assert_eq!(report.files.len(), 2);
    assert!(report.files.iter().all(|file| file.finished && file.damage.is_empty()));
}

#[test]
fn it_refuses_what_it_cannot_use_with_one_sentence() {
    let (domain, run) = (Domain::for_test(), TempDir::new().unwrap());
    let ask = |args: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_recorder")).args(args).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, said) = ask(&["--domain", domain.name(), "--run", "/no/such/folder"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("/no/such/folder: there is no such folder"), "{said}");
    let (code, said) = ask(&["--run", run.path().to_str().unwrap()]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("no domain"), "{said}");
}

/// Not a test: prints what the recorder costs at 100 Hz on 15 channels.
/// `cargo test -p recorder --test process -- --ignored --nocapture`
#[test]
#[ignore = "a measurement of ten seconds"]
fn cost() {
    let (domain, run) = (Domain::for_test(), TempDir::new().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    let mut recording = Recording::start(&domain, run.path(), &bus);
    let mut publishers: Vec<_> =
        (0..15).map(|number| bus.publisher::<MotorState>(&format!("load/{number}")).unwrap()).collect();
    let mut pacer = Pacer::new(10_000_000);
    let mut random = 88_172_645_463_325_252_u64;
    let before = recording.ticks();
    for seq in 1..=1_000 {
        pacer.next();
        for publisher in &mut publishers {
            let mut state = state(seq);
            for value in &mut state.velocity_m_s {
                random ^= random << 13;
                random ^= random >> 7;
                random ^= random << 17;
                *value = random as f64 * 1e-20;
            }
            publisher.send(&mut state).unwrap();
        }
    }
    let ticks = recording.ticks() - before;
    let private = recording.private_kb();
    assert_eq!(recording.signal(rustix::process::Signal::TERM), Some(0));
    println!("{} % of a core, {private} kB of private memory\n{}", ticks as f64 / 10.0, info(run.path()).unwrap());
}
