//! The trait of a drive family, and the commands it takes.

use std::sync::Arc;

use serial::PortClock;

use crate::{AXES, Counters, Error, StopInput, UnitAnswer, UnitInfo};

/// Command for one motor. Positive is the direction in which its count rises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// No closed loop and no drive output. The right stop where the encoder cannot be trusted; a gear that can be
    /// back-driven creeps.
    Release,
    /// Closed-loop velocity, counts per second.
    Velocity(f64),
    /// Closed-loop torque, as the motor current in A.
    Torque(f64),
}

impl Command {
    /// Closed-loop standstill: the motor resists.
    pub const HOLD: Command = Command::Velocity(0.0);

    /// True for a command that turns the motor or pulls.
    #[must_use]
    pub fn moves(self) -> bool {
        match self {
            Command::Release => false,
            Command::Velocity(counts_s) => counts_s != 0.0,
            Command::Torque(_) => true,
        }
    }
}

/// Commands for the motors of one unit; `None` for a motor that is not connected, which is not commanded at all.
pub type UnitCommand = [Option<Command>; AXES];

/// Commands and readings that a drive family offers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capabilities {
    /// [`Command::Velocity`].
    pub velocity: bool,
    /// [`Command::Torque`].
    pub torque: bool,
    /// A watchdog in the unit that stops the motors when commands cease.
    pub watchdog: bool,
    /// Motor speeds as the unit measures them.
    pub speeds: bool,
    /// Motor currents.
    pub currents: bool,
    /// Drive output as a share of the supply.
    pub duties: bool,
    /// Supply voltage.
    pub supply: bool,
    /// A second encoder for the one cable of a unit, where it is configured.
    pub second_encoder: bool,
}

impl Capabilities {
    /// A family that only counts.
    pub const NONE: Capabilities = Capabilities {
        velocity: false,
        torque: false,
        watchdog: false,
        speeds: false,
        currents: false,
        duties: false,
        supply: false,
        second_encoder: false,
    };

    /// Name of the first capability in `needed` that this family lacks.
    #[must_use]
    pub fn first_missing(self, needed: Capabilities) -> Option<&'static str> {
        [
            (self.velocity, needed.velocity, "closed-loop velocity"),
            (self.torque, needed.torque, "closed-loop torque"),
            (self.watchdog, needed.watchdog, "a watchdog"),
            (self.speeds, needed.speeds, "motor speeds"),
            (self.currents, needed.currents, "motor currents"),
            (self.duties, needed.duties, "the drive output"),
            (self.supply, needed.supply, "the supply voltage"),
            (self.second_encoder, needed.second_encoder, "a second encoder"),
        ]
        .into_iter()
        .find_map(|(offered, needed, name)| (needed && !offered).then_some(name))
    }
}

/// One serial port with the units of a drive family on it. The device need not be present.
///
/// Contract of every family, which `shared/testing/drive-conformance` tests:
/// * **Deadlines.** A call that begins after its deadline sends nothing, and no unit is commanded after it. Command and
///   counts of a unit that began before the deadline are completed, so late or missing answers end a call at most their
///   answer times later.
/// * **No stale answer.** After any failed exchange the bus resynchronises before it uses an answer: a late answer must
///   never count as the answer to a later question.
/// * **Watchdog.** A unit is in use ([`UnitAnswer::outcome`] is `Ok`) only after its watchdog was set and read back
///   ([`UnitInfo::watchdog_ms`]); until then it is [`Error::Preparing`] or [`Error::WatchdogRefused`].
/// * **Not heard.** A unit whose answers do not arrive stops within its watchdog's time where it gets no command, also
///   where the bus asks it meanwhile.
/// * **Spare time.** Where no cycle leaves time for readings that change slowly, they are taken all the same, rarely.
/// * **Restarts.** A unit that restarted has lost its counts and its watchdog. The bus detects this, counts it in
///   [`UnitReport::reboots`](crate::UnitReport::reboots), and continues the counts from where they were.
/// * **Interlock.** A unit that was lost or restarted, or stood because it was not heard, is [`Error::Interlocked`]
///   until one command that does not move it was accepted.
/// * **Inline.** A bus that [can run inline](DriveBus::can_run_inline) and was told to does not wait beyond the
///   deadline of a call, but for up to 10 ms where the whole machine stood still during it. It neither opens nor closes
///   its device, and does nothing else that a broken device can block. A later call continues to wait for an answer
///   that was not there in time. After a loss it is told to leave this mode, and closes the device then.
/// * **Allocation.** [`exchange`](DriveBus::exchange) and [`spend`](DriveBus::spend) do not allocate.
pub trait DriveBus: Send {
    /// The port's name, as the operator configured it.
    fn port(&self) -> &Arc<str>;

    /// Number of units.
    fn unit_count(&self) -> usize;

    /// Commands and readings that this family offers.
    fn capabilities(&self) -> Capabilities;

    /// Name, firmware and watchdog of a unit.
    fn unit(&self, unit: usize) -> Option<UnitInfo>;

    /// Present time of the port's clock, ns; deadlines are on this clock.
    fn now_ns(&self) -> u64;

    /// Clock of a simulated port, which leaves out the time in which its device did not run.
    fn clock(&self) -> Option<Arc<PortClock>> {
        None
    }

    /// True where the bus can run inline, that is in a thread that has other work in every cycle.
    fn can_run_inline(&self) -> bool {
        false
    }

    /// Sets whether the bus runs inline; at first it does not. See the contract.
    fn set_inline(&mut self, inline: bool) {
        let _ = inline;
    }

    /// Commands every unit and reads its counts: the part of a control cycle that the caller waits for.
    ///
    /// `commands` and `answers` follow the order of the units; a unit without a command is only read.
    fn exchange(&mut self, commands: &[UnitCommand], deadline_ns: u64, answers: &mut [UnitAnswer]);

    /// Uses the time until the deadline: reads the stop input, brings units back into use, and reads what changes
    /// slowly. The results are in the reports of the next [`exchange`](DriveBus::exchange).
    fn spend(&mut self, deadline_ns: u64);

    /// Connects, resynchronises and sets up units, between cycles. `Ok` once every unit is in use.
    ///
    /// # Errors
    /// The reason why a unit is not in use.
    fn settle(&mut self, deadline_ns: u64) -> Result<(), Error>;

    /// True where every unit is in use and nothing is left to do between cycles.
    fn is_settled(&self) -> bool;

    /// Stop input, as last read.
    fn stop(&self) -> &StopInput;

    /// Event counts of the port.
    fn counters(&self) -> Counters;
}

impl<B: DriveBus + ?Sized> DriveBus for Box<B> {
    fn port(&self) -> &Arc<str> {
        (**self).port()
    }
    fn unit_count(&self) -> usize {
        (**self).unit_count()
    }
    fn capabilities(&self) -> Capabilities {
        (**self).capabilities()
    }
    fn unit(&self, unit: usize) -> Option<UnitInfo> {
        (**self).unit(unit)
    }
    fn now_ns(&self) -> u64 {
        (**self).now_ns()
    }
    fn clock(&self) -> Option<Arc<PortClock>> {
        (**self).clock()
    }
    fn can_run_inline(&self) -> bool {
        (**self).can_run_inline()
    }
    fn set_inline(&mut self, inline: bool) {
        (**self).set_inline(inline);
    }
    fn exchange(&mut self, commands: &[UnitCommand], deadline_ns: u64, answers: &mut [UnitAnswer]) {
        (**self).exchange(commands, deadline_ns, answers);
    }
    fn spend(&mut self, deadline_ns: u64) {
        (**self).spend(deadline_ns);
    }
    fn settle(&mut self, deadline_ns: u64) -> Result<(), Error> {
        (**self).settle(deadline_ns)
    }
    fn is_settled(&self) -> bool {
        (**self).is_settled()
    }
    fn stop(&self) -> &StopInput {
        (**self).stop()
    }
    fn counters(&self) -> Counters {
        (**self).counters()
    }
}
