//! What can go wrong between this program and a unit.

use std::fmt;
use std::sync::Arc;

use crate::codec::{Motor, Read, Write};

/// What was asked of a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// A command that changes something.
    Write(Write),
    /// A question.
    Read(Read),
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Command::Write(write) => write.fmt(f),
            Command::Read(read) => read.fmt(f),
        }
    }
}

/// Why a unit has not done or not answered what it was asked. Cloning one does not allocate.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // port, address and command are the same everywhere: where it happened and what was asked
pub enum Error {
    /// Not one byte came back in time.
    #[error(
        "{port}, unit {address:#04x}: no answer to {command} within {waited_us} us; check power, wiring, address and baud"
    )]
    NoAnswer { port: Arc<str>, address: u8, command: Command, waited_us: u32 },
    /// The answer stopped in the middle.
    #[error("{port}, unit {address:#04x}: the answer to {command} broke off after {got} of {wanted} bytes")]
    CutShort { port: Arc<str>, address: u8, command: Command, got: usize, wanted: usize },
    /// The answer was changed on the way, or is the answer to something else.
    #[error(
        "{port}, unit {address:#04x}: the answer to {command} has a wrong checksum; look for noise or two units of one address"
    )]
    Garbled { port: Arc<str>, address: u8, command: Command },
    /// The command was answered by another byte than the protocol's acknowledgement.
    #[error("{port}, unit {address:#04x}: {command} was answered by {byte:#04x} instead of 0xff")]
    WrongAck { port: Arc<str>, address: u8, command: Command, byte: u8 },
    /// Bytes were on the line that nobody had asked for, so the next answer could not have been trusted.
    #[error("{port}, unit {address:#04x}: {bytes} unexpected bytes on the line before {command}")]
    Stray { port: Arc<str>, address: u8, command: Command, bytes: usize },
    /// The line is being brought back in step after an error; nothing was sent.
    #[error("{port}: getting back in step with the units after an error on the line")]
    Resynchronising { port: Arc<str> },
    /// The unit has not answered for several attempts; it is asked again twice a second.
    #[error(
        "{port}, unit {address:#04x}: silent; it is asked again twice a second; check its power, its wiring and its address"
    )]
    Silent { port: Arc<str>, address: u8 },
    /// What was sent comes back, and nothing else: a loopback, an adapter with local echo, or a line without a unit at its end.
    #[error(
        "{port}, unit {address:#04x}: nothing comes back but what was sent; connect the unit, and take away the loopback or the adapter's echo"
    )]
    Echo { port: Arc<str>, address: u8 },
    /// Something answers, but not this unit.
    #[error(
        "{port}, unit {address:#04x}: what comes back is no answer of this unit; check that it is the drives' port, its baud and the address"
    )]
    Gibberish { port: Arc<str>, address: u8 },
    /// The line is never quiet, so nothing can be asked.
    #[error(
        "{port}: bytes come without end though nothing was asked; check that it is the drives' port, and its baud and wiring"
    )]
    Babble { port: Arc<str> },
    /// The unit answers and is being set up; nothing was commanded yet.
    #[error("{port}, unit {address:#04x}: being set up; it takes commands in a moment")]
    Preparing { port: Arc<str>, address: u8 },
    /// The unit was lost or restarted, and moves only after it was told to stand still once.
    #[error(
        "{port}, unit {address:#04x}: it was lost or restarted, so it does not move before it was told to hold once"
    )]
    Interlocked { port: Arc<str>, address: u8 },
    /// An encoder moved further than the motor can turn; the sample was refused.
    #[error(
        "{port}, unit {address:#04x}: encoder {} jumped by {counts} counts, more than the motor can turn; \
         check the encoder's cable and whether the unit has restarted", motor.index() + 1
    )]
    EncoderJump { port: Arc<str>, address: u8, motor: Motor, counts: i32 },
    /// The unit does not keep the watchdog time that was set.
    #[error(
        "{port}, unit {address:#04x}: keeps a watchdog of {got} tenths of a second instead of {wanted}; \
         it would not stop by itself, so it is not used"
    )]
    WatchdogRefused { port: Arc<str>, address: u8, wanted: u8, got: u8 },
    /// The time for this cycle was over before anything could be sent.
    #[error("{port}: the cycle's time was over before its command could be sent")]
    TooLate { port: Arc<str> },
    /// The port still waits for an answer at the end of this cycle.
    #[error("{port}: no answer by the end of the cycle; check power, wiring, address and baud")]
    Unanswered { port: Arc<str> },
    /// The port has not finished this cycle.
    #[error("{port}: still busy at the end of the cycle")]
    Busy { port: Arc<str> },
    /// The serial line itself.
    #[error(transparent)]
    Line(#[from] serial::Error),
    /// The configuration cannot be meant.
    #[error("{port}: {what}")]
    Configuration { port: Arc<str>, what: Misfit },
}

/// Why a configuration cannot be meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Misfit {
    /// A line without units.
    #[error("no units on this line; name at least one address")]
    NoUnits,
    /// An address that no unit can have.
    #[error("a unit's address has to be between 0x80 and 0x87")]
    Address,
    /// Two units of one line have the same address.
    #[error("two units with the same address; give each its own")]
    AddressTwice,
    /// A unit without a watchdog.
    #[error("a watchdog of 0 would let the motors run on when this program dies; choose 1 to 255 tenths")]
    NoWatchdog,
    /// Two lines with the same name.
    #[error("named twice; list all units of a line under one port")]
    PortTwice,
    /// More units than a robot has.
    #[error("more than 8 units in all; there are at most 8 cables")]
    TooManyUnits,
    /// The system starts no more threads.
    #[error("no thread could be started for it; the system is out of resources")]
    NoThread,
}

impl Error {
    /// True where the device itself is gone.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        matches!(self, Error::Line(error) if error.is_lost())
    }

    /// True where the unit has not answered for several attempts, for whatever reason.
    #[must_use]
    pub fn is_silence(&self) -> bool {
        matches!(self, Error::Silent { .. } | Error::Echo { .. } | Error::Gibberish { .. } | Error::Babble { .. })
    }

    /// True where one exchange went wrong on the line, so that asking again may help once the line is back in step.
    #[must_use]
    pub fn is_on_the_line(&self) -> bool {
        matches!(
            self,
            Error::NoAnswer { .. }
                | Error::CutShort { .. }
                | Error::Garbled { .. }
                | Error::WrongAck { .. }
                | Error::Stray { .. }
        )
    }
}
