//! The fleet: threads, deadlines and the checks when it opens.

use std::sync::Arc;
use std::time::{Duration, Instant};

use drive_conformance::VirtualUnits;
use drives::{Capabilities, Command, CountBound, DriveBus, Error, Fleet, FleetCommand, FleetReply, InvalidConfig};
use serial::{Device, Pipe, WireQueue, monotonic_ns};

use crate::fake::{FakeBus, FakeWire};

const MS: u64 = 1_000_000;

fn bus(name: &str, addresses: &[u8]) -> FakeBus<Pipe<FakeWire>> {
    FakeBus::new(Pipe::new(name, 0, FakeWire::new(addresses)), addresses, 300, CountBound::NONE).unwrap()
}

/// Cycles until a reply is as wanted; the number of cycles is bounded, not the time.
fn until(fleet: &mut Fleet, command: Command, wanted: impl Fn(&FleetReply) -> bool) -> FleetReply {
    for cycle in 1..2000 {
        let command = FleetCommand { cycle, units: [[Some(command), None]; 8] };
        let reply = fleet.exchange(&command, monotonic_ns() + 400 * MS);
        assert_eq!(reply.cycle, cycle);
        if wanted(reply) {
            return reply.clone();
        }
        fleet.spend(0);
    }
    panic!("never as wanted");
}

#[test]
fn ports_of_different_kinds_run_side_by_side() {
    // As a program has them that chooses the family at run time.
    let mut silent = bus("b", &[1]);
    silent.wire.device_mut().mute(0, true);
    let buses: Vec<Box<dyn DriveBus>> = vec![Box::new(bus("a", &[1, 2])), Box::new(silent)];
    let mut fleet = Fleet::open(buses, Capabilities { velocity: true, ..Capabilities::NONE }).unwrap();
    assert_eq!(
        (fleet.unit_count(), [0, 1, 2, 3].map(|unit| fleet.port_of(unit))),
        (3, [Some(0), Some(0), Some(1), None])
    );
    let reply = until(&mut fleet, Command::HOLD, |reply| {
        reply.units[..2].iter().all(|unit| unit.outcome.is_ok())
            && reply.units[2].outcome.as_ref().is_err_and(Error::is_silence)
    });
    assert_eq!(reply.ports[0].counters.timeouts, 0);
    assert!(reply.ports[1].counters.timeouts > 0);
    let units = fleet.units();
    let known: Vec<_> = units.iter().map(|unit| (&*unit.name, unit.watchdog_ms)).collect();
    assert_eq!(known, [("drive 1", Some(300)), ("drive 2", Some(300)), ("drive 1", None)]);
}

/// Takes its time over every byte.
struct Slow;

impl Device for Slow {
    fn receive(&mut self, _now_ns: u64, _byte: u8, _reply: &mut WireQueue) {
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_port_that_hangs_is_not_waited_for() {
    let slow = FakeBus::new(Pipe::new("slow", 0, Slow), &[1], 300, CountBound::NONE).unwrap();
    let mut fleet = Fleet::open(vec![slow], Capabilities::NONE).unwrap();
    let began = Instant::now();
    for cycle in 1..10 {
        let command = FleetCommand { cycle, units: [[Some(Command::HOLD), None]; 8] };
        let reply = fleet.exchange(&command, monotonic_ns() + 2 * MS);
        assert!(reply.units[0].outcome.is_err(), "{reply:?}");
    }
    drop(fleet);
    println!("{:?} for nine cycles and the end", began.elapsed());
}

#[test]
fn a_fleet_that_cannot_serve_its_caller_is_refused() {
    let wrong = |what| Error::Configuration { port: Arc::from("a"), what };
    let refuse = |buses, needed| Fleet::open(buses, needed).map(|_| ()).unwrap_err();
    let needed = Capabilities { velocity: true, watchdog: true, ..Capabilities::NONE };
    assert_eq!(refuse(vec![bus("a", &[1]), bus("a", &[1])], needed), wrong(InvalidConfig::PortTwice));
    assert_eq!(
        refuse(vec![bus("a", &[1, 2, 3, 4, 5]), bus("b", &[1, 2, 3, 4])], needed),
        wrong(InvalidConfig::TooManyUnits)
    );
    let mut open_loop = bus("a", &[1]);
    open_loop.offers.velocity = false;
    assert_eq!(refuse(vec![open_loop], needed), wrong(InvalidConfig::Lacks("closed-loop velocity")));
    let mut unguarded = bus("a", &[1]);
    unguarded.offers.watchdog = false;
    assert_eq!(refuse(vec![unguarded], needed), wrong(InvalidConfig::Lacks("a watchdog")));
}
