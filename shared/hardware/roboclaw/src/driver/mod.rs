//! Driver of one bus: several units on one serial port.
//!
//! The rules, and why:
//! * Before anything is sent the receive buffer must be empty, and an answer must be exactly right in length, checksum
//!   and origin.
//! * After any error the driver does not simply ask again: the answer may only be late, and would then count as the
//!   answer to the next question. Instead it drains the port until it was silent long enough to empty the units'
//!   parsers too, and asks the unit that failed a question that the cycle never asks (a *fence*, a different one each
//!   time). Units answer in order, so once the fence's answer has arrived with nothing after it, no older answer can
//!   follow.
//! * A unit that failed is then asked for its watchdog. The watchdog is set to a value that units do not start with, so
//!   this detects a restart, and the encoders of a restarted unit, which begin at zero, do not count as motion.
//! * A unit that answers later than the margin gets more time while it is brought back into use, up to four times the
//!   margin: on a starved computer or a slow adapter it would otherwise never come back. In a control cycle the margin
//!   stays.
//! * Every question feeds the watchdog of a unit that hears and is not heard, so its motors would run on with the last
//!   command while it is fenced. The driver stops them instead, within the time in which the watchdog would have.
//! * What changes slowly is read in the time that a cycle leaves. Where it never leaves any, one value is read all the
//!   same, and its answer may come after the end of the call: every second cycle while that costs no cycle its
//!   deadline, otherwise every 25th for each unit.
//! * Where the bus runs inline, a call does not wait beyond its deadline. The next one waits on for the answer, and
//!   then uses the bus.
//! * All of this is one state machine that advances as far as a call's deadline allows, so that a silent unit costs the
//!   others a few cycles and does not trip their watchdogs.

mod cycle;
mod exchange;
mod family;
mod late;
mod step;
mod sync;

use std::sync::Arc;

use drives::{CountBound, Counters, Error, Instead, InvalidConfig, Overdue, StopInput, UnitReport};
use serial::{StatusPin, Transport, byte_time_ns};

use crate::codec::{ADDRESSES, Version};
use crate::status::StatusWidth;

/// Most units on one bus: the protocol has eight addresses.
pub const MAX_UNITS: usize = 8;

/// Time that a unit on a wire has to begin its answer, besides the time of the bytes: the manual's 10 ms and a reserve.
pub const WIRE_MARGIN_NS: u64 = 12_000_000;

/// The same over USB, where frames, adapters and kernel threads add delays.
pub const USB_MARGIN_NS: u64 = 25_000_000;

/// [`ADDRESSES`] in messages.
const ACCEPTED_ADDRESSES: &str = "128 to 135 (0x80 to 0x87)";
/// Watchdog times in messages: one byte of tenths of a second, 0 switches it off.
const ACCEPTED_WATCHDOGS: &str = "100 to 25500 ms in steps of 100";

/// Watchdog setting of a unit, ms.
fn watchdog_ms(tenths: u8) -> u32 {
    u32::from(tenths) * 100
}

/// Setting for a watchdog of this many seconds.
///
/// # Errors
/// The units cannot be set to this time, or would be switched off by it.
pub fn watchdog_tenths(seconds: f64) -> Result<u8, InvalidConfig> {
    let tenths = (seconds * 10.0).round();
    if (1.0..=255.0).contains(&tenths) && (seconds * 10.0 - tenths).abs() < 1e-6 {
        return Ok(tenths as u8);
    }
    // `as` saturates, and turns a NaN into 0.
    Err(InvalidConfig::Watchdog { given_ms: (seconds * 1e3) as u32, accepted: ACCEPTED_WATCHDOGS })
}

/// Command of the protocol for one motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Drive {
    /// No command; the watchdog continues.
    #[default]
    Idle,
    /// Closed-loop speed, counts per second.
    Speed(i32),
    /// Duty in 1/32767 of the supply, without the loop.
    Duty(i16),
}

impl Drive {
    /// Closed-loop standstill: the motor resists.
    pub const HOLD: Drive = Drive::Speed(0);
    /// Leads shorted, loop open: the right stop where the encoder cannot be trusted; a gear that can be back-driven
    /// creeps.
    pub const RELEASE: Drive = Drive::Duty(0);

    fn moves(self) -> bool {
        !matches!(self, Drive::Idle | Drive::HOLD | Drive::RELEASE)
    }

    /// The same command without motion.
    fn at_rest(self) -> Self {
        match self {
            Drive::Idle => Drive::Idle,
            Drive::Speed(_) => Drive::HOLD,
            Drive::Duty(_) => Drive::RELEASE,
        }
    }
}

/// Settings of a unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitConfig {
    /// Address, 0x80 to 0x87.
    pub address: u8,
    /// The unit stops its motors when it receives nothing for so many tenths of a second, 1 to 255. The value must
    /// differ from the one that the unit starts with (usually 0): the difference shows a restart.
    pub watchdog_tenths: u8,
    /// Motion of the counts that needs no explanation. A sample beyond it is held back until the unit has shown by its
    /// watchdog that it did not restart; then it is passed on, and counted as a jump.
    pub bound: CountBound,
}

/// Settings of a bus and its units.
#[derive(Debug, Clone, PartialEq)]
pub struct BusConfig {
    /// Bits per second, for the time that bytes take; 0 where it is negligible (USB).
    pub baud: u32,
    /// Time to the beginning of an answer, ns; see [`WIRE_MARGIN_NS`].
    pub margin_ns: u64,
    /// The units, in the order of commands and answers.
    pub units: Vec<UnitConfig>,
    /// Pin that the closed contact of a stop button holds on; an open contact or a broken wire is a stop.
    pub stop_pin: Option<StatusPin>,
}

/// Driver state of a unit.
#[derive(Debug)]
struct Unit {
    config: UnitConfig,
    /// Name in messages.
    name: Arc<str>,
    phase: Phase,
    report: UnitReport,
    version: Option<Version>,
    /// Width of its status; unknown until the first answer.
    width: Option<StatusWidth>,
    /// The unit's own 32 bits at the last accepted sample.
    last_raw: Option<[u32; 2]>,
    /// The last sample was beyond the bound and was held back.
    held_back: bool,
    /// Since the unit's last restart its watchdog was set and read back: another value means another restart.
    watchdog_set: bool,
    /// The watchdog is read before the counts in the next cycle.
    doubtful: bool,
    /// It was asked before whether it has the watchdog.
    recognised: bool,
    /// Time of the last command that it acknowledged, ns.
    commanded_ns: u64,
    /// It does not move until it was commanded to stand still.
    interlocked: bool,
    /// Late answers while it was brought back into use, less answers in time since; see [`Bus::patience_ns`].
    patience: u8,
    /// What arrived in place of its last missing answer.
    instead: Instead,
}

/// Progress of bringing a unit into use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// An older answer of it may still arrive: a fence is due at `due_ns`, after `failed` ones.
    Suspect { failed: u32, due_ns: u64 },
    /// In step; what it is to be asked before it is used.
    Setup(step::Setup),
    /// In use.
    Ready,
    /// It does not keep its watchdog setting; tried again at `due_ns`.
    Unusable { wanted: u8, got: u8, due_ns: u64 },
}

/// Driver of the units on one port. One thread owns it: two users of one port garble each other's answers.
#[derive(Debug)]
pub struct Bus<T> {
    transport: T,
    byte_ns: u64,
    margin_ns: u64,
    units: Vec<Unit>,
    step: step::Step,
    /// Start of the present run of unrequested bytes, ns.
    noisy_from_ns: Option<u64>,
    connection: u32,
    /// The last answer came alone, and nothing was waited for since: the port is empty.
    empty: bool,
    /// Bytes that arrived with the last answer after its end.
    excess: usize,
    /// The unit addressed last: unexpected bytes are most likely its.
    last_unit: usize,
    next_fence: usize,
    /// Moving average of the time from the last byte sent to the first received, ns.
    turnaround_ns: u64,
    /// Time of the last packet on the machine's clock, ns.
    sent_stamp_ns: u64,
    /// The caller waits for a cycle: no answer gets more time than the margin.
    in_cycle: bool,
    /// The thread of the caller has other work in every cycle.
    inline: bool,
    /// Begin of the present call, ns, and its end, where it must not wait beyond it.
    call_began_ns: u64,
    call_ends_ns: u64,
    /// Usual time from the begin of the call of a cycle to its deadline, ns.
    usual_call_ns: u64,
    slow_turn: usize,
    slow_left_out: bool,
    overdue: Overdue,
    overdue_turn: usize,
    current_turn: usize,
    counters: Counters,
    stop_pin: Option<StatusPin>,
    stop: StopInput,
}

impl<T: Transport> Bus<T> {
    /// A bus on which nothing was sent yet. The device need not be there.
    pub fn new(transport: T, config: &BusConfig) -> Result<Bus<T>, Error> {
        let port = Arc::clone(transport.name());
        let wrong = |what| Err(Error::Configuration { port: Arc::clone(&port), what });
        if config.units.is_empty() {
            return wrong(InvalidConfig::NoUnits);
        }
        for (index, unit) in config.units.iter().enumerate() {
            if !ADDRESSES.contains(&unit.address) {
                return wrong(InvalidConfig::Address { given: unit.address, accepted: ACCEPTED_ADDRESSES });
            }
            if config.units[..index].iter().any(|other| other.address == unit.address) {
                return wrong(InvalidConfig::AddressTwice);
            }
            if unit.watchdog_tenths == 0 {
                return wrong(InvalidConfig::Watchdog { given_ms: 0, accepted: ACCEPTED_WATCHDOGS });
            }
        }
        let unit = |config: &UnitConfig| Unit {
            config: *config,
            name: format!("unit {:#04x}", config.address).into(),
            phase: Phase::Suspect { failed: 0, due_ns: 0 },
            report: UnitReport::default(),
            version: None,
            width: None,
            last_raw: None,
            held_back: false,
            watchdog_set: false,
            doubtful: false,
            recognised: false,
            commanded_ns: 0,
            interlocked: true,
            patience: 0,
            instead: Instead::default(),
        };
        Ok(Bus {
            transport,
            byte_ns: byte_time_ns(config.baud),
            margin_ns: config.margin_ns,
            units: config.units.iter().map(unit).collect(),
            step: step::Step::Draining { quiet_from_ns: 0 },
            noisy_from_ns: None,
            connection: 0,
            empty: false,
            excess: 0,
            last_unit: 0,
            next_fence: 0,
            turnaround_ns: 500_000,
            sent_stamp_ns: 0,
            in_cycle: false,
            inline: false,
            call_began_ns: 0,
            call_ends_ns: u64::MAX,
            usual_call_ns: 0,
            slow_turn: 0,
            slow_left_out: false,
            overdue: Overdue::default(),
            overdue_turn: 0,
            current_turn: 0,
            counters: Counters::default(),
            stop_pin: config.stop_pin,
            stop: StopInput::default(),
        })
    }

    /// Name of the port.
    pub fn name(&self) -> &Arc<str> {
        self.transport.name()
    }

    /// The port.
    pub fn transport(&self) -> &T {
        &self.transport
    }

    /// The port. Bytes written to it past this driver bring it out of step, which it detects.
    pub fn transport_mut(&mut self) -> &mut T {
        &mut self.transport
    }

    /// Number of units.
    pub fn unit_count(&self) -> usize {
        self.units.len()
    }

    /// Version text of a unit, once it was read.
    pub fn version(&self, unit: usize) -> Option<Version> {
        self.units.get(unit).and_then(|unit| unit.version)
    }

    /// Newest readings of a unit.
    pub fn report(&self, unit: usize) -> Option<&UnitReport> {
        self.units.get(unit).map(|unit| &unit.report)
    }

    /// Event counts.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Stop input, as last read.
    pub fn stop(&self) -> &StopInput {
        &self.stop
    }

    /// True where every unit is in use and the bus in step: nothing is left to do between cycles. The next cycle itself
    /// waits on for an answer that was left to it.
    pub fn is_settled(&self) -> bool {
        let waits = self.inline && matches!(self.step, step::Step::Late(_));
        (waits || self.step == step::Step::Settled) && self.units.iter().all(|unit| unit.phase == Phase::Ready)
    }

    /// Begins a call that has to end by `deadline_ns` where the bus runs inline.
    fn begin_call(&mut self, deadline_ns: u64) {
        self.call_began_ns = self.transport.now_ns();
        self.call_ends_ns = if self.inline { deadline_ns } else { u64::MAX };
    }

    /// Reads the stop input. One that cannot be read is a stop.
    fn read_stop(&mut self) {
        if let Some(pin) = self.stop_pin {
            self.stop = StopInput::read(&mut self.transport, pin);
        }
    }

    fn port(&self) -> Arc<str> {
        Arc::clone(self.transport.name())
    }
}
