//! Units that do not answer: when a unit counts as silent, how often it is asked then, and what a port reports.

use std::sync::Arc;

use crate::error::Error;

/// Questions without an answer after which a unit is silent. With fewer, a short stop of the computer would count as
/// silence of the unit.
pub const SILENT_AFTER: u32 = 6;

/// Time between two questions to a silent unit, ns: each costs the other units of the port a few cycles.
pub const ASK_SILENT_EVERY_NS: u64 = 500_000_000;

/// A port on which nothing but noise arrived for this long does not recover, ns: a resynchronisation takes a tenth of
/// it.
pub const BABBLE_NS: u64 = 1_000_000_000;

/// Pause of a call that can do nothing at the moment, ns: short compared with a cycle, and a virtual clock moves only
/// in waits.
pub const PAUSE_NS: u64 = 1_000_000;

/// Bytes on a port that answer nothing: what they are, and since when nothing else arrives.
#[derive(Debug, Clone, Copy, Default)]
pub struct Noise {
    instead: Instead,
    /// Start of the present run of such bytes, ns.
    from_ns: Option<u64>,
}

impl Noise {
    /// Records bytes that answer nothing.
    pub fn heard(&mut self, now_ns: u64) {
        self.from_ns.get_or_insert(now_ns);
    }

    /// Records what they are.
    pub fn is(&mut self, instead: Instead) {
        self.instead = instead;
    }

    /// Records an answer, which ends the run.
    pub fn end(&mut self) {
        *self = Self::default();
    }

    /// The error of a silent unit.
    #[must_use]
    pub fn error(&self, port: Arc<str>, unit: Arc<str>, now_ns: u64) -> Error {
        let babbles = self.from_ns.is_some_and(|from_ns| now_ns.saturating_sub(from_ns) > BABBLE_NS);
        self.instead.error(port, unit, babbles)
    }
}

/// What arrived in place of a missing answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Instead {
    /// No byte.
    #[default]
    Nothing,
    /// The question itself.
    Echo,
    /// Something else.
    Foreign,
}

impl Instead {
    /// The error of a silent unit. `babbles`: nothing but noise arrived for [`BABBLE_NS`].
    #[must_use]
    pub fn error(self, port: Arc<str>, unit: Arc<str>, babbles: bool) -> Error {
        match self {
            Self::Nothing => Error::Silent { port, unit },
            Self::Echo => Error::Echo { port, unit },
            Self::Foreign if babbles => Error::Babble { port },
            Self::Foreign => Error::Foreign { port, unit },
        }
    }
}
