//! The single port of a fleet, whose bus the caller has while its units are in use.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::ThreadId;

use drives::{
    Capabilities, Command, Counters, DriveBus, Error, Fleet, FleetCommand, StopInput, UnitAnswer, UnitCommand, UnitInfo,
};
use serial::{PortClock, ReopeningPort, Transport, monotonic_ns, sleep_until};

const MS: u64 = 1_000_000;

/// What a bus was called for, and by which thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Call {
    Exchange,
    Spend,
    Settle,
    Inline(bool),
}

/// The part of a [`Scripted`] bus that the test keeps.
#[derive(Debug, Default)]
struct Script {
    calls: Mutex<Vec<(ThreadId, Call)>>,
    /// The next exchange leaves an answer.
    leaves: AtomicBool,
    /// The next exchange finds the device gone.
    loses: AtomicBool,
    /// Exchanges and settles do not return.
    hangs: AtomicBool,
    /// What follows the exchange that finds the device gone does not return.
    closing_hangs: AtomicBool,
    /// What is left after a settle, so many times.
    unsettled: AtomicU64,
    counts: AtomicU64,
}

impl Script {
    fn called(&self, call: Call) {
        self.calls.lock().unwrap_or_else(PoisonError::into_inner).push((std::thread::current().id(), call));
    }

    fn hang(&self) {
        while self.hangs.load(Ordering::SeqCst) {
            sleep_until(monotonic_ns() + MS / 10);
        }
    }

    fn take_calls(&self) -> Vec<(ThreadId, Call)> {
        std::mem::take(&mut self.calls.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// A bus with one unit that does what its script says, at once.
struct Scripted {
    port: Arc<str>,
    script: Arc<Script>,
    can_run_inline: bool,
    clock: Option<Arc<PortClock>>,
}

impl DriveBus for Scripted {
    fn port(&self) -> &Arc<str> {
        &self.port
    }
    fn unit_count(&self) -> usize {
        1
    }
    fn capabilities(&self) -> Capabilities {
        Capabilities::NONE
    }
    fn unit(&self, unit: usize) -> Option<UnitInfo> {
        (unit == 0).then(|| UnitInfo { name: "unit".into(), firmware: None, watchdog_ms: None })
    }
    fn now_ns(&self) -> u64 {
        monotonic_ns()
    }
    fn clock(&self) -> Option<Arc<PortClock>> {
        self.clock.clone()
    }
    fn can_run_inline(&self) -> bool {
        self.can_run_inline
    }
    fn set_inline(&mut self, inline: bool) {
        self.script.called(Call::Inline(inline));
    }
    fn exchange(&mut self, _: &[UnitCommand], _: u64, answers: &mut [UnitAnswer]) {
        self.script.called(Call::Exchange);
        self.script.hang();
        let port = Arc::clone(&self.port);
        let outcome = if self.script.loses.swap(false, Ordering::SeqCst) {
            self.script.hangs.store(self.script.closing_hangs.load(Ordering::SeqCst), Ordering::SeqCst);
            self.script.unsettled.store(3, Ordering::SeqCst);
            Err(Error::Serial(serial::Error::Missing { port }))
        } else if self.script.leaves.swap(false, Ordering::SeqCst) {
            self.script.unsettled.store(3, Ordering::SeqCst);
            Err(Error::Unanswered { port })
        } else if self.is_settled() {
            self.script.counts.fetch_add(1, Ordering::SeqCst);
            Ok(())
        } else {
            Err(Error::Resynchronising { port })
        };
        answers[0].outcome = outcome;
        answers[0].report.counts.value[0] = self.script.counts.load(Ordering::SeqCst).cast_signed();
    }
    fn spend(&mut self, _: u64) {
        self.script.called(Call::Spend);
    }
    fn settle(&mut self, _: u64) -> Result<(), Error> {
        self.script.called(Call::Settle);
        self.script.hang();
        let left = self.script.unsettled.load(Ordering::SeqCst);
        self.script.unsettled.store(left.saturating_sub(1), Ordering::SeqCst);
        if left <= 1 { Ok(()) } else { Err(Error::Resynchronising { port: Arc::clone(&self.port) }) }
    }
    fn is_settled(&self) -> bool {
        self.script.unsettled.load(Ordering::SeqCst) == 0
    }
    fn stop(&self) -> &StopInput {
        &StopInput::Unknown
    }
    fn counters(&self) -> Counters {
        Counters::default()
    }
}

fn scripted(port: &str, can_run_inline: bool) -> (Scripted, Arc<Script>) {
    let script = Arc::new(Script { unsettled: AtomicU64::new(3), ..Script::default() });
    let bus = Scripted { port: port.into(), script: Arc::clone(&script), can_run_inline, clock: None };
    (bus, script)
}

/// A cycle of a caller that spends the time of its port; the outcome of the first unit and its counts.
fn cycle(fleet: &mut Fleet) -> (Result<(), Error>, i64) {
    let command = FleetCommand { cycle: 1, units: [[Some(Command::HOLD), None]; 8] };
    let reply = fleet.exchange(&command, monotonic_ns() + 400 * MS);
    let seen = (reply.units[0].outcome.clone(), reply.units[0].report.counts.value[0]);
    fleet.spend(0);
    seen
}

/// Cycles until the caller has the bus; the number of cycles is bounded, not the time.
fn until_inline(fleet: &mut Fleet, script: &Script, counts: &mut i64) {
    for _ in 0..2000 {
        sleep_until(monotonic_ns() + MS);
        script.take_calls();
        let now = cycle(fleet).1;
        assert!(now >= *counts, "the counts went back from {counts} to {now}");
        *counts = now;
        let calls = script.take_calls();
        if calls.contains(&(std::thread::current().id(), Call::Exchange)) {
            assert!(calls.contains(&(std::thread::current().id(), Call::Spend)), "{calls:?}");
            return;
        }
    }
    panic!("the caller never had the bus");
}

/// Cycles until the unit is in use; their number is bounded.
fn until_in_use(fleet: &mut Fleet) {
    let in_use = |_: u32| {
        sleep_until(monotonic_ns() + MS);
        cycle(fleet).0.is_ok()
    };
    assert!((0..2000).any(in_use), "the unit is never in use");
}

#[test]
fn the_caller_has_the_bus_of_a_single_port_while_its_units_are_in_use() {
    let (bus, script) = scripted("a", true);
    let mut fleet = Fleet::open(vec![bus], Capabilities::NONE).unwrap();
    let (own, mut counts) = (std::thread::current().id(), 0);
    until_inline(&mut fleet, &script, &mut counts);
    for _ in 0..100 {
        let (outcome, now) = cycle(&mut fleet);
        assert_eq!((outcome, now), (Ok(()), counts + 1));
        counts = now;
    }
    let calls = script.take_calls();
    assert!(calls.iter().all(|(thread, _)| *thread == own), "{calls:?}");
    assert_eq!(calls.len(), 200, "an exchange and a spend for each cycle");
}

/// Where something has to be waited for, opened or closed, the port's thread does it.
#[test]
fn a_bus_that_is_not_settled_goes_back_to_its_thread_and_comes_again() {
    let (bus, script) = scripted("a", true);
    let mut fleet = Fleet::open(vec![bus], Capabilities::NONE).unwrap();
    let (own, mut counts) = (std::thread::current().id(), 0);
    for round in 0..20 {
        until_inline(&mut fleet, &script, &mut counts);
        let lost = round % 2 == 0;
        if lost { &script.loses } else { &script.leaves }.store(true, Ordering::SeqCst);
        script.take_calls();
        let (outcome, now) = cycle(&mut fleet);
        assert_eq!((outcome.as_ref().is_err_and(Error::is_lost), now), (lost, counts), "{outcome:?}");
        assert!(outcome.is_err());
        // The caller does nothing with it in this cycle any more, and until the thread has settled it.
        let mut calls = script.take_calls();
        while !calls.iter().any(|(_, call)| *call == Call::Settle) {
            sleep_until(monotonic_ns() + MS / 10);
            calls.extend(script.take_calls());
        }
        let at = calls.iter().position(|(_, call)| *call == Call::Exchange).unwrap();
        let after: Vec<_> = calls[at + 1..].iter().filter(|(thread, _)| *thread == own).collect();
        assert!(after.is_empty(), "{after:?}");
        let left = calls.iter().find(|(_, call)| *call == Call::Inline(false));
        assert!(left.is_some_and(|(thread, _)| *thread != own), "{calls:?}");
    }
}

/// Outcomes of cycles of two milliseconds while the port's thread does not return, after what `then` does.
fn while_it_hangs(fleet: &mut Fleet, script: &Script, then: impl FnOnce()) -> Vec<(Result<(), Error>, Option<Error>)> {
    script.hangs.store(true, Ordering::SeqCst);
    let mut cycle = || {
        let command = FleetCommand { cycle: 1, units: [[Some(Command::HOLD), None]; 8] };
        let reply = fleet.exchange(&command, monotonic_ns() + 2 * MS);
        let seen = (reply.units[0].outcome.clone(), reply.ports[0].lost.clone());
        fleet.spend(0);
        seen
    };
    let mut seen = vec![cycle()];
    then();
    seen.extend((0..20).map(|_| cycle()));
    // Before anything is judged: the end of a fleet waits for its threads.
    script.hangs.store(false, Ordering::SeqCst);
    seen
}

fn is_lost((outcome, lost): &(Result<(), Error>, Option<Error>)) -> bool {
    outcome.as_ref().is_err_and(Error::is_lost) && lost.is_some()
}

/// A system may take its time to close a device that is gone.
#[test]
fn a_device_that_is_gone_stays_lost_while_its_thread_closes_it() {
    for can_run_inline in [true, false] {
        let (bus, script) = scripted("a", can_run_inline);
        let mut fleet = Fleet::open(vec![bus], Capabilities::NONE).unwrap();
        until_in_use(&mut fleet);
        script.closing_hangs.store(true, Ordering::SeqCst);
        script.loses.store(true, Ordering::SeqCst);
        assert!(cycle(&mut fleet).0.is_err_and(|error| error.is_lost()));
        let seen = while_it_hangs(&mut fleet, &script, || ());
        assert!(seen.iter().all(is_lost), "{seen:?}");
        until_in_use(&mut fleet);
    }
}

/// The port's thread does not return from the system, and cannot say that its device is gone.
#[test]
fn a_port_that_hangs_is_lost_once_its_device_is_gone() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("drive");
    std::fs::write(&link, "").unwrap();
    let port = link.to_str().unwrap();
    let (mut bus, script) = scripted(port, false);
    bus.clock = ReopeningPort::new(port, 0).clock();
    let mut fleet = Fleet::open(vec![bus], Capabilities::NONE).unwrap();
    until_in_use(&mut fleet);
    let seen = while_it_hangs(&mut fleet, &script, || std::fs::remove_file(&link).unwrap());
    assert!(!is_lost(&seen[0]) && seen[1..].iter().all(is_lost), "{seen:?}");
}

#[test]
fn several_ports_and_one_that_cannot_run_inline_keep_their_threads() {
    let own = std::thread::current().id();
    for ports in [vec![("a", true), ("b", true)], vec![("a", false)]] {
        let (buses, scripts): (Vec<_>, Vec<_>) = ports.into_iter().map(|(port, inline)| scripted(port, inline)).unzip();
        let mut fleet = Fleet::open(buses, Capabilities::NONE).unwrap();
        for _ in 0..50 {
            let _ = cycle(&mut fleet);
            sleep_until(monotonic_ns() + MS / 10);
        }
        for calls in scripts.iter().map(|script| script.take_calls()) {
            assert!(calls.iter().any(|(_, call)| *call == Call::Exchange));
            assert!(calls.iter().all(|(thread, _)| *thread != own), "{calls:?}");
        }
    }
}
