//! Several ports at once: one thread each, all starting a cycle together.
//!
//! Each port is owned by its thread, so a port that is slow, silent or unplugged delays no other and recovers on its
//! own.
//!
//! A single port has a thread too: opening and closing a device can block, a missing answer is waited for up to 12 ms
//! on a native port and 25 ms on USB, longer than a cycle lasts, and neither the end of the cycle nor the next request
//! may wait for that. But handing every cycle to it and back is two more sleeps in each. So while all units of a single
//! port are in use, the caller has the bus, where that [can run inline](DriveBus::can_run_inline).
//! The thread gets it back as soon as a unit is not in use any more, or the bus is out of step.
//!
//! The threads inherit scheduling policy, priority and processors of the thread that opens the fleet.

use std::fmt;
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use serial::{PortClock, monotonic_ns};

use crate::bus::{Capabilities, DriveBus};
use crate::error::{Error, InvalidConfig};
use crate::fleet_cycle::{FleetCommand, FleetReply, MAX_FLEET, PortReport};
use crate::port_thread::{Board, Order, Seat, Slot, blank_answers, loss, work};
use crate::report::UnitInfo;

/// Waking up this long after the deadline means that the whole machine was stopped, and the answers with it, ns.
const STOOD_STILL_NS: u64 = 5_000_000;
/// Extra wait for the answers in that case, ns.
const GRACE_NS: u64 = 10_000_000;
/// Step in which simulated units that wait for a processor are waited for, ns.
const SIMULATED_STEP_NS: u64 = 2_000_000;
/// Longest such wait, ns: a program has to notice a request to stop.
const SIMULATED_PATIENCE_NS: u64 = 1_000_000_000;

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
    /// The thread lends its bus.
    lends: bool,
    inline: Option<Inline>,
}

/// The bus of the single port, while the caller has it.
struct Inline {
    bus: Box<dyn DriveBus>,
    /// Deadline of the last exchange on the clock of the port, ns.
    deadline_ns: u64,
}

impl fmt::Debug for Inline {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Inline").field("deadline_ns", &self.deadline_ns).finish_non_exhaustive()
    }
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
        let clocks = buses.iter().map(DriveBus::clock).collect();
        let board = Arc::new(Board::new(buses.iter().map(Slot::new).collect()));
        let reply = FleetReply {
            cycle: 0,
            units: buses.iter().flat_map(blank_answers).collect(),
            ports: vec![PortReport::default(); buses.len()],
        };
        let lends = matches!(&*buses, [bus] if bus.can_run_inline());
        let mut fleet =
            Fleet { board, threads: Vec::new(), names, port_of_unit, clocks, turn: 0, reply, lends, inline: None };
        for (index, bus) in buses.into_iter().enumerate() {
            let (board, bus) = (Arc::clone(&fleet.board), Box::new(bus));
            let spawned = std::thread::Builder::new()
                .name(format!("port-{index}"))
                .spawn(move || work(bus, &board, index, lends));
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
    /// monotonic clock. A port that has not finished by then is [`Error::Busy`], or [`Error::Resynchronising`] or lost
    /// where that is the reason; its results are in the next cycle's report.
    ///
    /// Returns as soon as every unit has its command and its counts are read. The ports use the rest of the time until
    /// the deadline for currents and slow values, which are in the next cycle's reports with the time at which they
    /// were requested: in their threads, or in [`spend`](Fleet::spend).
    ///
    /// Time that simulated ports leave out meanwhile does not count: the deadline moves by it, by a second at most.
    ///
    /// Does not allocate.
    pub fn exchange(&mut self, command: &FleetCommand, deadline_ns: u64) -> &FleetReply {
        self.reply.cycle = command.cycle;
        self.take_offered();
        let Some(inline) = &mut self.inline else {
            self.order(command, deadline_ns);
            return &self.reply;
        };
        let began_ns = monotonic_ns();
        let FleetReply { units, ports, .. } = &mut self.reply;
        inline.deadline_ns = inline.bus.now_ns() + deadline_ns.saturating_sub(began_ns);
        inline.bus.exchange(&command.units, inline.deadline_ns, units);
        if let Some(report) = ports.first_mut() {
            report.record(&*inline.bus, loss(units));
            report.took_ns = monotonic_ns() - began_ns;
        }
        self.return_unsettled();
        &self.reply
    }

    /// Uses the rest of the time of an exchange, until `early_ns` before its deadline, where that is for the caller to
    /// do. To be called after every exchange, once nothing waits for the caller.
    ///
    /// Does not allocate.
    pub fn spend(&mut self, early_ns: u64) {
        if let Some(inline) = &mut self.inline {
            inline.bus.spend(inline.deadline_ns.saturating_sub(early_ns));
            self.return_unsettled();
        }
    }

    /// Gives the bus back to its thread where there is something to do between cycles, or a device to close.
    fn return_unsettled(&mut self) {
        let lost = self.reply.ports.first().and_then(|port| port.lost.clone());
        let Some(Inline { bus, .. }) = self.inline.take_if(|inline| lost.is_some() || !inline.bus.is_settled()) else {
            return;
        };
        let mut slots = self.board.slots();
        if let Some(slot) = slots.first_mut() {
            // What the caller has seen, so that nothing older follows.
            slot.answers.clone_from(&self.reply.units);
            slot.record(&*bus, lost);
            slot.seat = Seat::Returned(bus);
        }
        drop(slots);
        self.board.posted.notify_all();
    }

    /// Takes the bus that its thread offers.
    fn take_offered(&mut self) {
        if !self.lends || self.inline.is_some() {
            return;
        }
        if let Some(slot) = self.board.slots().first_mut() {
            match std::mem::replace(&mut slot.seat, Seat::Caller) {
                Seat::Offered(mut bus) => {
                    bus.set_inline(true);
                    self.inline = Some(Inline { bus, deadline_ns: 0 });
                }
                seat => slot.seat = seat,
            }
        }
    }

    /// Gives the threads their orders and waits for their answers.
    fn order(&mut self, command: &FleetCommand, deadline_ns: u64) {
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
        self.await_answers(deadline_ns, left_out_ns);
    }

    /// Waits for the answers and takes them. `left_out_ns`: what simulated ports had left out at the order.
    fn await_answers(&mut self, deadline_ns: u64, left_out_ns: u64) {
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
        let mut units = self.reply.units.iter_mut();
        let ports = self.names.iter().zip(&self.clocks);
        for ((slot, report), (name, clock)) in slots.iter().zip(&mut self.reply.ports).zip(ports) {
            report.clone_from(&slot.report);
            let in_time = slot.answered_turn == self.turn;
            // A call to the kernel for a device that was unplugged can take seconds.
            let gone = |clock: &Arc<PortClock>| clock.device_is_gone();
            if !in_time && report.lost.is_none() && clock.as_ref().is_some_and(gone) {
                report.lost = Some(Error::Serial(serial::Error::Missing { port: Arc::clone(name) }));
            }
            let unanswered = !in_time && clock.as_ref().is_some_and(|clock| clock.port_waits_for_device());
            for answer in &slot.answers {
                let Some(unit) = units.next() else { break };
                unit.clone_from(answer);
                if !in_time {
                    let port = Arc::clone(name);
                    unit.outcome = Err(match (&report.lost, slot.settling, unanswered) {
                        (Some(lost), _, _) => lost.clone(),
                        (None, true, _) => Error::Resynchronising { port },
                        (None, false, true) => Error::Unanswered { port },
                        (None, false, false) => Error::Busy { port },
                    });
                }
            }
        }
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
