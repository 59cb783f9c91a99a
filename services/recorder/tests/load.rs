//! A measurement, not a test: cost and capacity of the recorder.
//!
//! `NIMS_LOAD_S=60 cargo test --workspace --test load -- --ignored --nocapture`, or one of them, such as `one_more`.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod rig;

use std::collections::BTreeMap;
use std::process::Command;

use bus::clock::Pacer;
use bus::{Bus, Domain};
use config::RecorderSection;
use messages::{Field, Header, Message};
use recorder::{Recorder, Settings};
use rig::Recording;
use runlog::info;
use tempfile::TempDir;

/// Number of channels like those of the control loop, each at 200 Hz or more.
const CHANNELS: usize = 100;
const PASS_NS: u64 = 5_000_000;

macro_rules! load {
    ($name:ident, $bytes:literal) => {
        #[repr(C)]
        #[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
        struct $name {
            header: Header,
            data: [u8; $bytes],
        }

        impl Field for $name {
            type Element = Self;
            const ROS: &'static str = concat!("load_msgs/", stringify!($name));
        }

        impl Message for $name {
            const NAME: &'static str = stringify!($name);
            fn schema() -> &'static str {
                concat!(
                    "uint64 life\nuint64 cycle\nuint64 seq\nuint64 stamp_ns\nuint64 published_ns\nuint64 oldest_input_ns\nuint8[",
                    stringify!($bytes),
                    "] data\n"
                )
            }
            fn type_name() -> &'static str {
                concat!("load_msgs/", stringify!($name), "/1")
            }
            fn header(&self) -> &Header {
                &self.header
            }
            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }
    };
}

load!(Small, 96);
load!(Cloud, 99968);

/// Fills a sample with numbers like measurements: the upper bytes of each repeat, the lower do not.
fn fill(data: &mut [u8], random: &mut u64) {
    for chunk in data.chunks_exact_mut(8) {
        *random ^= *random << 13;
        *random ^= *random >> 7;
        *random ^= *random << 17;
        chunk.copy_from_slice(&(1.0 + (*random >> 40) as f64 * 1e-9).to_le_bytes());
    }
}

/// Publishes `per_pass` samples per channel in each pass, and 2 MB/s of clouds, for some seconds. Returns the processor
/// time of the recorder (s and percent of a core) and the number of samples lost and missing.
fn run(per_pass: usize, seconds: u64) -> (f64, f64, u64, u64) {
    let (domain, folder) = (Domain::for_test(), TempDir::new().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    let mut small: Vec<_> =
        (0..CHANNELS).map(|at| bus.publisher::<Small>(&format!("motor/command/{at}")).unwrap()).collect();
    let mut clouds = bus.publisher::<Cloud>("cloud/lidar").unwrap();
    let mut recording = Recording::start(&domain, folder.path(), &bus);
    let mut random = 88_172_645_463_325_252_u64;
    let mut sample: Small = bytemuck::Zeroable::zeroed();
    let mut cloud: Box<Cloud> = Box::new(bytemuck::Zeroable::zeroed());
    let mut pacer = Pacer::new(PASS_NS);
    let (before, begun) = (recording.ticks(), std::time::Instant::now());
    let passes = seconds * 1_000_000_000 / PASS_NS;
    for pass in 0..passes {
        pacer.next();
        for publisher in &mut small {
            for _ in 0..per_pass {
                fill(&mut sample.data, &mut random);
                sample.header.stamp_ns = bus::clock::now_ns();
                publisher.send(&mut sample).unwrap();
            }
        }
        if pass % 10 == 0 {
            fill(&mut cloud.data, &mut random);
            cloud.header.stamp_ns = bus::clock::now_ns();
            clouds.send(&mut cloud).unwrap();
        }
    }
    let took = begun.elapsed().as_secs_f64();
    let cpu_s = (recording.ticks() - before) as f64 * 0.01;
    let percent = 100.0 * cpu_s / took;
    assert_eq!(recording.signal(rustix::process::Signal::TERM), Some(0));
    let report = info(folder.path()).unwrap();
    let lost = report.channels.iter().map(|channel| channel.lost).sum();
    let own = |name: &str| name.starts_with("motor/command/") || name == "cloud/lidar";
    let found: u64 = report.channels.iter().filter(|channel| own(&channel.name)).map(|channel| channel.messages).sum();
    let sent = passes * (CHANNELS * per_pass) as u64 + passes.div_ceil(10);
    println!(
        "{:.0} samples/s of 128 B and {:.1} MB/s of clouds for {took:.1} s: {found} of {sent} recorded, {lost} lost, {percent:.1} % of a core, {:.1} MB on disk",
        (passes as usize * CHANNELS * per_pass) as f64 / took,
        passes.div_ceil(10) as f64 * size_of::<Cloud>() as f64 / took / 1e6,
        report.files.iter().map(|file| file.bytes).sum::<u64>() as f64 / 1e6
    );
    (cpu_s, percent, lost, sent - found)
}

#[test]
#[ignore = "a measurement of a minute"]
fn load() {
    let seconds = std::env::var("NIMS_LOAD_S").ok().and_then(|text| text.parse().ok()).unwrap_or(10);
    let (recorder_s, _, lost, missing) = run(1, seconds);
    let bare = std::env::current_exe().unwrap().parent().unwrap().join("../examples/bare");
    let output = Command::new(&bare).args(["20000", &seconds.to_string()]).output();
    match output {
        Ok(output) => {
            let printed = String::from_utf8_lossy(&output.stdout).into_owned();
            let cpu_s: f64 = printed.trim().parse().unwrap();
            let ratio = recorder_s / cpu_s;
            println!(
                "the same bytes with the bare mcap crate: {cpu_s:.2} s of processor time; the recorder takes {recorder_s:.2} s, {ratio:.1} times that"
            );
        }
        Err(error) => println!("{}: {error}; build it with cargo build --workspace --examples", bare.display()),
    }
    assert_eq!((lost, missing), (0, 0));
}

#[test]
#[ignore = "a measurement of a minute"]
fn ceiling() {
    for per_pass in [2, 4, 8, 16] {
        let (_, percent, lost, _) = run(per_pass, 5);
        if lost > 0 || percent > 95.0 {
            return;
        }
    }
}

/// Processor time that a recorder of so many channels needs for one more, and the private memory that each takes.
#[test]
#[ignore = "a measurement"]
fn one_more_channel() {
    let (domain, folder) = (Domain::for_test(), TempDir::new().unwrap());
    let [publishing, bus] = ["test", "recorder"].map(|name| Bus::join(&domain, name).unwrap());
    let settings = Settings::new(&RecorderSection::default(), folder.path().to_owned(), BTreeMap::new());
    let mut recorder = Recorder::open(&bus, settings, Vec::new()).unwrap();
    let mut channels = Vec::new();
    for number in [10, 100, 500] {
        while channels.len() < number {
            channels.push(publishing.publisher::<Small>(&format!("motor/command/{}", channels.len())).unwrap());
        }
        recorder.poll(&bus, true).unwrap();
        let (before_kb, mut took_ms) = (private_kb(), Vec::new());
        for _ in 0..20 {
            channels.push(publishing.publisher::<Small>(&format!("motor/command/{}", channels.len())).unwrap());
            took_ms.push(used_ms(|| recorder.poll(&bus, true).unwrap()));
        }
        let each_kb = (private_kb() - before_kb) / took_ms.len();
        took_ms.sort_by(f64::total_cmp);
        let none_ms = used_ms(|| recorder.poll(&bus, true).unwrap());
        println!(
            "{number} channels: one more takes {:.2} ms (median; {:.2} to {:.2}) and {each_kb} kB with its publisher; a search without a new one {none_ms:.2} ms",
            took_ms[10], took_ms[0], took_ms[19]
        );
    }
}

/// Processor time, which a busy machine changes less than the time that passes, ms.
fn used_ms(work: impl FnOnce()) -> f64 {
    let used_s = || {
        let used = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        used.tv_sec as f64 + 1e-9 * used.tv_nsec as f64
    };
    let before_s = used_s();
    work();
    1e3 * (used_s() - before_s)
}

fn private_kb() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}
