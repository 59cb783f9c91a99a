//! Driver of one port: a unit on a UART, or several behind a USB adapter.
//!
//! The rules, and why:
//! * A cycle sends one frame to each unit, all at once: the command, and questions about clock, mode, position and the
//!   command itself. A unit writes before it reads, so the answer shows what it will do.
//! * An answer is used only if its checksum, its unit, the order of its registers and the unit's clock say that it
//!   answers this question (`question.rs`, `clock.rs`). Any other answer is dropped, so nothing has to be waited out
//!   after an error: the next question, with another tag, is the resynchronisation.
//! * A command counts as accepted only if the unit reads back its velocity and its time limit. The time limit of a
//!   command is the watchdog of this family: a unit that receives nothing for so long brakes, and moves again only
//!   after a stop.
//! * Torque is a command to hold no position and no velocity, with all of the torque as feedforward. The unit stores it
//!   as a float and reads the same bits back.
//! * A clock that went back is a restart; the driver asks once more before it concludes that.
//! * A unit in fault or timeout does not move before it was commanded to hold or to release: that sends the stop which
//!   clears both.
//! * moteus has no stop input of its own. A contact on pin 1 of the second auxiliary port is reported as the emergency
//!   stop, and the driver stops the unit as long as it is open.

mod clock;
mod cycle;
mod family;
mod question;
mod receive;
mod round;
mod second;
mod setup;

use std::sync::Arc;

use arrayvec::ArrayString;
use drives::{CountBound, Counters, Error, Inbox, InvalidConfig, Noise, Overdue, Setup, StopInput, UnitReport};
use serial::{StatusPin, Transport, byte_time_ns};

use crate::codec::{ADDRESSES, Checksums, MAX_LINE, Mode, SOURCES};
use clock::ClockReading;
pub use second::SECOND_STEP_COUNTS;

/// Most units on one port: one for each of the most cables of a robot.
pub const MAX_UNITS: usize = 8;

/// Time that a unit on a UART has to begin its answer, besides the time of the bytes, ns. It answers within a
/// millisecond.
pub const UART_MARGIN_NS: u64 = 3_000_000;

/// The same over USB, where frames, adapters and kernel threads add delays.
pub const USB_MARGIN_NS: u64 = 25_000_000;

/// [`ADDRESSES`] in messages.
const ACCEPTED_ADDRESSES: &str = "1 to 126";
/// Sources in messages.
const ACCEPTED_SOURCES: &str = "a second encoder at source 0 to 2";
/// Watchdog times in messages.
const ACCEPTED_WATCHDOGS: &str = "20 to 30000 ms";

/// Watchdog of this many seconds, ms: the time limit of each command, 16 bits of milliseconds.
///
/// # Errors
/// The units cannot be set to this time.
pub fn watchdog_ms(seconds: f64) -> Result<u16, InvalidConfig> {
    drives::watchdog_ms(seconds, 20..=30_000, ACCEPTED_WATCHDOGS)
}

/// Settings of a unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnitConfig {
    /// Its identifier, `id.id` in the maker's program.
    pub address: u8,
    /// Time limit of each command, ms.
    pub watchdog_ms: u16,
    /// Motion of the counts that needs no explanation; a sample beyond it is held back once.
    pub bound: CountBound,
    /// Torque that the unit states per ampere, N m/A; 0: not known, and no torque can be commanded.
    pub torque_constant_n_m_a: f64,
    /// A second encoder that turns with the same cable.
    pub second: Option<SecondInput>,
}

/// A second encoder at a unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SecondInput {
    /// Its number among the sources of `motor_position`, 0 to 2.
    pub source: u8,
    /// Motion of its count, by which the driver knows whether it has turned less than half a turn between two answers.
    pub bound: CountBound,
}

/// Settings of a port and its units.
#[derive(Debug, Clone, PartialEq)]
pub struct BusConfig {
    /// Bits per second, for the time that bytes take; 0 where it is negligible (USB).
    pub baud: u32,
    /// Time to the beginning of an answer, ns; see [`UART_MARGIN_NS`].
    pub margin_ns: u64,
    /// Whether lines have checksums.
    pub checksums: Checksums,
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
    setup: Setup,
    report: UnitReport,
    /// Number of the unit's last question, which is the order of its registers.
    tag: u32,
    firmware: Option<ArrayString<48>>,
    /// The unit's own count at the last accepted sample.
    last_raw: Option<i32>,
    /// Reading of the second encoder at the last accepted sample, and of the unit's clock, ms.
    last_second: Option<(i32, i32)>,
    /// The second encoder was read before.
    second_seen: bool,
    /// The last sample was beyond the bound and was held back.
    held_back: bool,
    /// The last command was read back with another time limit.
    doubtful: bool,
    mode: Mode,
    fault: i32,
    pins: i32,
    /// The last accepted reading of its clock.
    clock: Option<ClockReading>,
    /// A reading that the last one does not explain: a restart, if the next one agrees with it.
    suspect: Option<ClockReading>,
}

/// Driver of the units on one port. One thread owns it.
#[derive(Debug)]
pub struct Bus<T> {
    transport: T,
    byte_ns: u64,
    margin_ns: u64,
    checksums: Checksums,
    units: Vec<Unit>,
    overdue: Overdue,
    inbox: Inbox<MAX_LINE>,
    connection: u32,
    /// Number of the last question.
    asked: u32,
    /// Time of the last question about what changes slowly, ns.
    slow_ns: u64,
    noise: Noise,
    counters: Counters,
    stop_pin: Option<StatusPin>,
    stop: StopInput,
}

impl Unit {
    fn new(config: &UnitConfig, tag: u32) -> Unit {
        Unit {
            tag,
            config: *config,
            name: format!("unit {}", config.address).into(),
            setup: Setup::default(),
            report: UnitReport::default(),
            firmware: None,
            last_raw: None,
            last_second: None,
            second_seen: false,
            held_back: false,
            doubtful: false,
            mode: Mode::STOPPED,
            fault: 0,
            pins: 0,
            clock: None,
            suspect: None,
        }
    }
}

impl<T: Transport> Bus<T> {
    /// A bus on which nothing was sent yet. The device need not be there.
    ///
    /// # Errors
    /// A setting that the family does not have.
    pub fn new(transport: T, config: &BusConfig) -> Result<Bus<T>, Error> {
        let port = Arc::clone(transport.name());
        let invalid = |what| Error::Configuration { port: Arc::clone(&port), what };
        let wrong = |what| Err(invalid(what));
        if config.units.is_empty() {
            return wrong(InvalidConfig::NoUnits);
        }
        if config.units.len() > MAX_UNITS {
            return wrong(InvalidConfig::TooManyUnits);
        }
        for (index, unit) in config.units.iter().enumerate() {
            if !ADDRESSES.contains(&unit.address) {
                return wrong(InvalidConfig::Address { given: unit.address, accepted: ACCEPTED_ADDRESSES });
            }
            if config.units[..index].iter().any(|other| other.address == unit.address) {
                return wrong(InvalidConfig::AddressTwice);
            }
            watchdog_ms(f64::from(unit.watchdog_ms) * 1e-3).map_err(invalid)?;
            if unit.second.is_some_and(|second| second.source >= SOURCES) {
                return wrong(InvalidConfig::Address { given: unit.address, accepted: ACCEPTED_SOURCES });
            }
        }
        // Another first tag for each start: answers to the program's last run are old too.
        let tag = (transport.now_ns() / 1000) as u32;
        Ok(Bus {
            transport,
            byte_ns: byte_time_ns(config.baud),
            margin_ns: config.margin_ns,
            checksums: config.checksums,
            units: config.units.iter().map(|unit| Unit::new(unit, tag)).collect(),
            overdue: Overdue::default(),
            inbox: Inbox::default(),
            connection: 0,
            asked: 0,
            slow_ns: 0,
            noise: Noise::default(),
            counters: Counters::default(),
            stop_pin: config.stop_pin,
            stop: StopInput::default(),
        })
    }

    /// The port.
    pub fn transport(&self) -> &T {
        &self.transport
    }

    /// The port.
    pub fn transport_mut(&mut self) -> &mut T {
        &mut self.transport
    }

    fn port(&self) -> Arc<str> {
        Arc::clone(self.transport.name())
    }

    fn error(&self, unit: usize, error: impl FnOnce(Arc<str>, Arc<str>) -> Error) -> Error {
        let port = self.port();
        let unit = self.units.get(unit).map_or_else(|| Arc::clone(&port), |unit| Arc::clone(&unit.name));
        error(port, unit)
    }

    fn wire_ns(&self, bytes: usize) -> u64 {
        bytes as u64 * self.byte_ns
    }

    /// Reads the stop input. One that cannot be read is a stop.
    fn read_stop(&mut self) {
        if let Some(pin) = self.stop_pin {
            self.stop = StopInput::read(&mut self.transport, pin);
        }
    }

    /// Connects if necessary. After a new connection every unit may have restarted.
    fn connect(&mut self) -> Result<(), Error> {
        match self.transport.connection() {
            Err(error) => Err(self.port_failed(error)),
            Ok(connection) => {
                if connection != self.connection {
                    self.connection = connection;
                    self.counters.connections += 1;
                    self.lose_all();
                }
                Ok(())
            }
        }
    }

    fn port_failed(&mut self, error: serial::Error) -> Error {
        if error.is_lost() {
            self.lose_all();
        }
        Error::Serial(error)
    }

    /// Marks every unit as unknown, after the connection was lost.
    fn lose_all(&mut self) {
        self.inbox.clear();
        self.units.iter_mut().for_each(|unit| unit.setup.lost());
    }
}
