//! Readings of units and ports, in SI units and neutral terms.

use arrayvec::ArrayString;
use serial::{StatusPin, Transport};

use crate::{DriveStatus, Error};

/// Most motors of one unit.
pub const AXES: usize = 2;

/// A value with the time at which it was requested: it was true then or a little later. Time 0: never read.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Timed<V> {
    /// The value.
    pub value: V,
    /// Time of the request, on the machine's monotonic clock, ns.
    pub at_ns: u64,
}

impl<V> Timed<V> {
    /// True once the value was read.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.at_ns != 0
    }
}

/// Newest readings of a unit. Per motor, positive is the direction in which its count rises.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UnitReport {
    /// Encoder counts, continued over wraps of the unit's own counters and over its restarts.
    pub counts: Timed<[i64; AXES]>,
    /// The second encoder of the unit's one cable.
    pub second: SecondEncoder,
    /// Motor speeds, counts per second.
    pub speeds_counts_s: Timed<[f64; AXES]>,
    /// Motor currents, A.
    pub currents_a: Timed<[f64; AXES]>,
    /// Drive output as a share of the supply, -1 to 1.
    pub duties: Timed<[f64; AXES]>,
    /// Supply voltage, V.
    pub supply_v: Timed<f64>,
    /// Board temperature, degrees Celsius.
    pub temperature_c: Timed<f64>,
    /// Conditions in neutral bits.
    pub status: Timed<DriveStatus>,
    /// The same as the unit sent it, for the log.
    pub native_status: u32,
    /// Restarts of the unit since the driver knows it. Each time its counters began at zero, so the position of its
    /// motors is unknown. A counter rather than an event, so that no reader misses one.
    pub reboots: u32,
    /// Counts that moved further than [`CountBound`](crate::CountBound) explains and stayed there, without a restart.
    pub jumps: u32,
    /// How often the unit was set up: 1 after the first time.
    pub setups: u32,
    /// The unit already had the configured watchdog when it was first addressed: it has been running since an earlier
    /// run of this program, and has counted on meanwhile.
    pub was_alive: bool,
}

/// A second encoder, which turns with the same cable as the first one, and is read with it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SecondEncoder {
    /// Its count, continued over wraps, with the time of the count that it was read with.
    pub counts: Timed<i64>,
    /// How often its count was unrelated to that before: after a restart, and where it may have wrapped unseen. A
    /// counter rather than an event, so that no reader misses one.
    pub breaks: u32,
}

/// Stop button on a status pin of a port.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum StopInput {
    /// Not configured, or not read yet.
    #[default]
    Unknown,
    /// The contact is closed: no stop.
    Released,
    /// The contact or its wire is open: stop.
    Pressed,
    /// The pin cannot be read: stop.
    Unreadable(Error),
}

impl StopInput {
    /// Reads the contact on a pin. One that cannot be read is a stop.
    pub fn read(transport: &mut impl Transport, pin: StatusPin) -> StopInput {
        match transport.is_on(pin) {
            Ok(true) => StopInput::Released,
            Ok(false) => StopInput::Pressed,
            Err(error) => StopInput::Unreadable(Error::Serial(error)),
        }
    }

    /// True where the robot has to stop.
    #[must_use]
    pub fn requires_stop(&self) -> bool {
        matches!(self, StopInput::Pressed | StopInput::Unreadable(_))
    }
}

/// Result of one cycle for one unit.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitAnswer {
    /// `Ok` where the command was accepted and the counts were read in this cycle.
    pub outcome: Result<(), Error>,
    /// Newest readings, each with its time.
    pub report: UnitReport,
}

/// Event counts of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Commands and questions sent.
    pub exchanges: u64,
    /// Answers that did not arrive in time, or not completely.
    pub timeouts: u64,
    /// Answers with a wrong checksum or form.
    pub garbled: u64,
    /// Commands that were answered by something else than an acknowledgement.
    pub wrong_acks: u64,
    /// Bytes received that answer no question.
    pub stray_bytes: u64,
    /// Resynchronisations.
    pub resyncs: u64,
    /// Slow readings left out because the cycle's time was up.
    pub left_out: u64,
    /// Connections made.
    pub connections: u32,
}

/// Firmware version as the unit states it.
pub type Firmware = ArrayString<48>;

/// Identity of a unit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnitInfo {
    /// Name in messages, for instance `unit 0x80`.
    pub name: std::sync::Arc<str>,
    /// Firmware version, once it was read.
    pub firmware: Option<Firmware>,
    /// Time without a command after which the unit stops its motors, ms, as it was read back; `None` until then.
    pub watchdog_ms: Option<u32>,
}
