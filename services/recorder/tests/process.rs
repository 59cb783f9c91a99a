//! The recorder process in its own domain: from the first sample to a kill.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod rig;

use std::fs;
use std::path::Path;
use std::process::Command;

use bus::clock::{Pacer, WallClock, now_ns};
use bus::{Bus, Domain};
use messages::ros::PointCloud2;
use messages::{
    LogEvent, Message, MotorState, Reading, RecorderGap, RecorderStatus, TruthNode, put_text, quality_of, text_of,
};
use runlog::{RunReader, info, read_channel, recover};
use tempfile::TempDir;

use rig::{Recording, until};

fn state(seq: u64) -> MotorState {
    let mut state = MotorState::default();
    state.header.cycle = seq;
    state.header.stamp_ns = now_ns();
    state.length_m = [seq as f64 * 0.001; 8];
    state
}

#[test]
fn stamps_are_converted_by_the_clock_of_the_run() {
    let (domain, run) = (Domain::for_test(), TempDir::new().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    assert_eq!(domain.wall_clock(), None);
    // The wall clock was advanced by an hour after the start of the run.
    let set = WallClock { unix_ns: WallClock::now().unix_ns - 3_600_000_000_000, ..WallClock::now() };
    domain.set_wall_clock(Some(set)).unwrap();
    assert_eq!(domain.wall_clock(), Some(set));
    let mut recording = Recording::start(&domain, run.path(), &bus);
    assert_eq!(recording.signal(rustix::process::Signal::TERM), Some(0));
    let clock = RunReader::open(run.path()).unwrap().clock().unwrap();
    assert_eq!((clock.t0_unix_ns, clock.t0_mono_ns), (set.unix_ns, set.mono_ns));
    domain.set_wall_clock(None).unwrap();
    assert_eq!(domain.wall_clock(), None);
}

fn numbers<T: Message>(run: &Path, channel: &str) -> Vec<u64> {
    read_channel::<T>(run, channel).unwrap().iter().map(|(_, sample)| sample.header().seq).collect()
}

#[test]
fn every_sample_from_the_first_on_is_in_the_file() {
    let (domain, run) = (Domain::for_test(), TempDir::new().unwrap());
    fs::write(run.path().join("system.toml"), "name = \"test\"\n").unwrap();
    let bus = Bus::join(&domain, "test").unwrap();
    // Published before the recorder started; the channel stores its history.
    let mut early = bus.publisher::<LogEvent>("system/log/early").unwrap();
    for _ in 0..100 {
        early.send(&mut LogEvent::default()).unwrap();
    }
    assert!(quality_of("system/log/early").history >= 100);
    let mut recording = Recording::start(&domain, run.path(), &bus);
    early.update_connections();
    // A channel of the table and a discovered one are recorded from their first sample on.
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
    assert_eq!(numbers::<LogEvent>(run.path(), "system/log/early"), (1..=100).collect::<Vec<_>>());
    let report = info(run.path()).unwrap();
    assert!(report.healthy, "{:?}", report.verdict);
    assert_eq!(report.attachments, ["system.toml"]);
    assert_eq!(report.about["domain"], domain.name());
    for channel in ["recorder/status", "system/heartbeat/recorder"] {
        assert!(report.channels.iter().any(|found| found.name == channel), "{channel}");
    }
    // The file is in the order of publication, except within one poll of the channels.
    let mut reader = RunReader::open(run.path()).unwrap();
    let mut last = 0;
    while let Some(recorded) = reader.next_sample().unwrap() {
        assert!(recorded.log_time_ns + 1_000_000_000 > last);
        last = last.max(recorded.log_time_ns);
    }
}

/// More kills at other instants: `NIMS_KILLS=50 cargo test --workspace --test process -- a_kill`.
#[test]
fn a_kill_loses_at_most_the_last_second_and_the_next_recorder_repairs_the_file() {
    let kills = std::env::var("NIMS_KILLS").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let mut worst_ns = 0;
    for number in 1..=kills {
        // The kills are spread over the half second between two flushes, and over the start of a run.
        worst_ns = worst_ns.max(kill_after(100 + (number * 377) % 401));
    }
    println!("{kills} kills: at most {:.3} s lost", worst_ns as f64 * 1e-9);
}

/// Kills a recorder after `count` samples at 200 Hz; returns the length of the time without samples in the file, ns.
fn kill_after(count: u64) -> u64 {
    let (domain, run) = (Domain::for_test(), TempDir::new().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    let mut recording = Recording::start(&domain, run.path(), &bus);
    let mut truths = bus.publisher::<TruthNode>("truth/node").unwrap();
    let mut pacer = Pacer::new(5_000_000);
    let mut published = Vec::new();
    for _ in 0..count {
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
    assert!(recovery.damage.iter().all(|damage| damage.torn_end), "{:?}", recovery.damage);
    let found: Vec<u64> = read_channel::<TruthNode>(&recovery.file, "truth/node")
        .unwrap()
        .iter()
        .map(|(_, truth)| truth.header.stamp_ns)
        .collect();
    assert_eq!(found, published[..found.len()], "without a gap from the first on");
    let lost_ns = killed_ns - found.last().unwrap_or(&published[0]);
    // A stalled machine publishes nothing during the stall, and can delay the flush by the same time.
    let stalled_ns: u64 = published.windows(2).map(|pair| (pair[1] - pair[0]).saturating_sub(20_000_000)).sum();
    assert!(lost_ns <= 1_000_000_000 + stalled_ns, "{lost_ns} ns lost, stalled for {stalled_ns} ns");
    fs::remove_file(recovery.file).unwrap();

    // The next recorder of the same run starts another file and repairs the first.
    let mut recording = Recording::start(&domain, run.path(), &bus);
    let mut truth = TruthNode::default();
    truth.header.stamp_ns = now_ns();
    truths.send(&mut truth).unwrap();
    until("the first file is repaired", || run.path().join("run.mcap").exists() && !part.exists());
    assert_eq!(recording.signal(rustix::process::Signal::INT), Some(0));
    let after = numbers::<TruthNode>(&run.path().join("run-0002.mcap"), "truth/node");
    assert_eq!(after.last(), Some(&(count + 1)));
    assert!(
        after[0] as usize <= found.len() + 1,
        "the history of the channel contains the samples lost by the kill: {} and {after:?}",
        found.len()
    );
    let whole = numbers::<TruthNode>(run.path(), "truth/node");
    assert_eq!(whole, (1..=count + 1).collect::<Vec<_>>(), "both files as one: none missing, none twice");
    let report = info(run.path()).unwrap();
    assert_eq!((report.files.len(), report.gaps.len()), (2, 0));
    assert!(report.files.iter().all(|file| file.finished && file.damage.is_empty()));
    lost_ns
}

#[test]
fn a_file_that_cannot_grow_is_abandoned_and_every_missing_sample_is_counted() {
    let (domain, run) = (Domain::for_test(), TempDir::new().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    let mut recording = Recording::start_limited(&domain, run.path(), &bus, 16_000_000);
    let mut rows = bus.subscriber::<RecorderStatus>("recorder/status").unwrap();
    let mut states = bus.publisher::<MotorState>("motor/state").unwrap();
    let mut clouds = bus.publisher::<PointCloud2>("visualization/samples/noise").unwrap();
    let mut cloud: Box<PointCloud2> = Box::new(bytemuck::Zeroable::zeroed());
    let (mut seq, mut random) = (0, 88_172_645_463_325_252_u64);
    let mut last = None;
    // Not a fixed time: until the recorder reports the state, plus half a second.
    let mut publish_until = |noise: bool, state: u8| {
        let (mut pacer, mut more) = (Pacer::new(2_000_000), 0);
        let give_up = now_ns() + 60_000_000_000;
        while more < 250 {
            pacer.next();
            seq += 1;
            states.send(&mut self::state(seq)).unwrap();
            if noise {
                for byte in &mut cloud.0 {
                    random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    *byte = (random >> 56) as u8;
                }
                clouds.send(&mut cloud).unwrap();
            }
            while let Some(row) = rows.receive().unwrap().filter(|row| text_of(&row.channel) == "motor/state") {
                last = Some(row);
            }
            more += u64::from(more > 0 || last.is_some_and(|row| row.state == state));
            assert!(now_ns() < give_up, "{last:?}");
        }
        seq
    };
    publish_until(true, RecorderStatus::STATE_RECORDING);
    publish_until(true, RecorderStatus::STATE_FAILED);
    let published = publish_until(false, RecorderStatus::STATE_RECORDING);
    assert_eq!(recording.signal(rustix::process::Signal::TERM), Some(0));
    // The recorder itself is not allowed to write a file of this size.
    let part = run.path().join("run.mcap.part");
    if part.exists() {
        recover(&part, &mut |_, _| {}).unwrap();
    }

    let found = numbers::<MotorState>(run.path(), "motor/state");
    assert_eq!(found.last(), Some(&published));
    let missing = published - found.len() as u64;
    let report = info(run.path()).unwrap();
    assert!(missing > 250 && report.files.len() == 2, "{report}");
    let gaps = read_channel::<RecorderGap>(run.path(), "recorder/gap").unwrap();
    let of_states = || gaps.iter().map(|(_, gap)| gap).filter(|gap| text_of(&gap.channel) == "motor/state");
    assert_eq!(of_states().map(|gap| gap.missing).sum::<u64>(), missing, "{report}");
    let gap = of_states().max_by_key(|gap| gap.missing).unwrap();
    assert!(found.contains(&gap.last_seq) && found.contains(&gap.next_seq) && !found.contains(&(gap.last_seq + 1)));
    let said = read_channel::<RecorderStatus>(run.path(), "recorder/status").unwrap();
    let last = said.iter().rev().find(|(_, row)| text_of(&row.channel) == "motor/state").unwrap().1;
    assert_eq!((last.lost, last.state), (missing, RecorderStatus::STATE_RECORDING));
}

#[test]
fn bad_input_is_rejected_with_one_sentence() {
    let (domain, run) = (Domain::for_test(), TempDir::new().unwrap());
    let ask = |args: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_recorder")).args(args).output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, said) = ask(&["--domain", domain.name(), "--run", "/no/such/folder"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("/no/such/folder") && said.lines().count() == 1, "{said}");
    let (code, said) = ask(&["--run", run.path().to_str().unwrap()]);
    assert_eq!(code, Some(2), "{said}");
    assert!(["--system", "--domain"].iter().all(|option| said.contains(option)) && said.lines().count() == 1, "{said}");
}

/// Needs a small file system: `mount -t tmpfs -o size=32m none DIR`, then
/// `NIMS_SMALL_DISK=DIR cargo test --workspace --test process -- --ignored`.
#[test]
#[ignore = "needs a small file system"]
fn a_full_disk_is_reported_within_a_second_and_recording_resumes_when_there_is_space() {
    let disk = std::env::var("NIMS_SMALL_DISK").expect("NIMS_SMALL_DISK names a folder on a small file system");
    let (domain, run) = (Domain::for_test(), tempfile::tempdir_in(disk).unwrap());
    let boxes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/systems").canonicalize().unwrap();
    let text = fs::read_to_string(boxes.join("demo3.toml")).unwrap();
    let robot = boxes.join("../robots/lab3.toml");
    let text = text.replace("\"../robots/lab3.toml\"", &format!("{:?}", robot.display().to_string()));
    let system_file = run.path().join("system.toml");
    fs::write(&system_file, text + "\n[recorder]\nmin_free_bytes = 4000000\n").unwrap();
    let bus = Bus::join(&domain, "test").unwrap();
    let mut recording = Recording::start_with(&domain, run.path(), &bus, &["--system", system_file.to_str().unwrap()]);
    let mut rows = bus.subscriber::<RecorderStatus>("recorder/status").unwrap();
    let mut states = bus.publisher::<MotorState>("motor/state").unwrap();
    let (mut seq, mut worst_ns) = (0, 0);
    let mut publish_until = |what: &str, recording: bool| {
        let (begun, mut pacer) = (now_ns(), Pacer::new(5_000_000));
        loop {
            pacer.next();
            seq += 1;
            let before = now_ns();
            states.send(&mut state(seq)).unwrap();
            worst_ns = worst_ns.max(now_ns() - before);
            while let Some(row) = rows.receive().unwrap() {
                if (row.state == RecorderStatus::STATE_RECORDING) == recording {
                    return (now_ns() - begun) as f64 * 1e-9;
                }
            }
            assert!(now_ns() - begun < 20_000_000_000, "{what}: not within 20 s");
        }
    };
    publish_until("recording", true);
    let ballast = run.path().join("ballast");
    // Fill the disk completely.
    let _ = fs::write(&ballast, vec![1_u8; 64 << 20]);
    let noticed_s = publish_until("the disk is full", false);
    fs::remove_file(&ballast).unwrap();
    let resumed_s = publish_until("there is room", true);
    publish_until("recording", true);
    until("the cut file is recovered", || {
        !fs::read_dir(run.path()).unwrap().flatten().any(|entry| {
            let name = entry.file_name();
            name == "run.mcap.part" || name.to_string_lossy().ends_with(".recovering")
        })
    });
    assert_eq!(recording.signal(rustix::process::Signal::TERM), Some(0));
    let report = info(run.path()).unwrap();
    assert!(report.files.iter().all(|file| file.finished), "{report}");
    println!("noticed after {noticed_s:.2} s, resumed after {resumed_s:.2} s, longest send {worst_ns} ns\n{report}");
    let missing: u64 = report.gaps.iter().filter(|gap| gap.channel == "motor/state").map(|gap| gap.missing).sum();
    let found = numbers::<MotorState>(run.path(), "motor/state").len() as u64;
    assert!(missing > 0 && missing + found == seq, "{missing} missing and {found} found of {seq}\n{report}");
    assert!(report.files.len() >= 2);
}
