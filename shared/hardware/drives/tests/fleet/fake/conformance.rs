//! The suite of every drive family, run for this one.

use drive_conformance::{BOUND, Clockwork, Family, WATCHDOG_MS};
use serial::Pipe;

use super::bus::ANSWER_NS;
use super::{FakeBus, FakeWire};

struct Fake;

fn addresses(count: usize) -> Vec<u8> {
    (1..=count as u8).collect()
}

impl Family for Fake {
    type Units = FakeWire;
    type Bus = FakeBus<Pipe<Clockwork<FakeWire>>>;
    const BAUD: u32 = 1_000_000;
    const MOTORS: usize = 1;
    const ANSWER_NS: u64 = ANSWER_NS;

    fn units(count: usize) -> FakeWire {
        FakeWire::new(&addresses(count))
    }

    fn bus(pipe: Pipe<Clockwork<FakeWire>>, count: usize) -> Self::Bus {
        FakeBus::new(pipe, &addresses(count), WATCHDOG_MS, BOUND).unwrap()
    }

    fn pipe(bus: &mut Self::Bus) -> &mut Pipe<Clockwork<FakeWire>> {
        &mut bus.wire
    }
}

drive_conformance::conformance!(Fake);
