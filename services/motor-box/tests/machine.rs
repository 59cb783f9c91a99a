//! The machine in simulated time, driven by the driver that the robot uses.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use drives::{CountBound, UnitAnswer};
use motor_box::settings::{PortConfig, UnitConfig};
use motor_box::{BoxConfig, BoxFault, Machine, Shared, Socket};
use plant::line::IdlerConfig;
use plant::{Fault, PlantConfig};
use roboclaw::driver::WIRE_MARGIN_NS;
use roboclaw::{Bus, BusConfig, Drive, UnitConfig as DriverUnit};
use serial::Pipe;

const COUNTS_PER_M: f64 = 10_865.0;
const BAUD: u32 = 230_400;
const PERIOD_NS: u64 = 10_000_000;
const BOUND: CountBound = CountBound { counts_s: 15_000.0, margin: 0.0 };
const ANCHORS: [[f64; 3]; 3] = [[0.0, 0.0, 3.05], [9.8, 0.0, 3.10], [4.7, 8.6, 2.98]];

/// Three cables: two on the unit at 0x80, one on the second motor of the unit at 0x81; the last encoder counts
/// backwards.
fn config() -> BoxConfig {
    let mut plant = PlantConfig::new(ANCHORS.to_vec(), [4.8, 3.0, 0.8]);
    plant.idlers = vec![IdlerConfig { counts_per_m: COUNTS_PER_M, slip: 0.0 }; 3];
    BoxConfig {
        plant,
        reversed: vec![false, false, true],
        second_reversed: Vec::new(),
        ports: vec![PortConfig {
            link: "unused".into(),
            family: config::DriveProtocol::Roboclaw,
            wire: config::Wire::Serial,
            torque_constant_n_m_a: None,
            baud: BAUD,
            units: vec![
                UnitConfig { address: 0x80, cables: [Some(0), Some(1)], second_encoder: None },
                UnitConfig { address: 0x81, cables: [None, Some(2)], second_encoder: None },
            ],
        }],
        turnaround_ns: 150_000,
        period_ns: 10_000_000,
        devices: Vec::new(),
        ground: plant::ground::Ground::default(),
    }
}

struct Rig {
    machine: Shared,
    bus: Bus<Pipe<Socket>>,
    answers: Vec<UnitAnswer>,
    next_ns: u64,
}

impl Rig {
    /// A machine with a driver that is in step with it.
    fn new() -> Self {
        let machine = Shared::new(Machine::new(&config()).unwrap());
        let pipe = Pipe::new("box", BAUD, machine.socket(0));
        let unit = |address| DriverUnit { address, watchdog_tenths: 3, bound: BOUND };
        let units = vec![unit(0x80), unit(0x81)];
        let config = BusConfig { baud: BAUD, margin_ns: WIRE_MARGIN_NS, units, stop_pin: None };
        let bus = Bus::new(pipe, &config).unwrap();
        let answers = bus.blank_answers();
        let mut rig = Self { machine, bus, answers, next_ns: PERIOD_NS };
        for _ in 0..40 {
            rig.cycle([0; 3]);
        }
        assert!(rig.answers.iter().all(|answer| answer.outcome.is_ok()), "{:?}", rig.answers);
        rig
    }

    /// One control cycle with these speeds on the wire, counts per second.
    fn cycle(&mut self, speeds: [i32; 3]) {
        use serial::Transport;
        self.bus.transport_mut().wait_until(self.next_ns);
        self.next_ns += PERIOD_NS;
        let drives = [[Drive::Speed(speeds[0]), Drive::Speed(speeds[1])], [Drive::Idle, Drive::Speed(speeds[2])]];
        self.bus.cycle(&drives, self.next_ns, &mut self.answers);
    }

    fn counts(&self) -> [i64; 3] {
        let (first, second) = (self.answers[0].report.counts.value, self.answers[1].report.counts.value);
        [first[0], first[1], second[1]]
    }

    fn lengths_m(&self) -> Vec<f64> {
        self.machine.lock().plant().lengths_m()
    }
}

#[test]
fn what_the_driver_asks_for_is_what_the_cables_do() {
    let mut rig = Rig::new();
    let (lengths, counts) = (rig.lengths_m(), rig.counts());
    // 3 cm/s out on the first two; the third encoder counts backwards, so the same number winds it in.
    for _ in 0..100 {
        rig.cycle([326, 326, 326]);
    }
    for _ in 0..50 {
        rig.cycle([0; 3]);
    }
    assert!(rig.answers.iter().all(|answer| answer.outcome.is_ok()));
    for (cable, sign) in [(0, 1.0), (1, 1.0), (2, -1.0)] {
        let truth_m = rig.lengths_m()[cable] - lengths[cable];
        let seen_m = (rig.counts()[cable] - counts[cable]) as f64 / COUNTS_PER_M * sign;
        assert!((truth_m - 0.03 * sign).abs() < 0.001, "cable {cable} moved by {truth_m} m");
        assert!((truth_m - seen_m).abs() < 3.0 / COUNTS_PER_M, "cable {cable}: {truth_m} m, seen {seen_m} m");
    }
    // Holding causes a current: against the count of the first two.
    let report = &rig.answers[0].report;
    assert!(report.currents_a.value.iter().all(|&current| current < -0.05), "{:?}", report.currents_a);
    assert!((report.supply_v.value - 24.0).abs() < 0.5 && report.temperature_c.value > 20.0);
}

#[test]
fn a_driver_that_falls_silent_is_found_out_by_the_watchdog() {
    use serial::Transport;
    let mut rig = Rig::new();
    for _ in 0..50 {
        rig.cycle([500, 0, 0]);
    }
    let before = rig.lengths_m()[0];
    rig.bus.transport_mut().wait_until(rig.next_ns + 2_000_000_000);
    let after = rig.lengths_m()[0];
    let machine = rig.machine.lock();
    assert_eq!(machine.units(0)[0].watchdog_trips(), 1);
    // 0.3 s at 46 mm/s, and what the motor needs to stop.
    assert!((0.3 * 500.0 / COUNTS_PER_M..0.023).contains(&(after - before)), "{}", after - before);
    assert_eq!(machine.plant().line_speeds_m_s()[0], 0.0);
}

#[test]
fn faults_are_seen_by_the_driver() {
    let mut rig = Rig::new();
    rig.machine.lock().apply(BoxFault::Reboot { port: 0, address: 0x81, for_s: 0.2 }).unwrap();
    for _ in 0..150 {
        rig.cycle([0; 3]);
    }
    assert_eq!(rig.answers[1].report.reboots, 1, "{:?}", rig.answers[1].outcome);
    assert_eq!(rig.answers[0].report.reboots, 0);

    rig.machine.lock().apply(BoxFault::Plant(Fault::Stall { cable: 0, on: true })).unwrap();
    for _ in 0..100 {
        rig.cycle([-600, 0, 0]);
    }
    let report = &rig.answers[0].report;
    assert!(report.duties.value[0] < -0.6, "{:?}", report.duties);
    assert!(report.currents_a.value[0] < -10.0, "{:?}", report.currents_a);
    rig.machine.lock().apply(BoxFault::Plant(Fault::Supply { voltage_v: 9.0 })).unwrap();
    for _ in 0..50 {
        rig.cycle([0; 3]);
    }
    assert!(rig.answers[0].report.supply_v.value <= 9.0);
    assert!(rig.machine.lock().apply(BoxFault::Reboot { port: 0, address: 0x85, for_s: 0.1 }).is_err());
}

#[test]
fn the_same_bytes_at_the_same_times_give_the_same_machine() {
    let fly = || {
        let mut rig = Rig::new();
        for k in 0..200 {
            rig.cycle([k % 37 * 10, -(k % 23) * 7, k % 11 * 13]);
        }
        let bits: Vec<u64> = rig.lengths_m().iter().map(|length| length.to_bits()).collect();
        (bits, rig.counts(), rig.machine.lock().plant().position_m().map(f64::to_bits))
    };
    assert_eq!(fly(), fly());
}
