//! What this family has beyond the suite: torque, one motor per unit, and a bound of its counts.

use drive_conformance::VirtualUnits;
use drives::{Command, CountBound, DriveBus, Error, InvalidConfig, UnitAnswer, UnitReport};
use serial::{Pipe, Transport};

use super::{FakeBus, FakeWire};

const MS: u64 = 1_000_000;

fn settled(bound: CountBound) -> (FakeBus<Pipe<FakeWire>>, Vec<UnitAnswer>) {
    let mut bus = FakeBus::new(Pipe::new("fake", 1_000_000, FakeWire::new(&[1])), &[1], 300, bound).unwrap();
    while bus.settle(bus.now_ns() + 9 * MS).is_err() {}
    (bus, vec![UnitAnswer { outcome: Ok(()), report: UnitReport::default() }])
}

fn exchange(bus: &mut FakeBus<Pipe<FakeWire>>, command: [Option<Command>; 2], answers: &mut [UnitAnswer]) {
    let deadline_ns = bus.now_ns() + 9 * MS;
    bus.exchange(&[command], deadline_ns, answers);
}

#[test]
fn there_is_no_second_motor_and_no_watchdog_of_no_time() {
    let (mut bus, mut answers) = settled(CountBound::NONE);
    exchange(&mut bus, [Some(Command::HOLD); 2], &mut answers);
    assert!(matches!(answers[0].outcome, Err(Error::Unsupported { what: "second motor", .. })));
    let off = FakeBus::new(Pipe::new("fake", 0, FakeWire::new(&[1])), &[1], 0, CountBound::NONE).unwrap_err();
    assert!(matches!(off, Error::Configuration { what: InvalidConfig::Watchdog { given_ms: 0, .. }, .. }));
}

#[test]
fn a_count_beyond_the_bound_is_held_back_once_and_counted_where_it_stays() {
    let (mut bus, mut answers) = settled(CountBound { counts_s: 1000.0, margin: 5.0 });
    exchange(&mut bus, [Some(Command::HOLD), None], &mut answers);
    bus.wire.device_mut().measure(0, [1_000_000, 0], [0.0; 2]);
    bus.wire.wait_until(bus.now_ns() + 10 * MS);
    exchange(&mut bus, [Some(Command::HOLD), None], &mut answers);
    assert!(matches!(answers[0].outcome, Err(Error::EncoderJump { axis: 0, counts: 1_000_000, .. })), "{answers:?}");
    assert_eq!((answers[0].report.counts.value[0], answers[0].report.jumps), (0, 0));
    exchange(&mut bus, [Some(Command::HOLD), None], &mut answers);
    assert_eq!(answers[0].outcome, Ok(()));
    assert_eq!((answers[0].report.counts.value[0], answers[0].report.jumps), (1_000_000, 1));
}
