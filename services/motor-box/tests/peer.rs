//! The virtual motor box leaves out stalls of its peer: only those of a living program that wants a processor.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use drives::CountBound;
use motor_box::settings::{PortConfig, UnitConfig};
use motor_box::{BoxConfig, MotorBox};
use plant::PlantConfig;
use plant::line::IdlerConfig;
use roboclaw::driver::USB_MARGIN_NS;
use roboclaw::{Bus, BusConfig, Drive, UnitConfig as DriverUnit};
use rustix::process::{Pid, Signal, kill_process};
use serial::{ReopeningPort, Transport};

const COUNTS_PER_M: f64 = 10_865.0;
const BAUD: u32 = 230_400;
const BOUND: CountBound = CountBound { counts_s: 15_000.0, margin: 0.0 };
const ANCHORS: [[f64; 3]; 3] = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];
const SPEED_M_S: f64 = 0.02;
const WATCHDOG_NS: u64 = 300_000_000;
/// Tells this program that it is the peer, and names the port.
const PEER: &str = "NIMS_TEST_PEER";
/// Tells the peer to close its port after so many milliseconds, and to continue working.
const CLOSE: &str = "NIMS_TEST_CLOSE";

fn motor_box(link: &Path) -> MotorBox {
    let mut plant = PlantConfig::new(ANCHORS.to_vec(), [4.8, 3.0, 1.2]);
    plant.idlers = vec![IdlerConfig { counts_per_m: COUNTS_PER_M, slip: 0.0 }; 3];
    let units = vec![
        UnitConfig { address: 0x80, cables: [Some(0), Some(1)], second_encoder: None },
        UnitConfig { address: 0x81, cables: [Some(2), None], second_encoder: None },
    ];
    let config = BoxConfig {
        plant,
        reversed: vec![false; 3],
        second_reversed: Vec::new(),
        ports: vec![PortConfig {
            link: link.to_owned(),
            family: config::DriveProtocol::Roboclaw,
            wire: config::Wire::Serial,
            torque_constant_n_m_a: None,
            baud: BAUD,
            units,
        }],
        turnaround_ns: 150_000,
        period_ns: 10_000_000,
        devices: Vec::new(),
        ground: plant::ground::Ground::default(),
    };
    MotorBox::new(&config).unwrap()
}

/// A process that ends with the test.
struct Ended(Child);

impl Ended {
    fn start(command: &mut Command) -> Self {
        Self(command.spawn().unwrap())
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.0), signal).unwrap();
    }
}

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// This test program again, as the program that drives the motor box; started by `prefix`, if given.
fn peer(prefix: &[&str], link: &Path, close_ms: Option<u64>) -> Ended {
    let own = std::env::current_exe().unwrap();
    let mut command = match prefix.split_first() {
        Some((first, rest)) => {
            let mut command = Command::new(first);
            command.args(rest).arg(own);
            command
        }
        None => Command::new(own),
    };
    command.args(["--exact", "the_program_that_drives", "--ignored", "--quiet"]).env(PEER, link);
    command.envs(close_ms.map(|ms| (CLOSE, ms.to_string())));
    command.stdout(std::process::Stdio::null());
    Ended::start(&mut command)
}

#[test]
#[ignore = "the other program of the tests here"]
fn the_program_that_drives() {
    let Ok(link) = std::env::var(PEER) else { return };
    let close_ms: Option<u64> = std::env::var(CLOSE).ok().and_then(|text| text.parse().ok());
    let unit = |address| DriverUnit { address, watchdog_tenths: 3, bound: BOUND };
    let units = vec![unit(0x80), unit(0x81)];
    let config = BusConfig { baud: BAUD, margin_ns: USB_MARGIN_NS, units, stop_pin: None };
    let mut bus = Bus::new(ReopeningPort::new(&link, BAUD), &config).unwrap();
    let mut answers = bus.blank_answers();
    let counts = (SPEED_M_S * COUNTS_PER_M) as i32;
    let (began, mut moving) = (Instant::now(), None);
    while close_ms.is_none_or(|ms| moving.is_none_or(|since: Instant| since.elapsed() < Duration::from_millis(ms))) {
        let deadline_ns = bus.transport().now_ns() + 10_000_000;
        // Units move only after a command to stand still.
        let speed = if moving.is_some() { Drive::Speed(counts) } else { Drive::HOLD };
        bus.cycle(&[[speed; 2]; 2], deadline_ns, &mut answers);
        if moving.is_none() && answers.iter().all(|answer| answer.outcome.is_ok()) {
            moving = Some(Instant::now());
        }
        let _ = bus.settle(deadline_ns);
        bus.transport_mut().wait_until(deadline_ns);
        assert!(began.elapsed() < Duration::from_secs(60));
    }
    drop(bus);
    // A port that is closed is closed, however busy the program is.
    while began.elapsed() < Duration::from_secs(60) {
        std::hint::spin_loop();
    }
}

/// Runs for so long, ns of the box's time; returns how far the first cable ran, m.
fn live(motor_box: &mut MotorBox, box_ns: u64) -> f64 {
    let (until_ns, before_m) = (motor_box.machine().now_ns() + box_ns, length_m(motor_box));
    let give_up = Instant::now() + Duration::from_secs(120);
    while motor_box.machine().now_ns() < until_ns {
        motor_box.run_until(motor_box.real_ns() + 10_000_000).unwrap();
        assert!(Instant::now() < give_up, "the box's time stands");
    }
    length_m(motor_box) - before_m
}

fn length_m(motor_box: &MotorBox) -> f64 {
    motor_box.machine().plant().lengths_m().into_iter().next().unwrap()
}

/// Runs until the cables move.
fn until_it_moves(motor_box: &mut MotorBox) {
    let give_up = Instant::now() + Duration::from_secs(60);
    while live(motor_box, 100_000_000) < 0.05 * SPEED_M_S {
        assert!(Instant::now() < give_up, "nothing moves");
    }
}

/// Bound by the units' watchdogs on how far a cable runs without a program: their time, and the drives' lag.
fn stops(motor_box: &mut MotorBox) {
    let ran_m = live(motor_box, 2_000_000_000);
    assert!(ran_m < 2.0 * SPEED_M_S * WATCHDOG_NS as f64 * 1e-9, "ran on for {ran_m} m");
    assert!(live(motor_box, 500_000_000).abs() < 1e-4, "still runs");
}

#[test]
fn a_killed_program_stops_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("drive0");
    let mut motor_box = motor_box(&link);
    let peer = peer(&[], &link, None);
    until_it_moves(&mut motor_box);
    peer.signal(Signal::KILL);
    stops(&mut motor_box);
}

#[test]
fn a_stopped_program_stops_nothing_and_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("drive0");
    let mut motor_box = motor_box(&link);
    let peer = peer(&[], &link, None);
    until_it_moves(&mut motor_box);
    peer.signal(Signal::STOP);
    let before = motor_box.left_out();
    stops(&mut motor_box);
    // The last of its waits may have been seen late.
    assert!(motor_box.left_out().program_ns - before.program_ns < WATCHDOG_NS, "{:?}", motor_box.left_out());
    peer.signal(Signal::CONT);
    until_it_moves(&mut motor_box);
}

#[test]
fn a_closed_port_stops_nothing_however_busy_its_program_is() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("drive0");
    let mut motor_box = motor_box(&link);
    let _peer = peer(&[], &link, Some(1500));
    until_it_moves(&mut motor_box);
    let give_up = Instant::now() + Duration::from_secs(60);
    while live(&mut motor_box, 100_000_000) > 0.01 * SPEED_M_S {
        assert!(Instant::now() < give_up, "the port is not closed");
    }
    let _busy: Vec<Ended> =
        (0..4).map(|_| Ended::start(Command::new("sh").args(["-c", "while :; do :; done"]))).collect();
    let before = motor_box.left_out();
    assert!(live(&mut motor_box, 1_000_000_000).abs() < 1e-4);
    assert_eq!(motor_box.left_out().program_ns, before.program_ns);
}

/// A program that rarely gets the processor drives without any watchdog reaction: the motor box waits for it.
#[test]
fn a_starved_program_is_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("drive0");
    let mut motor_box = motor_box(&link);
    if !Command::new("chrt")
        .args(["--idle", "0", "taskset", "-c", "0", "true"])
        .status()
        .is_ok_and(|ended| ended.success())
    {
        return notes::left_out("the box waits for a starved program", "chrt or taskset is missing or not permitted");
    }
    // A thread of the class that runs only on an idle processor, on one processor ..
    let _peer = peer(&["chrt", "--idle", "0", "taskset", "-c", "0"], &link, None);
    until_it_moves(&mut motor_box);
    // .. with another that never sleeps. It gets some tenths of a percent of the processor, so its motion is short.
    let _busy = Ended::start(Command::new("taskset").args(["-c", "0", "sh", "-c", "while :; do :; done"]));
    let before = motor_box.left_out();
    let began_ns = motor_box.machine().now_ns();
    let (mut ran_m, mut left_out_ns) = (0.0, 0);
    let box_ns = |motor_box: &MotorBox| motor_box.machine().now_ns() - began_ns;
    let give_up = Instant::now() + Duration::from_secs(300);
    while left_out_ns < 2 * WATCHDOG_NS || box_ns(&motor_box) < WATCHDOG_NS {
        assert!(Instant::now() < give_up, "it was starved for {left_out_ns} ns only in {} ns", box_ns(&motor_box));
        ran_m += live(&mut motor_box, 20_000_000);
        left_out_ns = motor_box.left_out().program_ns - before.program_ns;
    }
    let drove_s = box_ns(&motor_box) as f64 * 1e-9;
    assert!(
        ran_m > 0.7 * SPEED_M_S * drove_s,
        "ran {ran_m} m in {drove_s} s of the box's time, {left_out_ns} ns left out"
    );
}
