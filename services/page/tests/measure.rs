//! Measures how long a stop takes from the browser to the first braking cycle, what the page costs, and what flights
//! are beside ten clients and a browser.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod rig;

use bus::{Bus, Subscriber, clock};
use messages::MotorAuthority;
use rig::{Browser, Rig};
use robot_state::Periods;
use rustix::thread::{CpuSet, sched_setaffinity};
use serde_json::json;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Stops of each kind, and the time for which the cost is measured.
const PRESSES: usize = 200;
const COST: Duration = Duration::from_secs(60);
/// Time that each message takes to the page, and back.
const DELAY: Duration = Duration::from_millis(20);
/// Where the node is at first, and two points on both sides of it towards which it sets out.
const START: [f64; 3] = [4.8, 3.0, 0.3];
const POINTS: [[f64; 3]; 2] = [[4.0, 2.4, 0.6], [5.6, 3.6, 0.8]];

/// Milliseconds from now to the first cycle with that mode.
fn until_mode(authority: &mut Subscriber<MotorAuthority>, begun_ns: u64, modes: &[u8]) -> f64 {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(60) {
        while let Some(sample) = authority.receive().unwrap() {
            if sample.header.stamp_ns > begun_ns && modes.contains(&sample.mode) {
                return (sample.header.stamp_ns - begun_ns) as f64 * 1e-6;
            }
        }
        std::thread::sleep(Duration::from_micros(500));
    }
    panic!("the robot does not stop");
}

fn percentiles(mut ms: Vec<f64>) -> String {
    ms.sort_by(f64::total_cmp);
    let at = |share: f64| ms[((ms.len() - 1) as f64 * share).round() as usize];
    format!("{} times: p50 {:.1} ms, p99 {:.1} ms, max {:.1} ms", ms.len(), at(0.5), at(0.99), at(1.0))
}

#[test]
#[ignore = "takes ten minutes; prints how long a stop takes: docs/page.md"]
fn how_long_a_stop_takes() {
    let rig = Rig::up();
    let bus = Bus::join(rig.domain(), "observer").unwrap();
    let mut authority = bus.deep_subscriber::<MotorAuthority>("motor/authority").unwrap();
    let mut flyer = rig.far_browser(Some(&rig.token("tablet", "fly")), DELAY);
    rig::ready(&mut flyer, START);
    for (verb, modes, resets) in [
        ("stop", vec![MotorAuthority::MODE_STOPPING, MotorAuthority::MODE_HOLDING], false),
        ("estop", vec![MotorAuthority::MODE_EMERGENCY_STOP], true),
    ] {
        let mut taken = Vec::new();
        for press in 0..PRESSES {
            let to_m = POINTS[(press + 1) % 2];
            let go = json!({ "verb": "goto", "to_m": to_m, "path": { "shape": "line" }, "speed_m_s": 0.2 });
            flyer.insist(&json!({ "call": "ask", "request": go }));
            flyer.until_state("it flies", |state| state["mode"] == "following");
            while authority.receive().unwrap().is_some() {}
            let begun_ns = clock::now_ns();
            flyer.send(&json!({ "call": "ask", "id": 1_000_000, "request": { "verb": verb } }));
            taken.push(until_mode(&mut authority, begun_ns, &modes));
            if resets {
                flyer.until_state("it has stopped", |state| state["mode"] == "emergency stop");
                assert_eq!(flyer.ask(json!({ "verb": "reset" }))["accepted"], "accepted");
            }
            flyer.until_state("it holds", |state| state["mode"] == "holding");
        }
        println!("{verb}: {}", percentiles(taken));
    }
}

#[test]
#[ignore = "takes five minutes; prints how long a held motion outlives its browser: docs/page.md"]
fn how_long_a_held_motion_outlives_its_browser() {
    let rig = Rig::up();
    let bus = Bus::join(rig.domain(), "observer").unwrap();
    let mut authority = bus.deep_subscriber::<MotorAuthority>("motor/authority").unwrap();
    let token = rig.token("tablet", "fly");
    let mut flyer = rig.browser(Some(&token));
    rig::ready(&mut flyer, START);
    let (mut silent, mut cut) = (Vec::new(), Vec::new());
    for link in 0..2 * PRESSES {
        let go = json!({ "verb": "goto", "to_m": POINTS[link / 2 % 2], "path": { "shape": "line" }, "speed_m_s": 0.2 });
        // The next browser is there before the link of this one is cut.
        let next = (link % 2 == 1).then(|| rig.browser(Some(&token)));
        flyer.hold_until(&go, "following");
        while authority.receive().unwrap().is_some() {}
        flyer.beat();
        let begun_ns = clock::now_ns();
        if let Some(next) = next {
            flyer = next;
        }
        let modes = [MotorAuthority::MODE_STOPPING, MotorAuthority::MODE_HOLDING];
        let taken = until_mode(&mut authority, begun_ns, &modes);
        if link % 2 == 1 {
            cut.push(taken)
        } else {
            silent.push(taken)
        }
        flyer.until_state("it holds", |state| state["mode"] == "holding");
    }
    println!("after the last sign: {}", percentiles(silent));
    println!("after the link was cut: {}", percentiles(cut));
}

/// Sends the node to a point and waits until it is there.
fn fly(flyer: &mut Browser, to_m: [f64; 3]) {
    let go = json!({ "verb": "goto", "to_m": to_m, "path": { "shape": "line" }, "speed_m_s": 0.2 });
    flyer.insist(&json!({ "call": "ask", "request": go }));
    flyer.until_state("it flies", |state| state["mode"] == "following");
    flyer.until_state("it is there", |state| state["mode"] == "holding");
}

#[test]
#[ignore = "takes three minutes; prints what the page costs: docs/page.md"]
fn what_the_page_costs() {
    let rig = Rig::up();
    let mut flyer = rig.browser(Some(&rig.token("tablet", "fly")));
    rig::ready(&mut flyer, START);
    let mut before = flyer.until_state("its periods", |state| state["cycle"].is_object())["cycle"].clone();
    let mut browsers = 1;
    for count in [1, 2, 11] {
        while browsers < count {
            let mut browser: Browser = rig.browser(None);
            std::thread::spawn(move || while browser.take_one() {});
            browsers += 1;
        }
        let (begun, used_s, mut legs) = (Instant::now(), rig.page_cpu_s(), 0);
        while begun.elapsed() < COST {
            fly(&mut flyer, POINTS[legs % 2]);
            legs += 1;
        }
        let share = 100.0 * (rig.page_cpu_s() - used_s) / begun.elapsed().as_secs_f64();
        let after = flyer.until_state("its periods", |state| state["cycle"].is_object())["cycle"].clone();
        let more = |key: &str| after[key].as_u64().unwrap() - before[key].as_u64().unwrap();
        let (lost, all, memory_mb) = (more("unsteered"), more("all"), rig.page_memory_mb());
        println!("{count} browsers: {share:.1} % of a core, {memory_mb:.1} MB; {lost} of {all} periods not steered");
        println!("    so far: {}", after["summary"].as_str().unwrap_or_default());
        before = after;
    }
}

/// Clients beside a browser, and pairs of flights with and without them.
const CLIENTS: usize = 10;
const PAIRS: usize = 3;
/// Minutes of each flight, if not 10.
const MINUTES: &str = "NIMS_MINUTES";

/// Keeps this thread, and what it starts, on one processor.
fn keep_on(processor: usize) {
    let mut one = CpuSet::new();
    one.set(processor);
    sched_setaffinity(None, &one).expect("two processors are needed");
}

/// The kernel's workers on the first processor until this is dropped: they pass on the bytes of the robot's ports, and
/// on a processor that a browser keeps busy they wait for it (docs/real-time.md).
struct Workers {
    before: String,
}

const WORKERS: &str = "/sys/devices/virtual/workqueue/cpumask";

impl Workers {
    fn on_the_first() -> Self {
        let before = std::fs::read_to_string(WORKERS).unwrap_or_default();
        if let Err(error) = std::fs::write(WORKERS, "1") {
            println!("the kernel's workers stay on every processor: {WORKERS}: {error}");
        }
        Self { before }
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        let _ = std::fs::write(WORKERS, &self.before);
    }
}

/// A real browser that shows the page; ended when it is dropped.
struct Chromium(Child);

impl Chromium {
    fn open(address: &str, folder: &std::path::Path) -> Self {
        let mut command = Command::new("chromium");
        command.args(["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]);
        command.args(["--remote-debugging-port=0", "--window-size=820,1180"]);
        command.arg(format!("--user-data-dir={}", folder.display())).arg(format!("http://{address}/"));
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        Self(child.expect("chromium is needed: apt-get install chromium"))
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        let _ = rustix::process::kill_process(rustix::process::Pid::from_child(&self.0), rustix::process::Signal::TERM);
        let _ = self.0.wait();
    }
}

/// Flies to and fro with the robot and its page on one processor, and all that look on the other; returns the periods.
fn flight(lasts: Duration, crowd: bool) -> Periods {
    keep_on(0);
    let rig = Rig::up();
    keep_on(1);
    let bus = Bus::join(rig.domain(), "observer").unwrap();
    let mut authority = bus.deep_subscriber::<MotorAuthority>("motor/authority").unwrap();
    let mut flyer = rig.browser(Some(&rig.token("tablet", "fly")));
    rig::ready(&mut flyer, START);
    let folder = tempfile::tempdir().unwrap();
    let chromium = crowd.then(|| Chromium::open(&rig.address, folder.path()));
    for _ in 0..if crowd { CLIENTS } else { 0 } {
        let mut client = rig.browser(None);
        std::thread::spawn(move || while client.take_one() {});
    }
    let (begun, used_s, mut legs) = (Instant::now(), rig.page_cpu_s(), 0);
    while begun.elapsed() < lasts {
        fly(&mut flyer, POINTS[legs % 2]);
        legs += 1;
    }
    let share = 100.0 * (rig.page_cpu_s() - used_s) / begun.elapsed().as_secs_f64();
    let periods = Periods::from_authority(&authority.latest().unwrap().unwrap());
    let beside = if crowd { "beside ten clients and a browser" } else { "alone" };
    println!(
        "{beside}: {} ({}); the page: {share:.1} % of a core, {:.1} MB",
        periods.leading(),
        periods.by_cause(),
        rig.page_memory_mb()
    );
    drop(chromium);
    periods
}

#[test]
#[ignore = "takes an hour; prints what flights are beside ten clients and a browser: docs/page.md"]
fn flights_beside_ten_clients() {
    let minutes = std::env::var(MINUTES).map_or(10.0, |minutes| minutes.parse().unwrap());
    let lasts = Duration::from_secs_f64(60.0 * minutes);
    let _workers = Workers::on_the_first();
    for pair in 0..PAIRS {
        // Alternating, so that what changes with time is in both.
        for crowd in [pair % 2 == 1, pair % 2 == 0] {
            flight(lasts, crowd);
        }
    }
}
