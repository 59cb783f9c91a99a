//! The contract of a drive family, on a wire with a virtual clock.

use drives::{Command, DriveBus, DriveStatus, Error, InvalidConfig, UnitAnswer, UnitReport};
use serial::{Pipe, Transport};

use crate::fake::{FakeBus, FakeUnit, FakeWire};

const MS: u64 = 1_000_000;
const PERIOD_NS: u64 = 10 * MS;
const WATCHDOG_MS: u32 = 300;

struct Rig {
    bus: FakeBus<Pipe<FakeWire>>,
    answers: Vec<UnitAnswer>,
    tick_ns: u64,
}

impl Rig {
    fn new(wire: FakeWire) -> Self {
        let addresses: Vec<u8> = wire.units.iter().map(|unit| unit.address).collect();
        let bus = FakeBus::new(Pipe::new("fake", 1_000_000, wire), &addresses, WATCHDOG_MS).unwrap();
        let blank = UnitAnswer { outcome: Ok(()), report: UnitReport::default() };
        Self { answers: vec![blank; addresses.len()], bus, tick_ns: PERIOD_NS }
    }

    fn settled(addresses: &[u8]) -> Self {
        let mut rig = Self::new(FakeWire::new(addresses));
        rig.cycle(Command::HOLD);
        rig.cycle(Command::HOLD);
        assert!(rig.bus.is_settled() && rig.answers.iter().all(|answer| answer.outcome.is_ok()), "{:?}", rig.answers);
        rig
    }

    fn cycle(&mut self, command: Command) -> &[UnitAnswer] {
        self.bus.wire.wait_until(self.tick_ns);
        let deadline_ns = self.bus.now_ns() + 9 * MS;
        let commands = vec![[Some(command), None]; self.answers.len()];
        self.bus.exchange(&commands, deadline_ns, &mut self.answers);
        self.bus.spend(deadline_ns);
        self.tick_ns = (self.bus.now_ns() + 1).next_multiple_of(PERIOD_NS);
        &self.answers
    }

    fn unit(&mut self, index: usize) -> &mut FakeUnit {
        &mut self.bus.wire.device_mut().units[index]
    }
}

#[test]
fn a_unit_is_in_use_only_with_its_watchdog_set_and_read_back() {
    let mut rig = Rig::new(FakeWire::new(&[1]));
    assert!(matches!(rig.cycle(Command::HOLD)[0].outcome, Err(Error::Preparing { .. })));
    assert_eq!(rig.cycle(Command::HOLD)[0].outcome, Ok(()));
    assert_eq!(rig.bus.unit(0).unwrap().watchdog_ms, Some(WATCHDOG_MS));
    assert_eq!(rig.unit(0).watchdog_ms, WATCHDOG_MS);

    let mut wire = FakeWire::new(&[1]);
    wire.units[0].stubborn_ms = Some(0);
    let mut rig = Rig::new(wire);
    rig.cycle(Command::HOLD);
    let outcome = rig.cycle(Command::HOLD)[0].outcome.clone();
    assert!(matches!(outcome, Err(Error::WatchdogRefused { wanted_ms: 300, got_ms: 0, .. })), "{outcome:?}");
    assert!(!rig.bus.is_settled() && rig.bus.unit(0).unwrap().watchdog_ms.is_none());

    let off = FakeBus::new(Pipe::new("fake", 0, FakeWire::new(&[1])), &[1], 0).unwrap_err();
    assert!(matches!(off, Error::Configuration { what: InvalidConfig::Watchdog { given_ms: 0, .. }, .. }));
}

#[test]
fn motors_stop_by_the_watchdog_when_commands_cease() {
    let mut rig = Rig::settled(&[1]);
    rig.cycle(Command::Velocity(500.0));
    let last_ns = rig.bus.now_ns();
    rig.bus.wire.wait_until(last_ns + 290 * MS);
    assert_eq!(rig.unit(0).turns_s, 0.5);
    rig.bus.wire.wait_until(last_ns + 310 * MS);
    assert_eq!(rig.unit(0).turns_s, 0.0);
    rig.tick_ns = (last_ns + 310 * MS).next_multiple_of(PERIOD_NS);
    // A command clears it, so it shows in a cycle that commands nothing.
    let deadline_ns = rig.tick_ns + 9 * MS;
    rig.bus.wire.wait_until(rig.tick_ns);
    rig.bus.exchange(&[[None; 2]], deadline_ns, &mut rig.answers);
    let status = rig.answers[0].report.status.value;
    assert!(status.has(DriveStatus::ERRORS) && status.to_string() == "watchdog expired", "{status}");
}

#[test]
fn a_lost_unit_delays_the_others_little_and_comes_back() {
    let mut rig = Rig::settled(&[1, 2]);
    rig.unit(0).muted = true;
    let outcomes: Vec<_> = (0..10).map(|_| rig.cycle(Command::HOLD)[0].outcome.clone()).collect();
    assert!(matches!(outcomes[0], Err(Error::NoAnswer { .. })), "{outcomes:?}");
    assert!(outcomes[9].as_ref().is_err_and(Error::is_silence), "{outcomes:?}");
    assert_eq!(rig.answers[1].outcome, Ok(()), "the other unit goes on");
    rig.unit(0).muted = false;
    rig.cycle(Command::HOLD);
    assert_eq!(rig.cycle(Command::HOLD)[0].outcome, Ok(()));
    assert_eq!(rig.answers[0].report.reboots, 0);
}

/// An answer that arrives after its cycle must not count as the answer of a later one.
#[test]
fn a_late_answer_is_never_taken_for_a_fresh_one() {
    let mut rig = Rig::settled(&[1]);
    for late_ns in [3 * MS, 12 * MS, 25 * MS] {
        rig.unit(0).late_ns = late_ns;
        let outcome = rig.cycle(Command::Velocity(1000.0))[0].outcome.clone();
        assert!(matches!(outcome, Err(Error::NoAnswer { .. })), "{outcome:?}");
        rig.unit(0).late_ns = 0;
        let asked_ns = rig.tick_ns;
        for _ in 0..4 {
            let answer = rig.cycle(Command::Velocity(1000.0))[0].clone();
            if answer.outcome.is_ok() {
                assert!(answer.report.counts.at_ns >= asked_ns, "a sample of an earlier cycle");
            }
        }
        assert_eq!(rig.answers[0].outcome, Ok(()));
    }
    assert!(rig.bus.counters().stray_bytes > 0);
}

#[test]
fn a_restart_is_counted_and_interlocked_and_the_counts_go_on() {
    let mut rig = Rig::settled(&[1]);
    for _ in 0..20 {
        rig.cycle(Command::Velocity(1000.0));
    }
    let before = rig.answers[0].report.counts.value[0];
    assert!(before > 100, "{before}");
    rig.unit(0).restart();
    let mut outcomes = Vec::new();
    for _ in 0..5 {
        outcomes.push(rig.cycle(Command::Velocity(1000.0))[0].outcome.clone());
        assert!(rig.answers[0].report.counts.value[0] >= before, "its zero was taken for a motion");
    }
    assert!(matches!(outcomes[4], Err(Error::Interlocked { .. })), "{outcomes:?}");
    assert_eq!(rig.answers[0].report.reboots, 1);
    assert_eq!(rig.unit(0).turns_s, 0.0);
    assert_eq!(rig.cycle(Command::HOLD)[0].outcome, Ok(()));
    assert_eq!(rig.cycle(Command::Velocity(1000.0))[0].outcome, Ok(()));
}

#[test]
fn a_family_can_have_torque_and_one_motor() {
    let mut rig = Rig::settled(&[1]);
    rig.cycle(Command::Torque(1.5));
    assert_eq!(rig.cycle(Command::Torque(1.5))[0].report.currents_a.value, [1.5, 0.0]);
    rig.cycle(Command::Release);
    assert_eq!((rig.unit(0).amperes, rig.unit(0).turns_s), (0.0, 0.0));
    let deadline_ns = rig.bus.now_ns() + 9 * MS;
    rig.bus.exchange(&[[Some(Command::HOLD); 2]], deadline_ns, &mut rig.answers);
    assert!(matches!(rig.answers[0].outcome, Err(Error::Unsupported { what: "second motor", .. })));
}

#[test]
fn nothing_is_sent_after_the_deadline_or_without_the_device() {
    let mut rig = Rig::settled(&[1]);
    let sent = rig.bus.counters().exchanges;
    let now_ns = rig.bus.now_ns();
    rig.bus.exchange(&[[Some(Command::HOLD), None]], now_ns, &mut rig.answers);
    assert!(matches!(rig.answers[0].outcome, Err(Error::TooLate { .. })));
    assert_eq!(rig.bus.counters().exchanges, sent);
    rig.bus.wire.unplug();
    assert!(rig.cycle(Command::Velocity(9.0))[0].outcome.as_ref().is_err_and(Error::is_lost));
    rig.bus.wire.plug();
    rig.cycle(Command::Velocity(9.0));
    assert!(matches!(rig.cycle(Command::Velocity(9.0))[0].outcome, Err(Error::Interlocked { .. })));
}
