//! Units that show the time, and a bus of them that is driven at the control rate.

use drives::{CountBound, UnitAnswer};
use roboclaw::driver::WIRE_MARGIN_NS;
use roboclaw::unit::{Measured, Target, Unit, UnitBus, UnitOptions};
use roboclaw::{Bus, BusConfig, Drive, UnitConfig};
use serial::{Device, Pipe, Transport, WireQueue};

pub const MS: u64 = 1_000_000;
pub const PERIOD_NS: u64 = 10 * MS;
pub const BUDGET_NS: u64 = 9 * MS;
pub const BAUD: u32 = 230_400;

/// Units whose encoders show the time: motor 1 counts microseconds, motor 2 counts them backwards. So every sample
/// states by itself when it was taken, and a stale one cannot hide.
#[derive(Debug)]
pub struct Clockwork {
    pub bus: UnitBus,
    /// Speeds each unit received, in their order.
    pub told: Vec<Vec<f64>>,
}

impl Clockwork {
    pub fn show(&mut self, now_ns: u64) {
        for (index, unit) in self.bus.units_mut().iter_mut().enumerate() {
            let micros = (now_ns / 1000) as i64;
            let measured = Measured { counts: [micros, -micros], currents_a: [1.5, -0.25], ..*unit.measured() };
            unit.measure(&measured);
            if let Target::Speed(speed) = unit.target(roboclaw::codec::Motor::One)
                && self.told[index].last() != Some(&speed)
            {
                self.told[index].push(speed);
            }
        }
    }
}

impl Device for Clockwork {
    fn receive(&mut self, now_ns: u64, byte: u8, reply: &mut WireQueue) {
        self.bus.receive(now_ns, byte, reply);
        self.show(now_ns);
    }

    fn advance(&mut self, now_ns: u64) {
        self.show(now_ns);
        self.bus.advance(now_ns);
    }
}

pub type TestBus = Bus<Pipe<Clockwork>>;

pub fn unit_config(address: u8) -> UnitConfig {
    // 1 MHz of microseconds is what the clockwork shows.
    let bound = CountBound { counts_s: 3_000_000.0, margin: 0.0 };
    UnitConfig { address, watchdog_tenths: 3, bound }
}

pub fn config(units: Vec<UnitConfig>) -> BusConfig {
    BusConfig { baud: BAUD, margin_ns: WIRE_MARGIN_NS, units, stop_pin: None }
}

pub fn bus_of(options: &[UnitOptions]) -> TestBus {
    let bus = UnitBus::new(options.iter().map(|options| Unit::new(*options)).collect());
    let pipe = Pipe::new("test line", BAUD, Clockwork { bus, told: vec![Vec::new(); options.len()] });
    let units = options.iter().map(|options| unit_config(options.address)).collect();
    Bus::new(pipe, &config(units)).unwrap()
}

pub fn two_units() -> TestBus {
    bus_of(&[UnitOptions::new(0x80), UnitOptions::new(0x81)])
}

pub fn units(bus: &mut TestBus) -> &mut [Unit] {
    bus.transport_mut().device_mut().bus.units_mut()
}

/// A bus being driven at the control rate.
pub struct Run {
    pub bus: TestBus,
    pub answers: Vec<UnitAnswer>,
    pub tick_ns: u64,
}

impl Run {
    pub fn connected(mut bus: TestBus) -> Run {
        let until_ns = bus.transport().now_ns() + 5_000 * MS;
        while bus.settle(until_ns).is_err() {
            assert!(bus.transport().now_ns() < until_ns, "never set up");
        }
        let tick_ns = bus.transport().now_ns().next_multiple_of(PERIOD_NS);
        let answers = bus.blank_answers();
        let mut run = Run { bus, answers, tick_ns };
        run.cycle(Drive::HOLD);
        run
    }

    pub fn cycle(&mut self, drive: Drive) -> &[UnitAnswer] {
        self.bus.transport_mut().wait_until(self.tick_ns);
        let start_ns = self.bus.transport().now_ns();
        let count = self.bus.unit_count();
        self.bus.cycle(&vec![[drive; 2]; count], start_ns + BUDGET_NS, &mut self.answers);
        self.tick_ns = (self.bus.transport().now_ns() + 1).next_multiple_of(PERIOD_NS);
        &self.answers
    }

    /// Cycles until all units are well; how many it took.
    pub fn recover(&mut self) -> usize {
        for cycles in 1..500 {
            if self.cycle(Drive::HOLD).iter().all(|answer| answer.outcome.is_ok()) {
                return cycles;
            }
        }
        panic!("did not recover: {:?}", self.answers);
    }
}

/// How far the clockwork's time in a sample is from the time of the question that the driver states, ns.
pub fn age_ns(answer: &UnitAnswer, zero_us: i64) -> i64 {
    let counts = answer.report.counts;
    assert_eq!(counts.value[0], -counts.value[1], "two motors of one sample disagree");
    (counts.value[0] + zero_us) * 1000 - counts.at_ns as i64
}
