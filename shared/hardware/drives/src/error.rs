//! Failures between this program and a unit, classified by their remedy.

use std::fmt;
use std::ops::RangeInclusive;
use std::sync::Arc;

use arrayvec::ArrayString;

/// A command or question to a unit, in the words of its family: `read watchdog (command 15)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CommandName {
    /// What it does.
    pub words: &'static str,
    /// Its number in the protocol, where it has one.
    pub code: Option<u16>,
}

impl fmt::Display for CommandName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.code {
            Some(code) => write!(f, "{} (command {code})", self.words),
            None => f.write_str(self.words),
        }
    }
}

/// What a unit answered, in its own words; on the stack, because errors occur in the control cycle.
pub type ReplyText = ArrayString<32>;

/// Formats an answer for [`Error::Unexpected`]; cut off at the end of the buffer.
#[must_use]
pub fn reply_text(answer: fmt::Arguments<'_>) -> ReplyText {
    struct Cut(ReplyText);
    impl fmt::Write for Cut {
        fn write_str(&mut self, part: &str) -> fmt::Result {
            part.chars().try_for_each(|letter| self.0.try_push(letter).map_err(|_| fmt::Error))
        }
    }
    let mut cut = Cut(ReplyText::new());
    let _ = fmt::write(&mut cut, answer);
    cut.0
}

/// Reason why a unit did not execute a command or answer a question. Cloning one does not allocate.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // port, unit and asked are the same everywhere: where it happened and what was asked
pub enum Error {
    /// No byte arrived in time.
    #[error("{port}, {unit}: no answer to {asked} within {waited_us} us; check power, wiring, address and baud")]
    NoAnswer { port: Arc<str>, unit: Arc<str>, asked: CommandName, waited_us: u32 },
    /// The answer ended early.
    #[error("{port}, {unit}: the answer to {asked} broke off after {got} of {wanted} bytes")]
    CutShort { port: Arc<str>, unit: Arc<str>, asked: CommandName, got: usize, wanted: usize },
    /// The answer was changed on the wire, or belongs to another question.
    #[error("{port}, {unit}: the answer to {asked} has a wrong checksum; look for noise or two units of one address")]
    Garbled { port: Arc<str>, unit: Arc<str>, asked: CommandName },
    /// The answer is not one that the protocol has for this question.
    #[error("{port}, {unit}: {asked} was answered by {said}")]
    Unexpected { port: Arc<str>, unit: Arc<str>, asked: CommandName, said: ReplyText },
    /// Bytes that answer no question had arrived, so the next answer could not have been trusted.
    #[error("{port}, {unit}: {bytes} unexpected bytes received before {asked}")]
    Stray { port: Arc<str>, unit: Arc<str>, asked: CommandName, bytes: usize },
    /// The bus resynchronises after an error; nothing was sent.
    #[error("{port}: resynchronising with the units after an error on the bus")]
    Resynchronising { port: Arc<str> },
    /// The unit has not answered several attempts; the driver tries again twice a second.
    #[error("{port}, {unit}: silent; it is asked again twice a second; check its power, its wiring and its address")]
    Silent { port: Arc<str>, unit: Arc<str> },
    /// Only the driver's own bytes come back: a loopback, an adapter with local echo, or a bus without a unit.
    #[error(
        "{port}, {unit}: nothing comes back but what was sent; connect the unit, and remove the loopback or switch off the adapter's echo"
    )]
    Echo { port: Arc<str>, unit: Arc<str> },
    /// Something answers, but not this unit.
    #[error(
        "{port}, {unit}: what comes back is not an answer of this unit; check that it is the drives' port, its baud and the address"
    )]
    Foreign { port: Arc<str>, unit: Arc<str> },
    /// Bytes arrive without a pause, so nothing can be asked.
    #[error(
        "{port}: bytes arrive without end though nothing was asked; check that it is the drives' port, and its baud and wiring"
    )]
    Babble { port: Arc<str> },
    /// The unit answers and is being set up; nothing was commanded yet.
    #[error("{port}, {unit}: being set up; it takes commands in a moment")]
    Preparing { port: Arc<str>, unit: Arc<str> },
    /// The unit was lost or restarted, and has not been commanded to hold since.
    #[error("{port}, {unit}: it was lost or restarted, so it does not move before it was commanded to hold once")]
    Interlocked { port: Arc<str>, unit: Arc<str> },
    /// An encoder moved further than its motor can turn; this sample was held back.
    #[error(
        "{port}, {unit}: encoder {} jumped by {counts} counts, more than the motor can turn; \
         check the encoder's cable and whether the unit has restarted", axis + 1
    )]
    EncoderJump { port: Arc<str>, unit: Arc<str>, axis: usize, counts: i64 },
    /// The unit did not keep the watchdog time that was set.
    #[error(
        "{port}, {unit}: keeps a watchdog of {got_ms} ms instead of {wanted_ms} ms; \
         it would not stop its motors when this program ends, so it is not used"
    )]
    WatchdogRefused { port: Arc<str>, unit: Arc<str>, wanted_ms: u32, got_ms: u32 },
    /// The drive family has no such command.
    #[error("{port}, {unit}: this drive family has no {what}")]
    Unsupported { port: Arc<str>, unit: Arc<str>, what: &'static str },
    /// The time of this cycle was over before anything could be sent.
    #[error("{port}: the cycle's time was over before its command could be sent")]
    TooLate { port: Arc<str> },
    /// The port still waits for an answer at the end of this cycle.
    #[error("{port}: no answer by the end of the cycle; check power, wiring, address and baud")]
    Unanswered { port: Arc<str> },
    /// The port has not finished this cycle.
    #[error("{port}: still busy at the end of the cycle")]
    Busy { port: Arc<str> },
    /// The serial port itself failed.
    #[error(transparent)]
    Serial(#[from] serial::Error),
    /// The configuration cannot be used.
    #[error("{port}: {what}")]
    Configuration { port: Arc<str>, what: InvalidConfig },
}

/// Reason why a configuration cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum InvalidConfig {
    /// A port without units.
    #[error("no units on this port; name at least one address")]
    NoUnits,
    /// An address that no unit of this family can have.
    #[error("a unit's address is {given}; accepted: {accepted}")]
    Address {
        /// As configured.
        given: u8,
        /// The addresses of the family.
        accepted: &'static str,
    },
    /// Two units of one port have the same address.
    #[error("two units with the same address; give each its own")]
    AddressTwice,
    /// A watchdog time that the family does not have.
    #[error("a watchdog of {given_ms} ms; accepted: {accepted}, so that the motors stop when this program ends")]
    Watchdog {
        /// As configured, ms.
        given_ms: u32,
        /// The times of the family.
        accepted: &'static str,
    },
    /// The family lacks something that the caller cannot do without.
    #[error("this drive family does not offer {0}, which the robot needs; choose another `protocol`")]
    Lacks(&'static str),
    /// Two ports with the same name.
    #[error("named twice; list all units of a port under one entry")]
    PortTwice,
    /// More units than a robot has.
    #[error("more than 8 units in all; there are at most 8 cables")]
    TooManyUnits,
    /// The system starts no more threads.
    #[error("no thread could be started for it; the system is out of resources")]
    NoThread,
}

impl Error {
    /// True where the serial device itself is gone.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        matches!(self, Error::Serial(error) if error.is_lost())
    }

    /// True where the unit has not answered several attempts, for whatever reason.
    #[must_use]
    pub fn is_silence(&self) -> bool {
        matches!(self, Error::Silent { .. } | Error::Echo { .. } | Error::Foreign { .. } | Error::Babble { .. })
    }

    /// True where one exchange failed on the wire, so that asking again can help once the bus is in step.
    #[must_use]
    pub fn is_on_the_wire(&self) -> bool {
        matches!(
            self,
            Error::NoAnswer { .. }
                | Error::CutShort { .. }
                | Error::Garbled { .. }
                | Error::Unexpected { .. }
                | Error::Stray { .. }
        )
    }
}

/// A watchdog time in ms, for families that count in them.
///
/// # Errors
/// It is none of the `range`, ms, or no whole number of ms. `accepted`: the range in words.
pub fn watchdog_ms(seconds: f64, range: RangeInclusive<u16>, accepted: &'static str) -> Result<u16, InvalidConfig> {
    // `as` saturates, and turns a NaN into 0.
    let ms = (seconds * 1e3).round() as u16;
    if range.contains(&ms) && (seconds * 1e3 - f64::from(ms)).abs() < 1e-6 {
        return Ok(ms);
    }
    Err(InvalidConfig::Watchdog { given_ms: (seconds * 1e3) as u32, accepted })
}
