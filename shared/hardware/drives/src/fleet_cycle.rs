//! Commands and results of one cycle of a fleet.

use crate::bus::{DriveBus, UnitCommand};
use crate::error::Error;
use crate::report::{Counters, StopInput, UnitAnswer};

/// Most units of a fleet: one for each of the most cables.
pub const MAX_FLEET: usize = 8;

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

impl PortReport {
    pub(crate) fn record<B: DriveBus + ?Sized>(&mut self, bus: &B, lost: Option<Error>) {
        self.lost = lost;
        self.counters = bus.counters();
        self.stop.clone_from(bus.stop());
    }
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
