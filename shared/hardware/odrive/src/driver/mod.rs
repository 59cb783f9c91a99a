//! Driver of the board on one port.
//!
//! The rules, and why:
//! * Each exchange is one batch of lines: a mark, commands, questions, another mark. Answers are used only if all of
//!   them arrived between the answers to the two marks, each with its checksum and of the form of its question. A mark
//!   is a number that no axis has, another one each time, so an answer to an older batch is never used, and nothing has
//!   to be waited out after an error: the next batch is the resynchronisation.
//! * A checksum of eight bits misses errors that cancel, such as a digit lost and the same one doubled. So a command is
//!   read back, and a position to which the motion does not lead is used once it was read again.
//! * Commands are silent. A command counts as accepted only if the board reads back its velocity or torque and the
//!   state of the axis, and after a change from one to the other also which of them it controls: the two have a value
//!   each, so that of a lost command may be there already.
//! * The watchdog is a setting of each axis that is not saved in the board: where it is gone, the board has restarted.
//!   Its expiry disarms the axis, which turns freely.
//! * A disarmed axis does not move before it was commanded to hold or to release: that clears the errors.

mod batch;
mod cycle;
mod family;
mod setup;

mod ask;

use std::sync::Arc;

use arrayvec::ArrayString;
use drives::{CountBound, Counters, Error, Inbox, InvalidConfig, Noise, Overdue, Setup, StopInput, UnitReport};
use serial::{StatusPin, Transport, byte_time_ns};

use crate::codec::{AXES, MARKS, MAX_LINE};

/// Time that a board on a UART has to begin its answer, besides the time of the bytes, ns.
pub const UART_MARGIN_NS: u64 = 3_000_000;

/// The same over USB, where frames, adapters and kernel threads add delays.
pub const USB_MARGIN_NS: u64 = 25_000_000;

/// Watchdog times in messages.
const ACCEPTED_WATCHDOGS: &str = "20 to 30000 ms";

/// Watchdog of this many seconds, ms.
///
/// # Errors
/// The boards cannot be set to this time.
pub fn watchdog_ms(seconds: f64) -> Result<u16, InvalidConfig> {
    drives::watchdog_ms(seconds, 20..=30_000, ACCEPTED_WATCHDOGS)
}

/// Settings of a port and its board.
#[derive(Debug, Clone, PartialEq)]
pub struct BusConfig {
    /// Bits per second, for the time that bytes take; 0 where it is negligible (USB).
    pub baud: u32,
    /// Time to the beginning of an answer, ns; see [`UART_MARGIN_NS`].
    pub margin_ns: u64,
    /// Name of the board in messages; the protocol has no address.
    pub address: u8,
    /// Axes with a motor, 1 or 2, from axis 0.
    pub axes: usize,
    /// Time without a command after which an axis is disarmed, ms.
    pub watchdog_ms: u16,
    /// Motion of the counts that needs no explanation; a sample beyond it is held back once.
    pub bound: CountBound,
    /// Torque of an axis per ampere, `motor.config.torque_constant`, N m/A; 0: not known, and no torque can be
    /// commanded.
    pub torque_constant_n_m_a: f64,
    /// Pin that the closed contact of a stop button holds on; an open contact or a broken wire is a stop.
    pub stop_pin: Option<StatusPin>,
}

/// Driver of the board on one port. One thread owns it.
#[derive(Debug)]
pub struct Bus<T> {
    transport: T,
    config: BusConfig,
    byte_ns: u64,
    /// Name in messages.
    name: Arc<str>,
    setup: Setup,
    report: UnitReport,
    firmware: Option<ArrayString<48>>,
    /// Counts at the last accepted sample, as the board has them.
    last_raw: Option<[i64; AXES]>,
    /// The last sample was beyond the bound and was held back.
    held_back: bool,
    /// Where the motion leads.
    motion: drives::Track,
    /// States of the axes, as last read.
    states: [u32; AXES],
    errors: [u32; AXES],
    /// What each axis controls, as last read since it was commanded; `None`: perhaps something else.
    controls: [Option<u32>; AXES],
    /// An axis left its closed loop by itself, and why has not been read.
    tripped: bool,
    overdue: Overdue,
    inbox: Inbox<MAX_LINE>,
    connection: u32,
    next_mark: u32,
    noise: Noise,
    counters: Counters,
    stop: StopInput,
}

impl<T: Transport> Bus<T> {
    /// A bus on which nothing was sent yet. The device need not be there.
    ///
    /// # Errors
    /// A setting that the family does not have.
    pub fn new(transport: T, config: &BusConfig) -> Result<Bus<T>, Error> {
        let port = Arc::clone(transport.name());
        let invalid = |what| Error::Configuration { port: Arc::clone(&port), what };
        if !(1..=AXES).contains(&config.axes) {
            return Err(invalid(InvalidConfig::NoUnits));
        }
        watchdog_ms(f64::from(config.watchdog_ms) * 1e-3).map_err(invalid)?;
        // Other first marks for each start: answers to the program's last run are old too.
        let next_mark = MARKS.start + (transport.now_ns() / 1000 % u64::from(MARKS.end - MARKS.start)) as u32;
        Ok(Bus {
            transport,
            byte_ns: byte_time_ns(config.baud),
            name: format!("board {}", config.address).into(),
            config: config.clone(),
            setup: Setup::default(),
            report: UnitReport::default(),
            firmware: None,
            last_raw: None,
            held_back: false,
            motion: drives::Track::default(),
            states: [0; AXES],
            errors: [0; AXES],
            controls: [None; AXES],
            tripped: false,
            overdue: Overdue::default(),
            inbox: Inbox::default(),
            connection: 0,
            next_mark,
            noise: Noise::default(),
            counters: Counters::default(),
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

    fn error(&self, error: impl FnOnce(Arc<str>, Arc<str>) -> Error) -> Error {
        error(self.port(), Arc::clone(&self.name))
    }

    fn wire_ns(&self, bytes: usize) -> u64 {
        bytes as u64 * self.byte_ns
    }

    /// Reads the stop input. One that cannot be read is a stop.
    fn read_stop(&mut self) {
        if let Some(pin) = self.config.stop_pin {
            self.stop = StopInput::read(&mut self.transport, pin);
        }
    }

    /// Connects if necessary. After a new connection the board may have restarted.
    fn connect(&mut self) -> Result<(), Error> {
        match self.transport.connection() {
            Err(error) => Err(self.port_failed(error)),
            Ok(connection) => {
                if connection != self.connection {
                    self.connection = connection;
                    self.counters.connections += 1;
                    self.lose();
                }
                Ok(())
            }
        }
    }

    fn port_failed(&mut self, error: serial::Error) -> Error {
        if error.is_lost() {
            self.lose();
        }
        Error::Serial(error)
    }

    /// Marks the board as unknown, after the connection was lost.
    fn lose(&mut self) {
        self.inbox.clear();
        self.controls = [None; AXES];
        self.setup.lost();
    }
}
