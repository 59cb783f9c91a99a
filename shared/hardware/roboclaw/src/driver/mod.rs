//! One line with several units on it, in step with them or on the way back to it.
//!
//! The rules, and why:
//! * Before anything is sent the line has to be empty, and an answer has to be exactly right in length, checksum and origin.
//! * After any error nothing is simply asked again: the answer may only be late, and would then be taken for the answer to the next
//!   question. Instead the line is drained until it was silent for as long as also empties the units' parsers, and the unit that
//!   failed is asked something the cycle never asks (a *fence*, another one each time). Units answer in order, so once the
//!   fence's answer is there, and nothing after it, no old answer can come any more.
//! * A unit that has failed is then asked for its watchdog: it is set to a value the unit does not start with, so a unit that has
//!   restarted is found out, and its encoders, which began again at zero, are not taken for a movement.
//! * A unit that answers later than the margin is given more and more time, up to four times the margin, on its way back into use: a
//!   starved computer or a slow adapter would otherwise never get through it. Cycles wait for nobody: there the margin stays.
//! * All of it is one state machine that moves on as far as a call's deadline allows, so that a silent unit costs the others a few
//!   cycles and not their watchdogs.

mod cycle;
mod exchange;
mod family;
mod step;
mod sync;

use std::sync::Arc;

use drives::{CountBound, Counters, Error, Misfit, StopInput, UnitReport};
use serial::{StatusPin, Transport, byte_time_ns};

use crate::codec::{ADDRESSES, Version};
use crate::status::StatusWidth;

/// Most units on one line: the protocol has eight addresses.
pub const MAX_UNITS: usize = 8;

/// Time a unit on a wire has to begin its answer, beside the time of the bytes themselves: the manual's 10 ms and a bit.
pub const WIRE_MARGIN_NS: u64 = 12_000_000;

/// The same over USB, whose frames, adapters and kernel threads add their own pauses.
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
pub fn watchdog_tenths(seconds: f64) -> Result<u8, Misfit> {
    let tenths = (seconds * 10.0).round();
    if (1.0..=255.0).contains(&tenths) && (seconds * 10.0 - tenths).abs() < 1e-6 {
        return Ok(tenths as u8);
    }
    // `as` saturates, and turns a NaN into 0.
    Err(Misfit::Watchdog { given_ms: (seconds * 1e3) as u32, accepted: ACCEPTED_WATCHDOGS })
}

/// What one motor of a unit is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Drive {
    /// Nothing is said to it; its watchdog goes on.
    #[default]
    Idle,
    /// Closed-loop speed, counts per second.
    Speed(i32),
    /// Duty in 1/32767 of the supply, without the loop.
    Duty(i16),
}

impl Drive {
    /// Closed-loop standstill: the motor pushes back.
    pub const HOLD: Drive = Drive::Speed(0);
    /// Leads shorted, loop open: the right stop where the encoder cannot be believed; a gear that can be back-driven creeps.
    pub const RELEASE: Drive = Drive::Duty(0);

    fn moves(self) -> bool {
        !matches!(self, Drive::Idle | Drive::HOLD | Drive::RELEASE)
    }
}

/// A unit on a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitConfig {
    /// 0x80 to 0x87.
    pub address: u8,
    /// The unit stops its motors when it hears nothing for so many tenths of a second, 1 to 255. Choose another value than the
    /// unit starts with (usually 0): the difference is how a restart is found out.
    pub watchdog_tenths: u8,
    /// Motion of the counts that needs no explanation. A sample beyond it is held back until the unit has shown by its watchdog that it
    /// did not restart; then it is passed on, and counted as a jump.
    pub bound: CountBound,
}

/// A line and its units.
#[derive(Debug, Clone, PartialEq)]
pub struct BusConfig {
    /// Bits per second, to know how long bytes take; 0 where they take no time worth counting (USB).
    pub baud: u32,
    /// Time to the beginning of an answer, see [`WIRE_MARGIN_NS`].
    pub margin_ns: u64,
    /// The units, in the order in which commands and answers have them.
    pub units: Vec<UnitConfig>,
    /// A stop button's closed contact holds this pin on; an open contact or a broken wire is a stop.
    pub stop_pin: Option<StatusPin>,
}

/// One unit, as the driver sees it.
#[derive(Debug)]
struct Unit {
    config: UnitConfig,
    /// Name in messages.
    name: Arc<str>,
    phase: Phase,
    report: UnitReport,
    version: Option<Version>,
    /// How wide its status is; unknown until it was asked once.
    width: Option<StatusWidth>,
    /// The unit's own 32 bits at the last accepted sample.
    last_raw: Option<[u32; 2]>,
    /// The last sample was beyond the bound and was held back.
    held_back: bool,
    /// In this life of the unit its watchdog was set, and seen to be set: another value means another life.
    told: bool,
    /// Ask for the watchdog before anything else that can wait.
    doubtful: bool,
    /// It moves only after it was told to stand still.
    interlocked: bool,
    /// How often its answers came too late on its way back into use, and not in time since; see [`Bus::patience_ns`].
    patience: u8,
    /// What came in place of its answer when it was last asked in vain.
    instead: step::Instead,
}

/// How far a unit is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// An answer of it may still be on its way: a fence is due at `due_ns`, after so many that failed.
    Suspect { failed: u32, due_ns: u64 },
    /// In step; what it is to be asked before it is used.
    Setup(step::Setup),
    /// In use.
    Ready,
    /// It does not do what it is told; asked again at `due_ns`.
    Unusable { wanted: u8, got: u8, due_ns: u64 },
}

/// A line with units. One thread owns it: two users of one line garble each other's answers.
#[derive(Debug)]
pub struct Bus<T> {
    transport: T,
    byte_ns: u64,
    margin_ns: u64,
    units: Vec<Unit>,
    step: step::Step,
    /// Since when bytes have come that nobody asked for, without a pause.
    noisy_from_ns: Option<u64>,
    connection: u32,
    /// The unit that was spoken to last: unexpected bytes are most likely its.
    last_unit: usize,
    next_fence: usize,
    /// Usual time from the last byte sent to the first received, beside the bytes' own time.
    turnaround_ns: u64,
    /// When the last packet was sent, as others stamp it.
    sent_stamp_ns: u64,
    slow_turn: usize,
    slow_left_out: bool,
    current_turn: usize,
    counters: Counters,
    stop_pin: Option<StatusPin>,
    stop: StopInput,
}

impl<T: Transport> Bus<T> {
    /// A line that is not spoken to yet. The line's device need not be there.
    pub fn new(transport: T, config: &BusConfig) -> Result<Bus<T>, Error> {
        let port = Arc::clone(transport.name());
        let wrong = |what| Err(Error::Configuration { port: Arc::clone(&port), what });
        if config.units.is_empty() {
            return wrong(Misfit::NoUnits);
        }
        for (index, unit) in config.units.iter().enumerate() {
            if !ADDRESSES.contains(&unit.address) {
                return wrong(Misfit::Address { given: unit.address, accepted: ACCEPTED_ADDRESSES });
            }
            if config.units[..index].iter().any(|other| other.address == unit.address) {
                return wrong(Misfit::AddressTwice);
            }
            if unit.watchdog_tenths == 0 {
                return wrong(Misfit::Watchdog { given_ms: 0, accepted: ACCEPTED_WATCHDOGS });
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
            told: false,
            doubtful: false,
            interlocked: true,
            patience: 0,
            instead: step::Instead::default(),
        };
        Ok(Bus {
            transport,
            byte_ns: byte_time_ns(config.baud),
            margin_ns: config.margin_ns,
            units: config.units.iter().map(unit).collect(),
            step: step::Step::Draining { quiet_from_ns: 0 },
            noisy_from_ns: None,
            connection: 0,
            last_unit: 0,
            next_fence: 0,
            turnaround_ns: 500_000,
            sent_stamp_ns: 0,
            slow_turn: 0,
            slow_left_out: false,
            current_turn: 0,
            counters: Counters::default(),
            stop_pin: config.stop_pin,
            stop: StopInput::default(),
        })
    }

    /// The line's name.
    pub fn name(&self) -> &Arc<str> {
        self.transport.name()
    }

    /// The line.
    pub fn transport(&self) -> &T {
        &self.transport
    }

    /// The line. Bytes written to it past this driver bring the driver out of step, which it will notice.
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

    /// The newest known values of a unit.
    pub fn report(&self, unit: usize) -> Option<&UnitReport> {
        self.units.get(unit).map(|unit| &unit.report)
    }

    /// What happened on this line so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The stop input, as it was when time was last spent on the line.
    pub fn stop(&self) -> &StopInput {
        &self.stop
    }

    /// True where every unit is in use and the line in step: nothing is left to do between cycles.
    pub fn is_settled(&self) -> bool {
        self.step == step::Step::Settled && self.units.iter().all(|unit| unit.phase == Phase::Ready)
    }

    /// An input that cannot be read is no better than one that says stop.
    fn look_at_stop(&mut self) {
        if let Some(pin) = self.stop_pin {
            self.stop = match self.transport.is_on(pin) {
                Ok(true) => StopInput::Released,
                Ok(false) => StopInput::Pressed,
                Err(error) => StopInput::Unreadable(Error::Serial(error)),
            };
        }
    }

    fn port(&self) -> Arc<str> {
        Arc::clone(self.transport.name())
    }
}
