//! Several ports at once: one thread each, all starting a cycle together.
//!
//! Each port is owned by its thread, so a port that is slow, silent or unplugged delays no other and recovers on its
//! own. A single port has a thread too: a missing answer is waited for up to 12 ms on a native port and 25 ms on USB,
//! longer than a cycle lasts, and neither the end of the cycle nor the next request may wait for that. The threads
//! inherit scheduling policy, priority and processors of the thread that opens the fleet.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use serial::{PortClock, monotonic_ns};

use crate::bus::{Capabilities, DriveBus, UnitCommand};
use crate::error::{Error, InvalidConfig};
use crate::report::{Counters, StopInput, UnitAnswer, UnitInfo, UnitReport};

/// Most units of a fleet: one for each of the most cables.
pub const MAX_FLEET: usize = 8;

/// Waking up this long after the deadline means that the whole machine was stopped, and the answers with it, ns.
const STOOD_STILL_NS: u64 = 5_000_000;
/// Extra wait for the answers in that case, ns.
const GRACE_NS: u64 = 10_000_000;
/// Step in which simulated units that wait for a processor are waited for, ns.
const SIMULATED_STEP_NS: u64 = 2_000_000;
/// Longest such wait, ns: a program has to notice a request to stop.
const SIMULATED_PATIENCE_NS: u64 = 1_000_000_000;

/// Sleep of a thread that has nothing to do; only an order ends it earlier.
const IDLE: Duration = Duration::from_millis(500);
/// Sleep between two steps of getting a port or unit back: none, because a step that can do nothing pauses by itself.
const BUSY: Duration = Duration::ZERO;
/// Sleep between two attempts to find a lost device.
const LOST: Duration = Duration::from_millis(20);
/// Time for one step between two cycles, ns: a question and its answer at the baud in use.
const STEP_NS: u64 = 5_000_000;

/// Commands of one cycle for all units, in the order of the ports and of the units on each.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FleetCommand {
    /// Number of the cycle; returned with the answer.
    pub cycle: u64,
    /// Commands of each unit.
    pub units: [UnitCommand; MAX_FLEET],
}

/// State of a port.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PortReport {
    /// Event counts.
    pub counters: Counters,
    /// Reason why the device is not there; `None` while it is.
    pub lost: Option<Error>,
    /// Its stop input.
    pub stop: StopInput,
    /// Time that commands and counts took in this cycle, ns.
    pub took_ns: u64,
}

/// Result of one cycle.
#[derive(Debug, Clone, PartialEq)]
pub struct FleetReply {
    /// Number of the cycle.
    pub cycle: u64,
    /// Answer of each unit; the outcome is an error where it has none in this cycle.
    pub units: Vec<UnitAnswer>,
    /// State of each port.
    pub ports: Vec<PortReport>,
}

/// Several ports, each with its thread. They may be of different families.
#[derive(Debug)]
pub struct Fleet {
    board: Arc<Board>,
    threads: Vec<JoinHandle<()>>,
    names: Vec<Arc<str>>,
    /// Port of each unit.
    port_of_unit: Vec<usize>,
    /// Clock of each port that is simulated: the time that it leaves out.
    clocks: Vec<Option<Arc<PortClock>>>,
    turn: u64,
    reply: FleetReply,
}

/// Exchange of orders and answers between the caller and the threads.
#[derive(Debug)]
struct Board {
    slots: Mutex<Vec<Slot>>,
    posted: Condvar,
    answered: Condvar,
}

#[derive(Debug)]
struct Slot {
    stop: bool,
    order: Option<Order>,
    /// The order that `answers` belong to.
    answered_turn: u64,
    answers: Vec<UnitAnswer>,
    units: Vec<UnitInfo>,
    report: PortReport,
    /// The port is resynchronising, or a unit is not in use: the reason where the thread misses its deadline.
    settling: bool,
}

#[derive(Debug, Clone, Copy)]
struct Order {
    turn: u64,
    deadline_ns: u64,
    /// From the order to the deadline.
    span_ns: u64,
    units: [UnitCommand; MAX_FLEET],
}

impl Slot {
    fn record<B: DriveBus>(&mut self, bus: &B, lost: Option<Error>) {
        self.report.lost = lost;
        self.settling = !bus.is_settled();
        self.report.counters = bus.counters();
        self.report.stop.clone_from(bus.stop());
        for (index, place) in self.units.iter_mut().enumerate() {
            if let Some(unit) = bus.unit(index) {
                *place = unit;
            }
        }
    }
}

impl Board {
    fn slots(&self) -> MutexGuard<'_, Vec<Slot>> {
        // A thread that panicked has left whole values here: they are only ever replaced.
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Places for the answers of a bus.
fn blank_answers<B: DriveBus>(bus: &B) -> Vec<UnitAnswer> {
    let outcome = || Err(Error::Resynchronising { port: Arc::clone(bus.port()) });
    (0..bus.unit_count()).map(|_| UnitAnswer { outcome: outcome(), report: UnitReport::default() }).collect()
}

impl Fleet {
    /// Starts a thread for each bus, which looks for its device and sets up its units. Returns at once; a device that
    /// is not there is an error of the exchanges until it is.
    ///
    /// Deadlines of the fleet are on the monotonic clock. A bus with a clock of its own gets what is left of them.
    ///
    /// # Errors
    /// A bus lacks something `needed`, a name occurs twice, there are too many units, or the system starts no thread.
    pub fn open<B: DriveBus + 'static>(buses: Vec<B>, needed: Capabilities) -> Result<Fleet, Error> {
        let names: Vec<Arc<str>> = buses.iter().map(|bus| Arc::clone(bus.port())).collect();
        let wrong = |port: &Arc<str>, what| Err(Error::Configuration { port: Arc::clone(port), what });
        for (index, (name, bus)) in names.iter().zip(&buses).enumerate() {
            if names[..index].contains(name) {
                return wrong(name, InvalidConfig::PortTwice);
            }
            if let Some(missing) = bus.capabilities().first_missing(needed) {
                return wrong(name, InvalidConfig::Lacks(missing));
            }
        }
        let port_of_unit: Vec<usize> =
            buses.iter().enumerate().flat_map(|(port, bus)| std::iter::repeat_n(port, bus.unit_count())).collect();
        if port_of_unit.len() > MAX_FLEET {
            return wrong(&names[0], InvalidConfig::TooManyUnits);
        }
        let slot = |bus: &B| Slot {
            stop: false,
            order: None,
            answered_turn: 0,
            answers: blank_answers(bus),
            units: (0..bus.unit_count()).filter_map(|unit| bus.unit(unit)).collect(),
            report: PortReport::default(),
            settling: true,
        };
        let clocks = buses.iter().map(DriveBus::clock).collect();
        let board = Arc::new(Board {
            slots: Mutex::new(buses.iter().map(slot).collect()),
            posted: Condvar::new(),
            answered: Condvar::new(),
        });
        let reply = FleetReply {
            cycle: 0,
            units: buses.iter().flat_map(blank_answers).collect(),
            ports: vec![PortReport::default(); buses.len()],
        };
        let mut fleet = Fleet { board, threads: Vec::new(), names, port_of_unit, clocks, turn: 0, reply };
        for (index, bus) in buses.into_iter().enumerate() {
            let board = Arc::clone(&fleet.board);
            let spawned =
                std::thread::Builder::new().name(format!("port-{index}")).spawn(move || work(bus, &board, index));
            match spawned {
                Ok(thread) => fleet.threads.push(thread),
                Err(_) => return wrong(&fleet.names[index], InvalidConfig::NoThread),
            }
        }
        Ok(fleet)
    }

    /// Number of units.
    #[must_use]
    pub fn unit_count(&self) -> usize {
        self.port_of_unit.len()
    }

    /// Names of the ports.
    #[must_use]
    pub fn port_names(&self) -> &[Arc<str>] {
        &self.names
    }

    /// Port of a unit.
    #[must_use]
    pub fn port_of(&self, unit: usize) -> Option<usize> {
        self.port_of_unit.get(unit).copied()
    }

    /// Name, firmware and watchdog of each unit, as far as they are known.
    #[must_use]
    pub fn units(&self) -> Vec<UnitInfo> {
        self.board.slots().iter().flat_map(|slot| slot.units.clone()).collect()
    }

    /// Time that simulated ports have left out so far, ns; 0 for real ones.
    #[must_use]
    pub fn left_out_ns(&self) -> u64 {
        most_left_out_ns(&self.clocks)
    }

    /// Runs the cycle on all ports at the same time and waits for all of them, but not beyond `deadline_ns` of the
    /// monotonic clock. A port that has not finished by then is [`Error::Busy`], or [`Error::Resynchronising`] where
    /// that is the reason; its results are in the next cycle's report.
    ///
    /// Returns as soon as every unit has its command and its counts are read. The ports use the rest of the time until
    /// the deadline for currents and slow values, which are in the next cycle's reports with the time at which they
    /// were requested.
    ///
    /// Time that simulated ports leave out meanwhile does not count: the deadline moves by it, by a second at most.
    ///
    /// Does not allocate.
    pub fn exchange(&mut self, command: &FleetCommand, deadline_ns: u64) -> &FleetReply {
        self.turn += 1;
        let (posted_ns, left_out_ns) = (monotonic_ns(), self.left_out_ns());
        let mut slots = self.board.slots();
        let mut commands = command.units.iter();
        for slot in slots.iter_mut() {
            let span_ns = deadline_ns.saturating_sub(posted_ns);
            let mut order = Order { turn: self.turn, deadline_ns, span_ns, units: Default::default() };
            for (place, command) in order.units.iter_mut().zip(commands.by_ref().take(slot.answers.len())) {
                *place = *command;
            }
            slot.order = Some(order);
        }
        // Not before the lock is free: the threads would wake up only to wait for it.
        drop(slots);
        self.board.posted.notify_all();
        let mut slots = self.board.slots();
        let mut patience = Patience::new(deadline_ns, left_out_ns);
        let mut until_ns = deadline_ns;
        while slots.iter().any(|slot| slot.answered_turn != self.turn) {
            let now_ns = monotonic_ns();
            if now_ns >= until_ns {
                let Some(later_ns) = patience.later_ns(now_ns, &self.clocks) else { break };
                until_ns = later_ns;
            }
            let left = Duration::from_nanos(until_ns.saturating_sub(now_ns));
            slots = self.board.answered.wait_timeout(slots, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        self.reply.cycle = command.cycle;
        let mut units = self.reply.units.iter_mut();
        let ports = self.names.iter().zip(&self.clocks);
        for ((slot, report), (name, clock)) in slots.iter().zip(&mut self.reply.ports).zip(ports) {
            report.clone_from(&slot.report);
            let in_time = slot.answered_turn == self.turn;
            let unanswered = !in_time && clock.as_ref().is_some_and(|clock| clock.port_waits_for_device());
            for answer in &slot.answers {
                let Some(unit) = units.next() else { break };
                unit.clone_from(answer);
                if !in_time {
                    let port = Arc::clone(name);
                    unit.outcome = Err(match (slot.settling, unanswered) {
                        (true, _) => Error::Resynchronising { port },
                        (false, true) => Error::Unanswered { port },
                        (false, false) => Error::Busy { port },
                    });
                }
            }
        }
        &self.reply
    }
}

/// Decides how long an exchange is waited for beyond its deadline.
#[derive(Debug)]
struct Patience {
    deadline_ns: u64,
    /// Time that simulated ports had left out when the exchange began.
    left_out_ns: u64,
    waited: bool,
    graced: bool,
}

impl Patience {
    fn new(deadline_ns: u64, left_out_ns: u64) -> Self {
        Self { deadline_ns, left_out_ns, waited: false, graced: false }
    }

    /// New end of the wait once the old one has passed; `None` to give up.
    fn later_ns(&mut self, now_ns: u64, clocks: &[Option<Arc<PortClock>>]) -> Option<u64> {
        let left_out_ns = most_left_out_ns(clocks).saturating_sub(self.left_out_ns).min(SIMULATED_PATIENCE_NS);
        let deadline_ns = self.deadline_ns + left_out_ns;
        if now_ns < deadline_ns {
            return Some(deadline_ns);
        }
        let patient = now_ns < self.deadline_ns + SIMULATED_PATIENCE_NS;
        if patient && clocks.iter().flatten().any(|clock| clock.either_wants_to_run()) {
            self.waited = true;
            return Some(now_ns + SIMULATED_STEP_NS);
        }
        let stood_still = self.waited || now_ns > deadline_ns + STOOD_STILL_NS;
        (stood_still && !std::mem::replace(&mut self.graced, true)).then_some(now_ns + GRACE_NS)
    }
}

fn most_left_out_ns(clocks: &[Option<Arc<PortClock>>]) -> u64 {
    clocks.iter().flatten().map(|clock| clock.left_out_ns()).max().unwrap_or(0)
}

impl Drop for Fleet {
    /// Ends the threads. The units' watchdogs stop motors that were not stopped before.
    fn drop(&mut self) {
        for slot in self.board.slots().iter_mut() {
            slot.stop = true;
        }
        self.board.posted.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// Thread of a port: orders first, and between them whatever brings the port and its units back.
fn work<B: DriveBus>(mut bus: B, board: &Board, index: usize) {
    let mut answers = blank_answers(&bus);
    let mut pause = Duration::ZERO;
    while let Some(order) = next_order(board, index, pause) {
        let mut lost = None;
        if let Some(order) = order {
            let began_ns = monotonic_ns();
            // Simulated units did not run while this thread waited for a processor.
            let least_ns = if bus.clock().is_some_and(|clock| clock.is_simulated()) { order.span_ns } else { 0 };
            let left_ns = order.deadline_ns.saturating_sub(began_ns).max(least_ns);
            let deadline_ns = bus.now_ns() + left_ns;
            bus.exchange(&order.units, deadline_ns, &mut answers);
            lost = answers.iter().find_map(|answer| answer.outcome.clone().err().filter(Error::is_lost));
            let mut slots = board.slots();
            if let Some(slot) = slots.get_mut(index) {
                std::mem::swap(&mut slot.answers, &mut answers);
                slot.answered_turn = order.turn;
                slot.report.took_ns = monotonic_ns() - began_ns;
                slot.record(&bus, lost.clone());
            }
            // The caller waits for all ports, so only the last one wakes it.
            let last = slots.iter().all(|slot| slot.answered_turn == order.turn);
            drop(slots);
            if last {
                board.answered.notify_one();
            }
            // The caller continues with the counts; what is read now is in the reports of its next cycle.
            bus.spend(deadline_ns);
        }
        pause = IDLE;
        if !bus.is_settled() || lost.is_some() {
            let result = bus.settle(bus.now_ns() + STEP_NS);
            let lost = result.err().filter(Error::is_lost);
            pause = if lost.is_some() { LOST } else { BUSY };
            if let Some(slot) = board.slots().get_mut(index) {
                slot.record(&bus, lost);
            }
        }
    }
}

/// Waits for the next order; `Some(None)` after `patience` without one, `None` at the end.
fn next_order(board: &Board, index: usize, patience: Duration) -> Option<Option<Order>> {
    let mut slots = board.slots();
    let mut waited = patience.is_zero();
    loop {
        let slot = slots.get_mut(index)?;
        if slot.stop {
            return None;
        }
        let order = slot.order.take();
        if order.is_some() || waited {
            return Some(order);
        }
        let (guard, timeout) = board.posted.wait_timeout(slots, patience).unwrap_or_else(PoisonError::into_inner);
        slots = guard;
        waited = timeout.timed_out();
    }
}
