//! The sensor logger as a process, beside the recorder: every reading of sensors that come and go becomes a sample with
//! the right position, and a map. On a robot with the virtual motor box it is a normal process of the table.
//!
//! `NIMS_SENSORS=100 NIMS_SENSOR_S=60 cargo test --workspace --test live -- every_reading --nocapture` runs the same
//! under load.

use crate::robot::{Robot, program, root};
use bus::clock::{Pacer, now_ns};
use bus::{Bus, Domain, Publisher};
use messages::{
    FieldMap, Header, Heartbeat, LogEvent, MotorAuthority, NodeEstimate, Reading, Request, Sample, SensorFlag,
    put_text, text_of,
};
use rustix::process::{Pid, Signal, kill_process};
use std::cell::{Cell, RefCell};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

messages::message! {
    /// A type that this project does not define.
    pub struct Probe {
        header: Header,
        temperature_c: f64,
        counts: [u32; 2],
    }
}

/// Estimates and readings per second.
const PASS_NS: u64 = 10_000_000;
/// Delay of each reading, ns.
const LATENCY_NS: u64 = 45_000_000;
/// Passes at the end with estimates only, for the readings that wait.
const AFTER: u64 = 30;
/// Position and velocity of the node in the tests without a robot.
const FROM_M: [f64; 3] = [4.0, 3.0, 0.8];
const SPEED_M_S: f64 = 0.05;

/// A process that ends with the test.
struct Running(Child);

impl Running {
    /// Starts a program beside `nims`, and waits until it is ready.
    fn start(bus: &Bus, domain: &Domain, name: &str, more: &[&str]) -> Self {
        let mut beats = bus.subscriber::<Heartbeat>(&format!("system/heartbeat/{name}")).unwrap();
        let child = Command::new(program().with_file_name(name))
            .args(["--domain", domain.name()])
            .args(more)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let running = Self(child);
        for _ in 0..6000 {
            if std::iter::from_fn(|| beats.receive().unwrap()).any(|beat| beat.state == Heartbeat::STATE_READY) {
                return running;
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        panic!("{name} is not ready within a minute");
    }

    fn end(mut self) -> Option<i32> {
        kill_process(Pid::from_child(&self.0), Signal::TERM).unwrap();
        self.0.wait().unwrap().code()
    }

    /// Processor time, s.
    fn cpu_s(&self) -> f64 {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.0.id())).unwrap();
        let fields: Vec<&str> = stat.rsplit(") ").next().unwrap().split(' ').collect();
        (fields[11].parse::<u64>().unwrap() + fields[12].parse::<u64>().unwrap()) as f64 * 0.01
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Position of the node at an instant, since `begun_ns`.
fn place(begun_ns: u64, time_ns: u64) -> [f64; 3] {
    let time_s = (i128::from(time_ns) - i128::from(begun_ns)) as f64 * 1e-9;
    // to and fro, so that it stays over the map
    let along = (SPEED_M_S * time_s).rem_euclid(2.0);
    [FROM_M[0] + along.min(2.0 - along), FROM_M[1], FROM_M[2]]
}

fn estimate(begun_ns: u64, cycle: u64, stamp_ns: u64) -> NodeEstimate {
    let mut estimate = NodeEstimate {
        position_m: place(begun_ns, stamp_ns),
        valid: 1,
        epoch: 1,
        cable_count: 3,
        ..NodeEstimate::default()
    };
    estimate.header = Header { cycle, ..Header::at(stamp_ns) };
    for k in 0..3 {
        estimate.covariance_m2[4 * k] = 1e-6;
    }
    estimate
}

fn reading(begun_ns: u64, now: u64) -> Reading {
    let mut reading = Reading { count: 1, lever_m: [0.0, 0.0, -0.1], ..Reading::default() };
    reading.header = Header { oldest_input_ns: now - LATENCY_NS, ..Header::at(now) };
    // it measures its position
    reading.value[0] = place(begun_ns, now - LATENCY_NS)[0];
    put_text(&mut reading.quantity, "place");
    put_text(&mut reading.unit, "m");
    reading
}

fn of_env(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).map_or(otherwise, |text| text.parse().unwrap())
}

/// Writes a system file that states the range of the probe.
fn with_a_range(folder: &Path) -> PathBuf {
    let configs = root().join("configs");
    let text = std::fs::read_to_string(configs.join("systems/demo3.toml")).unwrap();
    let text = text.replace("\"../", &format!("\"{}/", configs.display()));
    let path = folder.join("system.toml");
    let sensor = "[[sensor_logger.sensor]]\nname = \"probe\"\nrange = [[0.0, 15.0]]\n";
    std::fs::write(&path, format!("{text}\n{sensor}")).unwrap();
    path
}

/// Compares every sample with its reading; returns the largest distance from where the sensor was, m, and their number.
fn farthest_sample_m(run: &Path, sent: &[u64]) -> (f64, u64) {
    let (mut worst_m, mut all) = (0.0_f64, 0);
    for (number, sent) in sent.iter().enumerate() {
        let samples = runlog::read_channel::<Sample>(run, &format!("sample/s{number}")).unwrap();
        let readings = runlog::read_channel::<Reading>(run, &format!("sensor/s{number}")).unwrap();
        assert_eq!((readings.len() as u64, samples.len() as u64), (*sent, *sent), "sensor s{number}");
        for ((_, sample), (_, reading)) in samples.iter().zip(&readings) {
            assert_eq!((sample.reading_seq, sample.value[0]), (reading.header.seq, reading.value[0]));
            assert_eq!(sample.header.stamp_ns, reading.header.oldest_input_ns);
            worst_m = worst_m.max((sample.position_m[0] - sample.value[0]).abs());
            assert!((sample.position_m[2] - (FROM_M[2] - 0.1)).abs() < 1e-9, "the lever");
            assert!((0.0009..0.0012).contains(&sample.position_std_m[0]), "{:?}", sample.position_std_m);
        }
        all += sent;
    }
    (worst_m, all)
}

#[test]
fn every_reading_of_every_sensor_becomes_a_sample() {
    let (sensors, seconds) = (of_env("NIMS_SENSORS", 6), of_env("NIMS_SENSOR_S", 4));
    let (domain, folder) = (Domain::for_test(), tempfile::tempdir().unwrap());
    let bus = Bus::join(&domain, "test").unwrap();
    let run = folder.path().join("run");
    std::fs::create_dir(&run).unwrap();
    let system_file = with_a_range(folder.path());
    let recorder = Running::start(&bus, &domain, "recorder", &["--run", run.to_str().unwrap()]);
    let logger = Running::start(&bus, &domain, "sensor-logger", &["--system", system_file.to_str().unwrap()]);

    let mut estimates = bus.publisher::<NodeEstimate>("node/estimate/a").unwrap();
    let open = |number: u64| bus.publisher::<Reading>(&format!("sensor/s{number}")).unwrap();
    let mut ports: Vec<Publisher<Reading>> = (0..sensors).map(open).collect();
    let mut probe: Option<Publisher<Probe>> = None;
    let (mut sent, mut probes) = (vec![0_u64; ports.len()], 0_u64);
    let passes = seconds * 1_000_000_000 / PASS_NS;
    let begun_ns = now_ns();
    let mut pacer = Pacer::new(PASS_NS);
    for pass in 0..passes + AFTER {
        pacer.next();
        // the times in the samples advance evenly, even if the machine stands still: a real gap between two estimates
        // would count as a gap
        let now = begun_ns + pass * PASS_NS;
        estimates.send(&mut estimate(begun_ns, pass + 1, now)).unwrap();
        // estimates first, so that every reading is between two
        if !(20..passes).contains(&pass) {
            continue;
        }
        // the first sensor ends half-way, and one with another type starts
        if pass == passes / 2 {
            ports.remove(0);
            probe = Some(bus.publisher("sensor/probe").unwrap());
        }
        let gone = sent.len() - ports.len();
        for (port, sent) in ports.iter_mut().zip(&mut sent[gone..]) {
            port.send(&mut reading(begun_ns, now)).unwrap();
            *sent += 1;
        }
        if let Some(probe) = &mut probe {
            let mut sample = Probe { header: Header::at(now), temperature_c: 20.0, counts: [1, 2] };
            probe.send(&mut sample).unwrap();
            probes += 1;
        }
    }
    let took_s = (now_ns() - begun_ns) as f64 * 1e-9;
    let (logger_s, recorder_s) = (logger.cpu_s(), recorder.cpu_s());
    assert_eq!((logger.end(), recorder.end()), (Some(0), Some(0)));

    let report = runlog::info(&run).unwrap();
    let lost: u64 = report.channels.iter().map(|channel| channel.lost).sum();
    let (worst_m, all) = farthest_sample_m(&run, &sent);
    println!(
        "{} sensors, {all} readings in {took_s:.1} s ({:.0} per second), {lost} lost; farthest sample {:.3} mm off; sensor-logger {:.1} % of a core, recorder {:.1} %",
        sent.len(),
        all as f64 / took_s,
        1e3 * worst_m,
        100.0 * logger_s / took_s,
        100.0 * recorder_s / took_s
    );
    assert_eq!(lost, 0);
    assert!(worst_m < 1e-3, "{worst_m}");

    let own = runlog::read_channel::<Sample>(&run, "sample/probe").unwrap();
    assert_eq!(own.len() as u64, probes);
    let (_, sample) = own.last().unwrap();
    assert_eq!((sample.count, sample.value[0], text_of(&sample.quantity)), (1, 20.0, "temperature_c".to_owned()));

    flags_are_recorded(&run);

    let maps = runlog::read_channel::<FieldMap>(&run, "map/s1").unwrap();
    let (_, map) = maps.last().expect("a map");
    assert_eq!((text_of(&map.quantity), text_of(&map.unit)), ("place".to_owned(), "m".to_owned()));
    known_cells_show_x(map);
}

/// The first sensor fell silent, and the values of the probe were outside their range.
fn flags_are_recorded(run: &Path) {
    let flags = |channel: &str| runlog::read_channel::<SensorFlag>(run, channel).unwrap();
    let [(_, gap)] = flags("flag/s0")[..] else { panic!("{:?}", flags("flag/s0")) };
    let last_ns = runlog::read_channel::<Reading>(run, "sensor/s0").unwrap().last().unwrap().1.header.oldest_input_ns;
    assert_eq!((gap.kind, gap.begin_ns, gap.end_ns, gap.count), (SensorFlag::KIND_GAP, last_ns, 0, 1));
    let [(_, range)] = flags("flag/probe")[..] else { panic!("{:?}", flags("flag/probe")) };
    assert_eq!((range.kind, range.end_ns, range.size, range.number), (SensorFlag::KIND_RANGE, 0, 5.0, 1));
    assert_eq!(text_of(&range.quantity), "temperature_c");
    assert!(runlog::read_channel::<FieldMap>(run, "map/probe").unwrap().is_empty(), "no value was believable");
    let log = runlog::read_channel::<LogEvent>(run, "system/log/sensor-logger").unwrap();
    let sentence = "sensor/probe: temperature_c: 5.0000 outside the range in the system file; not in the map";
    assert!(log.iter().any(|(_, event)| text_of(&event.text) == sentence), "{log:?}");
}

/// A map of a sensor that measures its position along x.
fn known_cells_show_x(map: &FieldMap) {
    let mut known = 0;
    for row in 0..map.rows as usize {
        for column in 0..map.columns as usize {
            let at = row * map.columns as usize + column;
            if map.value[at].is_nan() {
                continue;
            }
            known += 1;
            let x = map.origin_m[0] + (column as f64 + 0.5) * map.cell_m;
            let error = f64::from(map.value[at]) - x;
            assert!(error.abs() < 4.0 * f64::from(map.sigma[at]) + 0.01, "{error} {}", map.sigma[at]);
        }
    }
    assert!(known >= 3, "{known} cells");
}

/// Name of the logger in the system file.
const PROCESS: &str = "\n[[process]]\nname = \"sensor-logger\"\ncommand = [\"sensor-logger\", \"--system\", \"{system}\"]\nrestart = true\n";

fn samples_in(run: &Path) -> Vec<Sample> {
    runlog::read_channel::<Sample>(run, "sample/soil")
        .unwrap_or_default()
        .into_iter()
        .map(|(_, sample)| sample)
        .collect()
}

#[test]
fn on_a_robot_it_is_a_process_like_the_others() {
    let mut robot = Robot::up(PROCESS);
    robot.ask("motor-io", Request::Arm);
    robot.ask("motor-io", Request::ZeroAt { position_m: [4.8, 3.0, 0.3] });
    robot.until("holding", |robot| robot.last.mode == MotorAuthority::MODE_HOLDING);
    robot.until("the logger", |robot| robot.pid("sensor-logger").is_some());
    robot.accepted(&["plug", "soil", "--", "my-sensor"]);
    let samples = RefCell::new(robot.bus.subscriber::<Sample>("sample/soil").unwrap());
    let maps = RefCell::new(robot.bus.subscriber::<FieldMap>("map/soil").unwrap());
    let seen = Cell::new(0);
    let note = || seen.set(seen.get() + std::iter::from_fn(|| samples.borrow_mut().receive().unwrap()).count());
    robot.until("samples", |_| {
        note();
        seen.get() > 5
    });
    robot.until("a map", |_| maps.borrow_mut().receive().unwrap().is_some_and(|map| map.samples > 0));
    // it dies, restarts, and continues
    robot.signal("sensor-logger", Signal::KILL);
    note();
    let before = seen.get();
    // Counted, because the numbers of the readings go on while it is dead.
    robot.until("samples again", |_| {
        note();
        seen.get() > before + 20
    });
    // the exit code reports a process that died on the way, as a failure
    assert_eq!(robot.down(Signal::INT), Some(1), "{}", robot.printed());
    let samples = samples_in(&robot.run());
    assert!(samples.len() > 20);
    for sample in &samples {
        // at rest, at the position that it was zeroed at
        assert!((sample.position_m[0] - 4.8).abs() < 0.01 && (sample.position_m[1] - 3.0).abs() < 0.01, "{sample:?}");
        assert!(sample.position_std_m.iter().all(|std_m| (1e-4..0.05).contains(std_m)), "{:?}", sample.position_std_m);
    }
}
