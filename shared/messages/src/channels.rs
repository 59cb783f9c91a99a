//! The channel table: every name, its type and its quality of service, once.

use crate::ros::{Log, MarkerArray, Path, Payload, PointCloud2, PoseStamped, TfMessage};
use crate::{
    ControlStatus, Energy, FieldMap, Heartbeat, LogEvent, MotorAuthority, MotorCommand, MotorInput, MotorSlots,
    MotorState, NodeEstimate, OperatorRequest, PlanMotion, PlanStatus, ProcessState, Reading, RecorderStatus, Sample,
    TruthNode,
};

/// Quality of service of a channel. Safe overflow is always on: the oldest sample makes room, a publisher never waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quality {
    /// Samples a subscriber can lag behind before it loses the oldest: at least 2.5 s at the channel's rate.
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
const CYCLE: Quality = Quality { buffer: 640, history: 256, late: 1, publishers: 1, subscribers: 12, nodes: 40 };
/// 10 Hz and below.
const SLOW: Quality = Quality { buffer: 64, history: 32, late: 4, publishers: 1, subscribers: 12, nodes: 40 };
/// Bursts: every line of a log at start-up, every row of a table at once; several publishers.
const BURST: Quality = Quality { buffer: 256, history: 128, late: 32, publishers: 8, subscribers: 12, nodes: 40 };
/// Sensors up to 100 Hz; a replacement may overlap its predecessor.
const SENSOR: Quality = Quality { buffer: 256, history: 128, late: 4, publishers: 2, subscribers: 12, nodes: 40 };

/// Clouds of points, pictures: large and slow.
const CLOUD: Quality = Quality { buffer: 64, history: 8, late: 1, publishers: 2, subscribers: 8, nodes: 40 };

/// Maps, about once a second; large, so no more of it than is needed.
const MAP: Quality = Quality { buffer: 8, history: 2, late: 1, publishers: 1, subscribers: 8, nodes: 40 };

/// What is drawn, 25 times a second, and what of it changes slowly, twice a second; large, so no more of it than is needed.
const SCENE: Quality = Quality { buffer: 64, history: 32, late: 1, publishers: 1, subscribers: 8, nodes: 40 };
/// See [`SCENE`].
const SLOW_SCENE: Quality = Quality { buffer: 8, history: 4, late: 1, publishers: 1, subscribers: 8, nodes: 40 };

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
    row::<ProcessState>("system/process", BURST),
    row::<RecorderStatus>("recorder/status", BURST),
    row::<TruthNode>("truth/node", CYCLE),
    row::<TfMessage>("tf", SCENE),
    row::<PoseStamped>("scene/pose", SCENE),
    row::<MarkerArray>("scene/robot", SCENE),
    row::<Path>("scene/plan", SLOW_SCENE),
    row::<Path>("scene/track", SLOW_SCENE),
    row::<PointCloud2>("scene/samples/*", SLOW_SCENE),
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
