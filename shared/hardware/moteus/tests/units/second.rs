//! A second encoder that gives no position.

use drives::{Command, CountBound, DriveBus, UnitAnswer};
use moteus::codec::Checksums;
use moteus::driver::USB_MARGIN_NS;
use moteus::unit::{Unit, UnitBus, UnitOptions};
use moteus::{Bus, BusConfig, SecondInput, UnitConfig};
use serial::{Pipe, Transport};

const MS: u64 = 1_000_000;
const BOUND: CountBound = CountBound { counts_s: 1e5, margin: 1e3 };

struct Robot(Bus<Pipe<UnitBus>>);

impl Robot {
    fn new(fails: bool) -> Robot {
        let units = UnitBus::new(vec![Unit::new(UnitOptions::new(1))], Checksums::Absent);
        let unit = UnitConfig {
            address: 1,
            watchdog_ms: 300,
            bound: BOUND,
            torque_constant_n_m_a: 0.0,
            second: Some(SecondInput { source: 1, bound: BOUND }),
        };
        let config = BusConfig {
            baud: 0,
            margin_ns: USB_MARGIN_NS,
            checksums: Checksums::Absent,
            units: vec![unit],
            stop_pin: None,
        };
        let mut robot = Robot(Bus::new(Pipe::new("moteus", 921_600, units), &config).unwrap());
        robot.fail(fails);
        while robot.0.settle(robot.0.transport().now_ns() + 100 * MS).is_err() {}
        robot
    }

    fn fail(&mut self, fails: bool) {
        let unit = &mut self.0.transport_mut().device_mut().units_mut()[0];
        let measured = moteus::unit::Measured { second_fails: fails, ..*unit.measured() };
        unit.measure(&measured);
    }

    fn cycle(&mut self) -> UnitAnswer {
        let now_ns = self.0.transport().now_ns();
        self.0.transport_mut().wait_until(now_ns + 10 * MS);
        let mut answers = self.0.blank_answers();
        self.0.exchange(&[[Some(Command::HOLD), None]], now_ns + 110 * MS, &mut answers);
        answers[0].clone()
    }
}

#[test]
fn one_that_was_never_read_is_refused() {
    let sentence = Robot::new(true).cycle().outcome.unwrap_err().to_string();
    assert!(sentence.contains("source 1"), "{sentence}");
}

#[test]
fn one_that_fails_has_no_new_reading_and_its_unit_stays_in_use() {
    let mut robot = Robot::new(false);
    let read = robot.cycle();
    assert_eq!(read.report.second.counts.at_ns, read.report.counts.at_ns);
    robot.fail(true);
    let failed = robot.cycle();
    assert!(failed.outcome.is_ok(), "{:?}", failed.outcome);
    assert!(failed.report.counts.at_ns > read.report.counts.at_ns);
    assert_eq!(failed.report.second, read.report.second);
    robot.fail(false);
    let back = robot.cycle();
    assert_eq!(back.report.second.counts.at_ns, back.report.counts.at_ns);
    assert_eq!(back.report.second.breaks, read.report.second.breaks, "it continues");
}
