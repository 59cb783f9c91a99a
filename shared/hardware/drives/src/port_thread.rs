//! The thread of a port, and the board on which it and the caller of the fleet leave orders, answers and the bus.

use std::fmt;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serial::monotonic_ns;

use crate::bus::{DriveBus, UnitCommand};
use crate::error::Error;
use crate::fleet_cycle::{MAX_FLEET, PortReport};
use crate::report::{UnitAnswer, UnitInfo, UnitReport};

/// Sleep of a thread that has nothing to do; only an order ends it earlier.
const IDLE: Duration = Duration::from_millis(500);
/// Sleep between two steps of getting a port or unit back: none, because a step that can do nothing pauses by itself.
const BUSY: Duration = Duration::ZERO;
/// Sleep between two attempts to find a lost device.
const LOST: Duration = Duration::from_millis(20);
/// Time for one step between two cycles, ns: a question and its answer at the baud in use.
const STEP_NS: u64 = 5_000_000;

/// Exchange of orders and answers between the caller and the threads.
#[derive(Debug)]
pub(crate) struct Board {
    slots: Mutex<Vec<Slot>>,
    pub(crate) posted: Condvar,
    pub(crate) answered: Condvar,
}

#[derive(Debug)]
pub(crate) struct Slot {
    pub(crate) stop: bool,
    pub(crate) order: Option<Order>,
    /// The order that `answers` belong to.
    pub(crate) answered_turn: u64,
    pub(crate) answers: Vec<UnitAnswer>,
    pub(crate) units: Vec<UnitInfo>,
    pub(crate) report: PortReport,
    /// The port is resynchronising, or a unit is not in use: the reason where the thread misses its deadline.
    pub(crate) settling: bool,
    pub(crate) seat: Seat,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Order {
    pub(crate) turn: u64,
    pub(crate) deadline_ns: u64,
    /// From the order to the deadline.
    pub(crate) span_ns: u64,
    pub(crate) units: [UnitCommand; MAX_FLEET],
}

/// Who has the bus of a port.
#[derive(Default)]
pub(crate) enum Seat {
    /// The port's thread.
    #[default]
    Thread,
    /// Neither: its units are in use, and the caller may take it.
    Offered(Box<dyn DriveBus>),
    /// The caller.
    Caller,
    /// Neither: the caller has put it back.
    Returned(Box<dyn DriveBus>),
}

impl fmt::Debug for Seat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Seat::Thread => "Thread",
            Seat::Offered(_) => "Offered",
            Seat::Caller => "Caller",
            Seat::Returned(_) => "Returned",
        })
    }
}

impl Slot {
    pub(crate) fn new<B: DriveBus>(bus: &B) -> Self {
        Slot {
            stop: false,
            order: None,
            answered_turn: 0,
            answers: blank_answers(bus),
            units: (0..bus.unit_count()).filter_map(|unit| bus.unit(unit)).collect(),
            report: PortReport::default(),
            settling: true,
            seat: Seat::Thread,
        }
    }

    pub(crate) fn record<B: DriveBus + ?Sized>(&mut self, bus: &B, lost: Option<Error>) {
        self.report.record(bus, lost);
        self.settling = !bus.is_settled();
        for (index, place) in self.units.iter_mut().enumerate() {
            if let Some(unit) = bus.unit(index) {
                *place = unit;
            }
        }
    }
}

impl Board {
    pub(crate) fn new(slots: Vec<Slot>) -> Self {
        Self { slots: Mutex::new(slots), posted: Condvar::new(), answered: Condvar::new() }
    }

    pub(crate) fn slots(&self) -> MutexGuard<'_, Vec<Slot>> {
        // A thread that panicked has left whole values here: they are only ever replaced.
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Places for the answers of a bus.
pub(crate) fn blank_answers<B: DriveBus>(bus: &B) -> Vec<UnitAnswer> {
    let outcome = || Err(Error::Resynchronising { port: bus.port().clone() });
    (0..bus.unit_count()).map(|_| UnitAnswer { outcome: outcome(), report: UnitReport::default() }).collect()
}

/// The error that shows a lost device.
pub(crate) fn loss(answers: &[UnitAnswer]) -> Option<Error> {
    answers.iter().find_map(|answer| answer.outcome.as_ref().err().filter(|error| error.is_lost()).cloned())
}

/// Thread of a port: orders first, and between them whatever brings the port and its units back. With `lends`, the
/// caller gets the bus while there is nothing else to do.
pub(crate) fn work(mut bus: Box<dyn DriveBus>, board: &Board, index: usize, lends: bool) {
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
            lost = loss(&answers);
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
        } else if lends {
            let Some(returned) = lend(bus, board, index) else { return };
            (bus, pause) = (returned, BUSY);
        }
    }
}

/// Lends the bus to the caller, until it returns it or has an order; `None` at the end.
fn lend(bus: Box<dyn DriveBus>, board: &Board, index: usize) -> Option<Box<dyn DriveBus>> {
    let mut slots = board.slots();
    slots.get_mut(index)?.seat = Seat::Offered(bus);
    loop {
        let slot = slots.get_mut(index)?;
        if slot.stop {
            return None;
        }
        let ordered = slot.order.is_some();
        match std::mem::take(&mut slot.seat) {
            // It was not offered yet when the caller wrote the order.
            Seat::Offered(bus) if ordered => return Some(bus),
            Seat::Returned(mut bus) => {
                drop(slots);
                // Here a lost device is closed, which can take its time.
                bus.set_inline(false);
                return Some(bus);
            }
            seat => slot.seat = seat,
        }
        slots = board.posted.wait(slots).unwrap_or_else(PoisonError::into_inner);
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
