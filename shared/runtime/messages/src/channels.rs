//! The channel table: every name, its type and its quality of service, once.

use crate::ros::{Log, MarkerArray, Path, Payload, PointCloud2, PoseStamped, TfMessage};
use crate::{
    ControlStatus, Energy, FieldMap, Heartbeat, LogEvent, MotorAuthority, MotorCommand, MotorInput, MotorSlots,
    MotorState, NodeEstimate, OperatorRequest, PlanMotion, PlanStatus, ProcessState, Reading, RecorderStatus, Sample,
    SystemConfig, TruthNode,
};

/// Quality of service of a channel. Safe overflow is always on: the oldest sample makes room, a publisher never waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quality {
    /// Samples that a deep subscriber (the recorder, the sensor logger) can lag behind before it loses the oldest: at least 2.5 s at the
    /// channel's rate. All others have [`Quality::SHALLOW`] at most.
    pub buffer: usize,
    /// Samples that are kept for a recorder that comes late, or again: over a second at the channel's rate, in which it is started again.
    pub history: usize,
    /// Samples of these that any other late subscriber gets.
    pub late: usize,
    /// Publishers at most; 1 is a lease on the channel.
    pub publishers: usize,
    /// Subscribers at most.
    pub subscribers: usize,
    /// Processes that may hold the channel.
    pub nodes: usize,
}

impl Quality {
    /// Samples that a subscriber can lag behind, but for a deep one: 0.3 s of the fastest chain at 100 Hz, and every row of a table.
    pub const SHALLOW: usize = 32;
    /// Deep subscribers of a channel: recorder and sensor logger, the successor of one that has just died, and one that observes.
    pub const DEEP_PLACES: usize = 4;
    /// What the newest samples of one publisher take at most, bytes: 0.8 s of a 1 MB picture ten times a second. The chain stays below 2 MB.
    pub const BYTES: usize = 8 << 20;
    /// From this size on a sample that is being copied costs more than a place, bytes: the channel then has fewer subscribers.
    const LARGE_BYTES: usize = 128 << 10;
    const LARGE_SUBSCRIBERS: usize = 8;
    /// Samples that are kept at least, however large one is.
    const LEAST: usize = 4;
    /// What a deep subscriber of a channel of known rate can lag behind, s.
    const LAG_S: f64 = 2.5;

    /// The same for samples of that size: as many as [`Quality::BYTES`] hold.
    #[must_use]
    pub const fn sized(mut self, bytes: usize) -> Self {
        let fit = Self::BYTES / if bytes == 0 { 1 } else { bytes };
        let fit = if fit < Self::LEAST { Self::LEAST } else { fit };
        if self.buffer > fit {
            self.buffer = fit;
        }
        if self.history > fit / 2 {
            self.history = fit / 2;
        }
        if self.late > self.history {
            self.late = self.history;
        }
        if bytes >= Self::LARGE_BYTES && self.subscribers > Self::LARGE_SUBSCRIBERS {
            self.subscribers = Self::LARGE_SUBSCRIBERS;
        }
        self
    }

    /// The same for so many samples a second, where that is known: no more than the lag that is bridged.
    #[must_use]
    pub fn at_rate(mut self, rate_hz: f64) -> Self {
        let lag = (rate_hz * Self::LAG_S).ceil().max(Self::LEAST as f64);
        self.buffer = self.buffer.min(lag as usize);
        self.history = self.history.min(self.buffer / 2);
        self.late = self.late.min(self.history);
        self
    }

    /// Samples that a publisher's memory holds. A sample lies there once, whatever the number of subscribers that have not taken it: all
    /// of them, and the history, wait for the newest of the same samples. To these come what each subscriber borrows, and the publisher.
    #[must_use]
    pub const fn samples(&self, borrows: usize, loans: usize) -> usize {
        let kept = if self.buffer > self.history { self.buffer } else { self.history };
        kept + self.subscribers * borrows + loans + SPARE
    }
}

/// Samples beyond what is needed by count.
const SPARE: usize = 2;

/// A row of the table. A name that ends in `/*` stands for all names with that beginning.
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    /// e.g. `motor/state` or `system/heartbeat/*`.
    pub pattern: &'static str,
    /// The type that travels there; `None`: any.
    pub type_name: Option<fn() -> &'static str>,
    /// Its schema text.
    pub schema: Option<fn() -> &'static str>,
    /// Quality of service.
    pub quality: Quality,
}

/// 250 Hz x 2.5 s, rounded up: also holds 100 Hz through a stall of six seconds.
const CYCLE: Quality = Quality { buffer: 640, history: 256, late: 1, publishers: 1, subscribers: 24, nodes: 48 };
/// 10 Hz and below.
const SLOW: Quality = Quality { buffer: 64, history: 32, late: 4, publishers: 1, subscribers: 24, nodes: 48 };
/// Bursts: every line of a log at start-up, every row of a table at once; several publishers.
const BURST: Quality = Quality { buffer: 256, history: 128, late: 32, publishers: 8, subscribers: 24, nodes: 48 };
/// Sensors up to 100 Hz; a replacement may overlap its predecessor.
const SENSOR: Quality = Quality { buffer: 256, history: 128, late: 4, publishers: 2, subscribers: 24, nodes: 48 };

/// Clouds of points, pictures: large and slow.
const CLOUD: Quality = Quality { buffer: 64, history: 8, late: 1, publishers: 2, subscribers: 24, nodes: 48 };

/// Maps, about once a second; large, so no more of it than is needed.
const MAP: Quality = Quality { buffer: 8, history: 2, late: 1, publishers: 1, subscribers: 24, nodes: 48 };

/// What is drawn, 25 times a second, and what of it changes slowly, twice a second; large, so no more of it than is needed.
const VISUALIZATION: Quality = Quality { buffer: 64, history: 32, late: 1, publishers: 1, subscribers: 24, nodes: 48 };
/// See [`VISUALIZATION`].
const SLOW_VISUALIZATION: Quality =
    Quality { buffer: 8, history: 4, late: 1, publishers: 1, subscribers: 24, nodes: 48 };

/// What processes work with: said at the start and on a change, kept for who comes late.
const CONFIG: Quality = Quality { buffer: 4, history: 2, late: 2, publishers: 1, subscribers: 24, nodes: 48 };

const fn row<T: Payload>(pattern: &'static str, quality: Quality) -> Channel {
    Channel { pattern, type_name: Some(T::type_name), schema: Some(T::schema), quality }
}

/// Every channel of a robot.
pub const CHANNELS: &[Channel] = &[
    row::<MotorState>("motor/state", CYCLE),
    row::<MotorAuthority>("motor/authority", CYCLE),
    row::<MotorSlots>("motor/slots", CYCLE),
    row::<MotorInput>("motor/input", CYCLE),
    row::<MotorCommand>("motor/command/*", CYCLE),
    row::<NodeEstimate>("node/estimate/*", CYCLE),
    row::<PlanMotion>("plan/motion", SLOW),
    row::<PlanStatus>("plan/status", SLOW),
    row::<ControlStatus>("control/status/*", CYCLE),
    row::<OperatorRequest>("operator/request", BURST),
    row::<Reading>("sensor/*", SENSOR),
    row::<Sample>("sample/*", SENSOR),
    row::<FieldMap>("map/*", MAP),
    Channel { pattern: "cloud/*", type_name: None, schema: None, quality: CLOUD },
    row::<Energy>("energy", CYCLE),
    row::<Heartbeat>("system/heartbeat/*", SLOW),
    row::<LogEvent>("system/log/*", BURST),
    row::<SystemConfig>("system/config/*", CONFIG),
    row::<ProcessState>("system/process", BURST),
    row::<RecorderStatus>("recorder/status", BURST),
    row::<TruthNode>("truth/node", CYCLE),
    row::<TfMessage>("tf", VISUALIZATION),
    row::<PoseStamped>("visualization/pose", VISUALIZATION),
    row::<MarkerArray>("visualization/robot", VISUALIZATION),
    row::<Path>("visualization/plan", SLOW_VISUALIZATION),
    row::<Path>("visualization/track", SLOW_VISUALIZATION),
    row::<PointCloud2>("visualization/samples/*", SLOW_VISUALIZATION),
    row::<Log>("log", BURST),
];

/// The row a channel name belongs to, if the table has one.
#[must_use]
pub fn channel_of(name: &str) -> Option<&'static Channel> {
    CHANNELS.iter().find(|channel| match channel.pattern.strip_suffix('*') {
        Some(beginning) => name.len() > beginning.len() && name.starts_with(beginning),
        None => name == channel.pattern,
    })
}

/// Quality of service for a channel name; names outside the table are treated as sensors.
#[must_use]
pub fn quality_of(name: &str) -> Quality {
    channel_of(name).map_or(SENSOR, |channel| channel.quality)
}

/// Quality of service of a channel whose samples have that size: what every process makes it with.
#[must_use]
pub fn quality_for(name: &str, bytes: usize) -> Quality {
    quality_of(name).sized(bytes)
}
