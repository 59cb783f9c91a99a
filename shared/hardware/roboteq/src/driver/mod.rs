//! Driver of the controller on one port.
//!
//! Answers have neither checksum nor number, so each proof is made of several answers. The rules, and why:
//! * **Fresh.** Sixteen user variables of the controller have numbers, of which any two differ in two digits. Each
//!   batch of lines begins with a question about another one of them. A wire keeps the order, so what arrives after
//!   that number was asked after it. Every sixteen batches the order of the questions changes too. A controller that
//!   has restarted answers 0, and only questions are needed, which do not feed the watchdog.
//! * **Whole.** Between the number and the end of a batch each line has to be the answer to its question, in the form
//!   in which a controller writes it. Otherwise nothing of the batch is used; the next one is the resynchronisation.
//! * **Obeyed.** A command counts as accepted only if the controller reads it back, twice where the wire has lately had
//!   errors: a changed digit of the command and one of the answer can cancel each other out.
//! * **Counted.** A changed digit makes another number, and no checksum shows it. So the counters are asked twice in a
//!   row, and the two answers must agree within what the motors can move meanwhile. Of the two and of where the motion
//!   so far leads, the middle one is used: where one answer is wrong, it lies between the right one and the motion. A
//!   motion that changes abruptly is used once it was read again. Flags have to be the same twice, and of currents,
//!   outputs and voltages the middle one of three is used.
//! * **Commands.** Both motors are commanded by one line, `!M`. A single changed bit makes `!G` and `!S` into `!C`,
//!   which sets a counter.
//! * **Watchdog.** Only commands feed it, and after it any command resumes the speeds of before. So zeros are the first
//!   command that a new controller gets, and numbers are written afterwards.
//! * A released motor is in open loop with a command of 0. The operating mode is changed, and read back, in a batch of
//!   its own with a command of 0, so that no speed is ever taken for an output.

mod batch;
mod counted;
mod counts;
mod cycle;
mod family;
mod filter;
mod flags;
mod listen;
mod parts;
mod setup;
mod slow;

use std::sync::Arc;

use arrayvec::ArrayString;
use drives::{
    CountBound, Counters, Error, Inbox, InvalidConfig, Noise, Overdue, ReplyText, Setup, SetupStep, StopInput,
    UnitReport,
};
use serial::{StatusPin, Transport, byte_time_ns};

use crate::codec::{AXES, MAX_LINE};

/// Time that a controller on a UART has to begin its answer, besides the time of the bytes, ns.
pub const UART_MARGIN_NS: u64 = 3_000_000;

/// The same behind USB, where frames, adapters and kernel threads add delays.
pub const USB_MARGIN_NS: u64 = 25_000_000;

/// Watchdog times in messages.
const ACCEPTED_WATCHDOGS: &str = "20 to 65000 ms";

/// Watchdog of this many seconds, ms.
///
/// # Errors
/// The controllers cannot be set to this time.
pub fn watchdog_ms(seconds: f64) -> Result<u16, InvalidConfig> {
    drives::watchdog_ms(seconds, 20..=65_000, ACCEPTED_WATCHDOGS)
}

/// Settings of a port and its controller.
#[derive(Debug, Clone, PartialEq)]
pub struct BusConfig {
    /// Bits per second, for the time that bytes take; 0 where it is negligible (USB).
    pub baud: u32,
    /// Time to the beginning of an answer, ns; see [`UART_MARGIN_NS`].
    pub margin_ns: u64,
    /// Name of the controller in messages; the protocol has no address.
    pub address: u8,
    /// Motors, 1 or 2, from channel 1.
    pub axes: usize,
    /// Time without a command after which the motors stop, ms.
    pub watchdog_ms: u16,
    /// Motion of the counts that needs no explanation; a sample beyond it is held back once.
    pub bound: CountBound,
    /// Pin that the closed contact of a stop button holds on; an open contact or a broken wire is a stop.
    pub stop_pin: Option<StatusPin>,
}

/// Driver of the controller on one port. One thread owns it.
#[derive(Debug)]
pub struct Bus<T> {
    transport: T,
    config: BusConfig,
    byte_ns: u64,
    /// Name in messages.
    name: Arc<str>,
    setup: Setup,
    /// Part of the present step of the setup.
    stage: (Option<SetupStep>, usize),
    report: UnitReport,
    firmware: Option<ArrayString<48>>,
    /// The controller does not send back what it receives, and repeats no question.
    hushed: bool,
    /// The controller has the numbers in its variables.
    marked: bool,
    /// Answers in a row that do not tell whether it has.
    unclear: u32,
    /// Reason why the controller cannot be used as it is set, and when that is read again, ns.
    unfit: Option<(ReplyText, u64)>,
    /// Counts per second of a command of 1, for each motor.
    scales_counts_s: [f64; AXES],
    /// Operating modes, as last read.
    modes: [i32; AXES],
    /// Open loop is a mode that this driver has set.
    released: bool,
    /// Commands, as last sent.
    sent: [i32; AXES],
    counted: counted::Counted,
    flags: flags::Flags,
    /// Questions of the last batch whose answers are still to come.
    tail: Option<parts::Tail>,
    overdue: Overdue,
    inbox: Inbox<MAX_LINE>,
    connection: u32,
    /// Batches until the wire is without errors again.
    noisy: u32,
    /// Batches sent.
    turn: usize,
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
        // Another first question for each start: answers to the program's last run are old too.
        let turn = (transport.now_ns() / 1000 % 1000) as usize;
        Ok(Bus {
            transport,
            byte_ns: byte_time_ns(config.baud),
            name: format!("controller {}", config.address).into(),
            config: config.clone(),
            setup: Setup::default(),
            stage: (None, 0),
            report: UnitReport::default(),
            firmware: None,
            hushed: false,
            marked: false,
            unclear: 0,
            unfit: None,
            scales_counts_s: [0.0; AXES],
            modes: [0; AXES],
            released: false,
            sent: [0; AXES],
            counted: counted::Counted::default(),
            flags: flags::Flags::default(),
            tail: None,
            overdue: Overdue::default(),
            inbox: Inbox::default(),
            connection: 0,
            noisy: 0,
            turn,
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

    fn axes(&self) -> std::ops::Range<usize> {
        0..self.config.axes
    }

    /// Reads the stop input. One that cannot be read is a stop.
    fn read_stop(&mut self) {
        if let Some(pin) = self.config.stop_pin {
            self.stop = StopInput::read(&mut self.transport, pin);
        }
    }

    /// Connects if necessary. After a new connection the controller may have restarted.
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

    /// Marks the controller as unknown, after the connection was lost.
    fn lose(&mut self) {
        self.inbox.clear();
        (self.hushed, self.tail, self.unfit) = (false, None, None);
        self.setup.lost();
    }
}
