//! What the driver knows of a unit.

use crate::codec::Version;
use crate::error::Error;
use crate::status::Status;

/// A value and when it was asked for: it was true then or a little later. 0 stands for never.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Timed<V> {
    /// The value.
    pub value: V,
    /// When it was asked for, on the line's clock, ns.
    pub at_ns: u64,
}

impl<V> Timed<V> {
    /// True once the value was read at all.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.at_ns != 0
    }
}

/// The newest of everything a unit has said, in SI units where the protocol has its own.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UnitReport {
    /// Encoder counts of both motors, carried on over the wraps of the unit's 32 bits.
    pub counts: Timed<[i64; 2]>,
    /// Motor currents, A.
    pub currents_a: Timed<[f64; 2]>,
    /// Duty of both motors, -1 to 1.
    pub duties: Timed<[f64; 2]>,
    /// Main supply, V.
    pub supply_v: Timed<f64>,
    /// Board temperature, degrees Celsius.
    pub temperature_c: Timed<f64>,
    /// Conditions.
    pub status: Timed<Status>,
    /// How often the unit has restarted since the driver knows it. Its encoders began again at zero each time, so where its lines
    /// are is not known any more. A counter and not an event, so that nobody can miss it.
    pub reboots: u32,
    /// How often an encoder jumped further than its motor can turn, and stayed there.
    pub jumps: u32,
    /// How often the unit was set up: 1 after the first time.
    pub setups: u32,
    /// The unit had this program's watchdog time when it was first spoken to: it has been running since another life of this program,
    /// and its encoders have counted on. A unit that was switched on anew has none.
    pub was_alive: bool,
}

/// The stop button on a status pin of a port.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum StopInput {
    /// None is configured, or it was not looked at yet.
    #[default]
    Unknown,
    /// The contact is closed: go on.
    Released,
    /// The contact or its wire is open: stop.
    Pressed,
    /// Nobody knows: stop.
    Unreadable(Error),
}

impl StopInput {
    /// True where the robot has to stop.
    #[must_use]
    pub fn says_stop(&self) -> bool {
        matches!(self, StopInput::Pressed | StopInput::Unreadable(_))
    }
}

/// What became of one cycle with one unit.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitAnswer {
    /// Whether the command was acknowledged and the encoders were read in this cycle.
    pub outcome: Result<(), Error>,
    /// The newest known values, each with its age.
    pub report: UnitReport,
}

/// What happened on a port so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Commands and questions sent.
    pub exchanges: u64,
    /// Answers that did not come, or not whole, in time.
    pub timeouts: u64,
    /// Answers with a wrong checksum.
    pub garbled: u64,
    /// Acknowledgements that were another byte.
    pub wrong_acks: u64,
    /// Bytes that nobody had asked for.
    pub stray_bytes: u64,
    /// Times the line had to be brought back in step.
    pub resyncs: u64,
    /// Questions that were left out because the cycle's time was up.
    pub left_out: u64,
    /// Connections made.
    pub connections: u32,
}

/// Who a unit is.
#[derive(Debug, Clone, Copy)]
pub struct UnitIdentity {
    /// Its address.
    pub address: u8,
    /// Its version text, once it was asked.
    pub version: Option<Version>,
}
