//! Several lines at once: one thread each, all starting with the same cycle.
//!
//! Each line is owned by its thread, so a line that is slow, silent or unplugged holds up no other, and comes back by itself. The
//! threads take over the scheduling policy, priority and processors of the thread that makes the fleet.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use serial::{Line, LineClock, Transport, monotonic_ns};

use crate::driver::{Bus, BusConfig, Counters, Drive, MAX_UNITS, StopInput, UnitAnswer, UnitIdentity};
use crate::error::{Error, Misfit};

/// Most units of a fleet: as many as there can be cables, if each had a unit of its own.
pub const MAX_FLEET: usize = 8;

/// Waking up so long after the deadline means that the machine stood still, and the answers with it,
const STOOD_STILL_NS: u64 = 5_000_000;
/// which are then waited for so much longer.
const GRACE_NS: u64 = 10_000_000;
/// Simulated units that wait for a processor are waited for in steps of this, ns,
const SIMULATED_STEP_NS: u64 = 2_000_000;
/// and for no longer than this in all, ns: a program that is to stop has to hear of it.
const SIMULATED_PATIENCE_NS: u64 = 1_000_000_000;

/// How long a thread sleeps that has nothing to do; only commands wake it earlier.
const IDLE: Duration = Duration::from_millis(500);
/// Between two steps of getting a line or unit back it only looks for commands: a step that can do nothing pauses by itself.
const BUSY: Duration = Duration::ZERO;
/// How long it sleeps between two looks for a lost device.
const LOST: Duration = Duration::from_millis(20);
/// Time for one step between two cycles, ns: a question and its answer at the baud in use.
const STEP_NS: u64 = 5_000_000;

/// One line of a fleet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PortConfig {
    /// The device: a name that stays when it is plugged in again.
    pub path: String,
    /// Its speed and units.
    pub bus: BusConfig,
}

/// What every unit is to do in a cycle; units in the order of the configuration, port after port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FleetCommand {
    /// The cycle's number, returned with the answer.
    pub cycle: u64,
    /// What each unit's motors are to do.
    pub drives: [[Drive; 2]; MAX_FLEET],
}

/// How a line is.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PortReport {
    /// What happened on it so far.
    pub counters: Counters,
    /// Why the device is not there; `None` while it is.
    pub lost: Option<Error>,
    /// Its stop input.
    pub stop: StopInput,
    /// How long commands and encoders took on it in this cycle, ns.
    pub took_ns: u64,
}

/// What became of a cycle.
#[derive(Debug, Clone, PartialEq)]
pub struct FleetReply {
    /// The cycle's number.
    pub cycle: u64,
    /// Each unit's answer; the outcome is an error where it has none in this cycle.
    pub units: Vec<UnitAnswer>,
    /// Each line's state.
    pub ports: Vec<PortReport>,
}

/// Several lines, each with its thread.
#[derive(Debug)]
pub struct Fleet {
    board: Arc<Board>,
    threads: Vec<JoinHandle<()>>,
    names: Vec<Arc<str>>,
    /// Each unit's port, in the order of the units.
    port_of_unit: Vec<usize>,
    /// What simulated lines leave out of their time; of each port, where its line has such a clock.
    clocks: Vec<Option<Arc<LineClock>>>,
    turn: u64,
    reply: FleetReply,
}

/// Where the caller and the threads leave things for each other.
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
    identities: Vec<UnitIdentity>,
    report: PortReport,
    /// The line is out of step, or a unit not in use: where the thread is not done in time, it is at that.
    settling: bool,
}

#[derive(Debug, Clone, Copy)]
struct Order {
    turn: u64,
    deadline_ns: u64,
    /// From the order to the deadline.
    span_ns: u64,
    drives: [[Drive; 2]; MAX_UNITS],
}

impl Slot {
    fn note<T: Transport>(&mut self, bus: &Bus<T>, lost: Option<Error>) {
        self.report.lost = lost;
        self.settling = !bus.is_settled();
        self.report.counters = bus.counters();
        self.report.stop.clone_from(bus.stop());
        for (place, identity) in self.identities.iter_mut().zip(bus.identities()) {
            *place = identity;
        }
    }
}

impl Board {
    fn slots(&self) -> MutexGuard<'_, Vec<Slot>> {
        // A thread that panicked has left whole values here: they are only ever replaced.
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Fleet {
    /// Start to look for these devices and to set up their units. Returns at once; a device that is not there is an error of the
    /// exchanges, until it is.
    pub fn open(ports: &[PortConfig]) -> Result<Fleet, Error> {
        Fleet::over(ports.iter().map(|port| (Line::new(&port.path, port.bus.baud), port.bus.clone())).collect())
    }

    /// The same over any lines, for instance simulated ones. Deadlines are given on the monotonic clock all the same: what is left
    /// of them is what a line with a clock of its own gets.
    pub fn over<T: Transport + 'static>(lines: Vec<(T, BusConfig)>) -> Result<Fleet, Error> {
        let buses: Vec<Bus<T>> =
            lines.into_iter().map(|(line, config)| Bus::new(line, &config)).collect::<Result<_, _>>()?;
        let names: Vec<Arc<str>> = buses.iter().map(|bus| Arc::clone(bus.name())).collect();
        let wrong = |port: &Arc<str>, what| Err(Error::Configuration { port: Arc::clone(port), what });
        for (index, name) in names.iter().enumerate() {
            if names[..index].contains(name) {
                return wrong(name, Misfit::PortTwice);
            }
        }
        let port_of_unit: Vec<usize> =
            buses.iter().enumerate().flat_map(|(port, bus)| std::iter::repeat_n(port, bus.unit_count())).collect();
        if port_of_unit.len() > MAX_FLEET {
            return wrong(&names[0], Misfit::TooManyUnits);
        }
        let slot = |bus: &Bus<T>| Slot {
            stop: false,
            order: None,
            answered_turn: 0,
            answers: bus.blank_answers(),
            identities: bus.identities().collect(),
            report: PortReport::default(),
            settling: true,
        };
        let clocks = buses.iter().map(|bus| bus.line().clock()).collect();
        let board = Arc::new(Board {
            slots: Mutex::new(buses.iter().map(slot).collect()),
            posted: Condvar::new(),
            answered: Condvar::new(),
        });
        let reply = FleetReply {
            cycle: 0,
            units: buses.iter().flat_map(Bus::blank_answers).collect(),
            ports: vec![PortReport::default(); buses.len()],
        };
        let mut fleet = Fleet { board, threads: Vec::new(), names, port_of_unit, clocks, turn: 0, reply };
        for (index, bus) in buses.into_iter().enumerate() {
            let board = Arc::clone(&fleet.board);
            let spawned =
                std::thread::Builder::new().name(format!("port-{index}")).spawn(move || work(bus, &board, index));
            match spawned {
                Ok(thread) => fleet.threads.push(thread),
                Err(_) => {
                    return wrong(&fleet.names[index], Misfit::NoThread);
                }
            }
        }
        Ok(fleet)
    }

    /// Number of units.
    #[must_use]
    pub fn unit_count(&self) -> usize {
        self.port_of_unit.len()
    }

    /// The lines' names.
    #[must_use]
    pub fn port_names(&self) -> &[Arc<str>] {
        &self.names
    }

    /// The port a unit is on.
    #[must_use]
    pub fn port_of(&self, unit: usize) -> Option<usize> {
        self.port_of_unit.get(unit).copied()
    }

    /// Who the units are, as far as they have said.
    #[must_use]
    pub fn identities(&self) -> Vec<UnitIdentity> {
        self.board.slots().iter().flat_map(|slot| slot.identities.clone()).collect()
    }

    /// Time that simulated lines have left out so far, ns; 0 for real ones.
    #[must_use]
    pub fn left_out_ns(&self) -> u64 {
        most_left_out_ns(&self.clocks)
    }

    /// Let all lines do their part of the cycle at the same time, and wait for all of them, but not beyond `deadline_ns` of the
    /// monotonic clock. A line that is not done by then is [`Error::Busy`], or
    /// [`Error::Resynchronising`] where it is at that; what it finds out is in the next cycle's report.
    ///
    /// Returns as soon as every unit has its command and its encoders are read. The lines use the rest of the time until the deadline
    /// for currents and slow values, which are in the next cycle's reports with the time at which they were asked for.
    ///
    /// What simulated lines leave out meanwhile does not count: the deadline is so much later, by a second at most.
    ///
    /// Does not allocate.
    pub fn exchange(&mut self, command: &FleetCommand, deadline_ns: u64) -> &FleetReply {
        self.turn += 1;
        let (posted_ns, left_out_ns) = (monotonic_ns(), self.left_out_ns());
        let mut slots = self.board.slots();
        let mut drives = command.drives.iter();
        for slot in slots.iter_mut() {
            let span_ns = deadline_ns.saturating_sub(posted_ns);
            let mut order = Order { turn: self.turn, deadline_ns, span_ns, drives: Default::default() };
            for (place, drive) in order.drives.iter_mut().zip(drives.by_ref().take(slot.answers.len())) {
                *place = *drive;
            }
            slot.order = Some(order);
        }
        self.board.posted.notify_all();
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
        let lines = self.names.iter().zip(&self.clocks);
        for ((slot, report), (name, clock)) in slots.iter().zip(&mut self.reply.ports).zip(lines) {
            report.clone_from(&slot.report);
            let in_time = slot.answered_turn == self.turn;
            let unanswered = !in_time && clock.as_ref().is_some_and(|clock| clock.line_waits_for_the_device());
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

/// How long an exchange is waited for beyond its deadline.
#[derive(Debug)]
struct Patience {
    deadline_ns: u64,
    /// What simulated lines had left out when the exchange began.
    left_out_ns: u64,
    waited: bool,
    graced: bool,
}

impl Patience {
    fn new(deadline_ns: u64, left_out_ns: u64) -> Self {
        Self { deadline_ns, left_out_ns, waited: false, graced: false }
    }

    /// The time is over: until when it goes on, if it does.
    fn later_ns(&mut self, now_ns: u64, clocks: &[Option<Arc<LineClock>>]) -> Option<u64> {
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

fn most_left_out_ns(clocks: &[Option<Arc<LineClock>>]) -> u64 {
    clocks.iter().flatten().map(|clock| clock.left_out_ns()).max().unwrap_or(0)
}

impl Drop for Fleet {
    /// Ends the threads. The units' watchdogs stop the motors that were not stopped before.
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

/// A line's thread: commands first, and between them whatever brings the line and its units back.
fn work<T: Transport>(mut bus: Bus<T>, board: &Board, index: usize) {
    let mut answers = bus.blank_answers();
    let mut pause = Duration::ZERO;
    while let Some(order) = next_order(board, index, pause) {
        let mut lost = None;
        if let Some(order) = order {
            let began_ns = monotonic_ns();
            // Simulated units stood still while this thread waited for a processor.
            let least_ns = if bus.line().clock().is_some_and(|clock| clock.is_simulated()) { order.span_ns } else { 0 };
            let left_ns = order.deadline_ns.saturating_sub(began_ns).max(least_ns);
            let deadline_ns = bus.line().now_ns() + left_ns;
            bus.drive(&order.drives, deadline_ns, &mut answers);
            lost = answers.iter().find_map(|answer| answer.outcome.clone().err().filter(Error::is_lost));
            let mut slots = board.slots();
            if let Some(slot) = slots.get_mut(index) {
                std::mem::swap(&mut slot.answers, &mut answers);
                slot.answered_turn = order.turn;
                slot.report.took_ns = monotonic_ns() - began_ns;
                slot.note(&bus, lost.clone());
            }
            drop(slots);
            board.answered.notify_all();
            // The caller goes on with the encoders; what is read now is in its next cycle's reports.
            bus.spend(deadline_ns);
        }
        pause = IDLE;
        if !bus.is_settled() || lost.is_some() {
            let result = bus.settle(bus.line().now_ns() + STEP_NS);
            let lost = result.err().filter(Error::is_lost);
            pause = if lost.is_some() { LOST } else { BUSY };
            if let Some(slot) = board.slots().get_mut(index) {
                slot.note(&bus, lost);
            }
        }
    }
}

/// The next order; `Some(None)` when there was none for so long, `None` at the end.
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
