//! The channel table: every name, its type and its quality of service, once.

use std::collections::HashMap;
use std::sync::OnceLock;

use crate::ros::{Log, MarkerArray, OccupancyGrid, Path, Payload, PointCloud2, PoseStamped, TfMessage};
use crate::{
    ControlStatus, Energy, FieldMap, Heartbeat, LogEvent, MotorAuthority, MotorCommand, MotorInput, MotorSlots,
    MotorState, NodeEstimate, OperatorRequest, PlanMotion, PlanStatus, ProcessState, Reading, RecorderStatus, Sample,
    SensorFlag, SystemConfig, TruthNode,
};

/// Quality of service of a channel. Safe overflow is always on: the oldest sample is overwritten, and a publisher never
/// waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quality {
    /// Samples that a deep subscriber (the recorder, the sensor logger) can lag behind before it loses the oldest: at
    /// least 2.5 s at the channel's rate, and 1.25 s of control cycles at 500 Hz. All others have [`Quality::SHALLOW`]
    /// at most.
    pub buffer: usize,
    /// Samples kept for a recorder that joins late or is restarted: more than a second at the rate of the channel.
    pub history: usize,
    /// Samples of these that any other late subscriber receives.
    pub late: usize,
    /// Most publishers; 1 is a lease on the channel.
    pub publishers: usize,
    /// Most subscribers.
    pub subscribers: usize,
    /// Most processes that open the channel.
    pub nodes: usize,
}

impl Quality {
    /// Samples that a subscriber that is not deep can lag behind, at least: 0.3 s at 100 Hz.
    pub const SHALLOW: usize = 32;
    /// Deep subscribers of a channel: recorder, sensor logger, the successor of one that has just died, and an
    /// observer.
    pub const DEEP_PLACES: usize = 4;
    /// Most bytes of the newest samples of one publisher: 0.8 s of 1 MB pictures at 10 Hz. The control chain stays
    /// below 2 MB.
    pub const BYTES: usize = 8 << 20;
    /// Most bytes of the newest samples of the publisher of blobs: 2.5 s of pictures of 400 kB at 30 Hz.
    pub const BLOB_BYTES: usize = 32 << 20;
    /// Samples of this size and above have fewer subscribers, because each may hold a copy, bytes.
    const LARGE_BYTES: usize = 128 << 10;
    const LARGE_SUBSCRIBERS: usize = 8;
    /// Fewest samples that are kept, whatever their size.
    const LEAST: usize = 4;
    /// Time that a deep subscriber of a channel of known rate can lag behind, s.
    const LAG_S: f64 = 2.5;

    /// Limits the quality to as many samples of that size as fit into [`Quality::BYTES`].
    #[must_use]
    pub const fn sized(self, bytes: usize) -> Self {
        self.within(Self::BYTES, bytes)
    }

    /// Limits the quality to as many samples of that size as fit into `room` bytes.
    const fn within(mut self, room: usize, bytes: usize) -> Self {
        let fit = room / if bytes == 0 { 1 } else { bytes };
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

    /// Limits the quality to the samples of the longest lag at a known rate.
    #[must_use]
    pub fn at_rate(mut self, rate_hz: f64) -> Self {
        let lag = (rate_hz * Self::LAG_S).ceil().max(Self::LEAST as f64);
        self.buffer = self.buffer.min(lag as usize);
        self.history = self.history.min(self.buffer / 2);
        self.late = self.late.min(self.history);
        self
    }

    /// Samples that a subscriber that is not deep can lag behind: it has room for those that it receives when it is
    /// late, e.g. every row of a table.
    #[must_use]
    pub const fn shallow(&self) -> usize {
        if self.late > Self::SHALLOW { self.late } else { Self::SHALLOW }
    }

    /// What a late subscriber receives, in words.
    #[must_use]
    pub fn kept(&self) -> String {
        match self.late {
            1 => "the last sample".to_owned(),
            late => format!("the last {late} samples"),
        }
    }

    /// Number of samples in the memory of a publisher. A sample is stored once for all subscribers and the history;
    /// added are the samples that subscribers borrow and the publisher loans.
    #[must_use]
    pub const fn samples(&self, borrows: usize, loans: usize) -> usize {
        let kept = if self.buffer > self.history { self.buffer } else { self.history };
        kept + self.subscribers * borrows + loans + SPARE
    }
}

/// Samples in reserve.
const SPARE: usize = 2;

/// Row of the table. A pattern that ends in `/*` stands for all names with that beginning.
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    /// e.g. `motor/state` or `system/heartbeat/*`.
    pub pattern: &'static str,
    /// Who publishes it.
    pub publisher: &'static str,
    /// Type of its samples; `None`: any.
    pub type_name: Option<fn() -> &'static str>,
    /// Its schema text.
    pub schema: Option<fn() -> &'static str>,
    /// Quality of service.
    pub quality: Quality,
}

/// 250 Hz x 2.5 s, rounded up: also holds 500 Hz for more than a second, in which a recorder is replaced, and 100 Hz
/// through a stall of six seconds.
const CYCLE: Quality = Quality { buffer: 640, history: 512, late: 1, publishers: 1, subscribers: 24, nodes: 48 };
/// 10 Hz and below.
const SLOW: Quality = Quality { buffer: 64, history: 32, late: 4, publishers: 1, subscribers: 24, nodes: 48 };
/// Tables: every row at once, up to a row for each of some hundred processes or channels.
const TABLE: Quality = Quality { buffer: 1024, history: 512, late: 512, publishers: 8, subscribers: 24, nodes: 48 };
/// Bursts: every line of a log at start-up; several publishers.
const BURST: Quality = Quality { buffer: 256, history: 128, late: 32, publishers: 8, subscribers: 24, nodes: 48 };
/// Log of the supervisor: a line or two for each of a thousand processes, before the recorder begins to listen.
const START: Quality = Quality { buffer: 2048, history: 1024, late: 32, publishers: 8, subscribers: 24, nodes: 48 };
/// Sensors up to 100 Hz; a replacement may overlap its predecessor.
const SENSOR: Quality = Quality { buffer: 256, history: 128, late: 4, publishers: 2, subscribers: 24, nodes: 48 };

/// Point clouds, pictures: large and slow.
const CLOUD: Quality = Quality { buffer: 64, history: 8, late: 1, publishers: 2, subscribers: 24, nodes: 48 };

/// Blobs up to 30 Hz.
const BLOB: Quality = Quality { buffer: 75, history: 8, late: 1, publishers: 1, subscribers: 24, nodes: 48 };

/// Maps, about once a second; large, so few are kept.
const MAP: Quality = Quality { buffer: 8, history: 2, late: 1, publishers: 1, subscribers: 24, nodes: 48 };

/// Visualization, 25 times a second; large, so few samples are kept.
const VISUALIZATION: Quality = Quality { buffer: 64, history: 32, late: 1, publishers: 1, subscribers: 24, nodes: 48 };
/// Slowly changing parts of the visualization, twice a second.
const SLOW_VISUALIZATION: Quality =
    Quality { buffer: 8, history: 4, late: 1, publishers: 1, subscribers: 24, nodes: 48 };

/// Configurations: published at the start and on a change, kept for late subscribers.
const CONFIG: Quality = Quality { buffer: 4, history: 2, late: 2, publishers: 1, subscribers: 24, nodes: 48 };

/// Processes of a robot at once, unless `[bus]` of its system file states another number: three times those of a robot
/// with 300 sensors (`scripts/width`).
pub const PROCESSES: usize = 1024;

const fn row<T: Payload>(pattern: &'static str, publisher: &'static str, quality: Quality) -> Channel {
    Channel { pattern, publisher, type_name: Some(T::type_name), schema: Some(T::schema), quality }
}

/// Returns the definition of a type of this build with its comments; `None` for other types.
#[must_use]
pub fn documented(type_name: &str) -> Option<&'static str> {
    static KNOWN: OnceLock<HashMap<&'static str, &'static str>> = OnceLock::new();
    let row = |channel: &Channel| Some(((channel.type_name?)(), (channel.schema?)()));
    KNOWN.get_or_init(|| CHANNELS.iter().filter_map(row).collect()).get(type_name).copied()
}

/// Receives channels with the types of their samples.
pub trait ChannelVisitor {
    /// Receives a channel.
    fn visit<T: Payload>(&mut self, name: &'static str);
}

/// Declares the table. A row is `pattern: type by publisher, quality;` with the type `any` for samples of any type. The
/// names after `first` are channels whose first sample is recorded: the recorder creates them before their publishers
/// do. Other channels are discovered when they appear; their history bridges the time until then.
macro_rules! channels {
    (@row $pattern:literal any $publisher:literal $quality:ident) => {
        Channel { pattern: $pattern, publisher: $publisher, type_name: None, schema: None, quality: $quality }
    };
    (@row $pattern:literal $type:ident $publisher:literal $quality:ident) => {
        row::<$type>($pattern, $publisher, $quality)
    };
    (@visit $visitor:ident any) => {};
    (@visit $visitor:ident $type:ident $($name:literal)*) => { $($visitor.visit::<$type>($name);)* };
    ($($pattern:literal: $type:ident by $publisher:literal, $quality:ident $(, first $($name:literal)+)?;)+) => {
        /// Every channel of a robot.
        pub const CHANNELS: &[Channel] = &[$(channels!(@row $pattern $type $publisher $quality)),+];

        /// Visits the channels whose first sample is recorded.
        pub fn visit_first_channels(visitor: &mut impl ChannelVisitor) {
            $(channels!(@visit visitor $type $($($name)+)?);)+
        }
    };
}

channels! {
    "motor/state": MotorState by "motor-io", CYCLE, first "motor/state";
    "motor/authority": MotorAuthority by "motor-io", CYCLE, first "motor/authority";
    "motor/slots": MotorSlots by "motor-io", CYCLE, first "motor/slots";
    "motor/input": MotorInput by "motor-io", CYCLE, first "motor/input";
    "motor/command/*": MotorCommand by "each controller", CYCLE, first "motor/command/a" "motor/command/b";
    "node/estimate/*": NodeEstimate by "each estimator", CYCLE, first "node/estimate/a" "node/estimate/b";
    "plan/motion": PlanMotion by "planner", SLOW, first "plan/motion";
    "plan/status": PlanStatus by "planner", SLOW, first "plan/status";
    "control/status/*": ControlStatus by "each controller", CYCLE, first "control/status/a" "control/status/b";
    "operator/request": OperatorRequest by "commands, and who answers them", BURST, first "operator/request";
    "sensor/*": Reading by "each sensor", SENSOR;
    "sample/*": Sample by "sensor-logger", SENSOR;
    "flag/*": SensorFlag by "sensor-logger", SLOW;
    "map/*": FieldMap by "sensor-logger", MAP;
    "cloud/*": any by "each sensor", CLOUD;
    "blob/*": any by "each sensor", BLOB;
    "energy": Energy by "motor-io", CYCLE, first "energy";
    "system/heartbeat/*": Heartbeat by "each process", SLOW;
    "system/log/nims": LogEvent by "supervisor", START;
    "system/log/*": LogEvent by "each process", BURST;
    "system/config/*": SystemConfig by "each process", CONFIG;
    "system/process": ProcessState by "supervisor", TABLE, first "system/process";
    "recorder/status": RecorderStatus by "recorder", TABLE;
    "truth/node": TruthNode by "virtual motor box", CYCLE, first "truth/node";
    "tf": TfMessage by "visualization", VISUALIZATION;
    "visualization/pose": PoseStamped by "visualization", VISUALIZATION;
    "visualization/robot": MarkerArray by "visualization", VISUALIZATION;
    "visualization/plan": Path by "visualization", SLOW_VISUALIZATION;
    "visualization/track": Path by "visualization", SLOW_VISUALIZATION;
    "visualization/samples/*": PointCloud2 by "visualization", SLOW_VISUALIZATION;
    "visualization/map/*": OccupancyGrid by "visualization", SLOW_VISUALIZATION;
    "log": Log by "visualization", BURST;
}

/// Returns the row of a channel name.
#[must_use]
pub fn channel_of(name: &str) -> Option<&'static Channel> {
    CHANNELS.iter().find(|channel| match channel.pattern.strip_suffix('*') {
        Some(beginning) => name.len() > beginning.len() && name.starts_with(beginning),
        None => name == channel.pattern,
    })
}

/// Returns the quality of service of a channel name; names outside the table are treated as sensors.
#[must_use]
pub fn quality_of(name: &str) -> Quality {
    channel_of(name).map_or(SENSOR, |channel| channel.quality)
}

/// Returns the quality of service with which every process creates a channel of samples of that size.
#[must_use]
pub fn quality_for(name: &str, bytes: usize) -> Quality {
    quality_of(name).sized(bytes)
}

/// Returns the quality of service with which a channel of blobs of at most that size is created.
#[must_use]
pub fn quality_of_blobs(most_bytes: usize) -> Quality {
    BLOB.within(Quality::BLOB_BYTES, most_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_channels_have_the_type_of_their_row() {
        #[derive(Default)]
        struct Names(Vec<&'static str>);
        impl ChannelVisitor for Names {
            fn visit<T: Payload>(&mut self, name: &'static str) {
                let row = channel_of(name).unwrap();
                assert_eq!(row.type_name.unwrap()(), T::type_name(), "{name}");
                self.0.push(name);
            }
        }
        let mut names = Names::default();
        visit_first_channels(&mut names);
        for control in ["motor/state", "motor/command/a", "motor/command/b", "plan/motion", "operator/request"] {
            assert!(names.0.contains(&control), "{control}");
        }
    }
}
