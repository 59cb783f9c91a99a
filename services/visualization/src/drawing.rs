//! Draws the robot from the newest samples.

use std::collections::BTreeMap;

use bytemuck::pod_read_unaligned;
use cable_robot::Robot;
use messages::ros::Payload;
use messages::ros::{self, CLOUD_POINT_BYTES, CLOUD_POINTS, PATH_POSES};
use messages::{
    CABLES, FieldMap, LogEvent, Message, MotorAuthority, NodeEstimate, PlanMotion, Reading, Rule, SLOTS, Sample,
    blended_estimate, put_text, text_of,
};
use segments::segment_of;

use messages::cdr::Cdr;

use crate::grid::grid;

/// Coordinate frame of the robot file. Four bytes with its terminating zero, so that every header has 16 bytes.
const MAP: &str = "map";
/// Coordinate frame of the node.
const NODE: &str = "node";
/// Initial distance between two points of the track, m.
const TRACK_STEP_M: f64 = 0.02;
/// Size of every log message, bytes.
const LOG_BYTES: usize = size_of::<ros::Log>();
/// Width of a drawn cable, m.
const CABLE_WIDTH_M: f64 = 0.012;
/// Colours of the cables, the same as on the page of `nims report`.
const COLOURS: [[f32; 3]; CABLES] = [
    [0.12, 0.47, 0.71],
    [0.84, 0.15, 0.16],
    [0.17, 0.55, 0.24],
    [1.0, 0.5, 0.05],
    [0.47, 0.31, 0.63],
    [0.43, 0.43, 0.43],
    [0.09, 0.67, 0.75],
    [0.1, 0.1, 0.1],
];
/// Colour of a slack cable.
const SLACK: [f32; 3] = [0.75, 0.75, 0.75];

/// The type of a drawing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `tf2_msgs/TFMessage`.
    Tf,
    /// `geometry_msgs/PoseStamped`.
    Pose,
    /// `nav_msgs/Path`.
    Path,
    /// `visualization_msgs/MarkerArray`.
    Markers,
    /// `sensor_msgs/PointCloud2`.
    Cloud,
    /// `nav_msgs/OccupancyGrid`.
    Grid,
    /// `rcl_interfaces/Log`.
    Log,
}

impl Kind {
    /// Returns type name, schema text and size of every body in bytes.
    #[must_use]
    pub fn definition(self) -> (&'static str, &'static str, usize) {
        fn definition<T: Payload>() -> (&'static str, &'static str, usize) {
            (T::type_name(), T::schema(), size_of::<T>())
        }
        match self {
            Self::Tf => definition::<ros::TfMessage>(),
            Self::Pose => definition::<ros::PoseStamped>(),
            Self::Path => definition::<ros::Path>(),
            Self::Markers => definition::<ros::MarkerArray>(),
            Self::Cloud => definition::<ros::PointCloud2>(),
            Self::Grid => definition::<ros::OccupancyGrid>(),
            Self::Log => definition::<ros::Log>(),
        }
    }
}

/// A message to publish.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Drawing {
    /// Channel, e.g. `visualization/robot`.
    pub channel: String,
    /// Type of the message.
    pub kind: Kind,
    /// UNIX time of the content, ns.
    pub unix_ns: u64,
    /// CDR body; all bodies of a kind have the same length.
    pub body: Vec<u8>,
}

/// Points of a path in bounded memory: the distance between points doubles when the memory is full.
#[derive(Debug, Clone)]
struct Track {
    points_m: Vec<[f64; 3]>,
    step_m: f64,
}

impl Track {
    fn add(&mut self, position_m: [f64; 3]) {
        let near = self.points_m.last().is_some_and(|last| distance_m(last, &position_m) < self.step_m);
        if near {
            return;
        }
        if self.points_m.len() == PATH_POSES - 1 {
            let mut keep = false;
            self.points_m.retain(|_| {
                keep = !keep;
                keep
            });
            self.step_m *= 2.0;
        }
        self.points_m.push(position_m);
    }
}

fn distance_m(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// Draws the robot from its samples.
#[derive(Debug, Clone)]
pub struct Visualization {
    anchors_m: Vec<[f64; 3]>,
    /// UNIX time minus CLOCK_MONOTONIC, ns.
    unix_less_mono_ns: i64,
    authority: Option<MotorAuthority>,
    estimates: [Option<NodeEstimate>; SLOTS],
    plan_m: Vec<[f64; 3]>,
    track: Track,
    clouds: BTreeMap<String, Vec<[f32; 4]>>,
}

impl Visualization {
    /// Creates the visualization of a robot; `unix_less_mono_ns` is the offset from stamps to UNIX time.
    #[must_use]
    pub fn new(robot: &Robot, unix_less_mono_ns: i64) -> Self {
        Self {
            anchors_m: robot.anchors().iter().map(|anchor| (*anchor).into()).collect(),
            unix_less_mono_ns,
            authority: None,
            estimates: [None; SLOTS],
            plan_m: Vec::new(),
            track: Track { points_m: Vec::new(), step_m: TRACK_STEP_M },
            clouds: BTreeMap::new(),
        }
    }

    /// Returns whether samples of this channel are drawn.
    #[must_use]
    pub fn wants(channel: &str) -> bool {
        matches!(channel, "motor/authority" | "node/estimate/a" | "node/estimate/b" | "plan/motion")
            || ["sensor/", "sample/", "map/", "system/log/"].iter().any(|beginning| channel.starts_with(beginning))
    }

    /// Processes the bytes of a sample; a log event and a map return their drawing at once. Samples of other types or
    /// versions are ignored.
    pub fn record(&mut self, channel: &str, type_name: &str, sample: &[u8]) -> Option<Drawing> {
        match channel {
            "motor/authority" => self.authority = read(type_name, sample).or(self.authority),
            "node/estimate/a" | "node/estimate/b" => {
                let slot = usize::from(channel.ends_with("/b"));
                self.estimates[slot] = read(type_name, sample).or(self.estimates[slot]);
                self.track_node();
            }
            "plan/motion" => {
                if let Some(motion) = read::<PlanMotion>(type_name, sample) {
                    self.plan(&motion);
                }
            }
            _ if channel.starts_with("system/log/") => return read(type_name, sample).map(|event| self.log(&event)),
            _ => match channel.strip_prefix("map/") {
                Some(name) => return read(type_name, sample).map(|map| self.map(name, &map)),
                None => self.add_point(channel, type_name, sample),
            },
        }
        None
    }

    fn node(&self) -> Option<NodeEstimate> {
        let [a, b] = &self.estimates;
        blended_estimate(self.authority.as_ref(), [a.as_ref(), b.as_ref()], Rule::History)
            .filter(|estimate| estimate.valid == 1)
    }

    fn track_node(&mut self) {
        if let Some(node) = self.node() {
            self.track.add(node.position_m);
        }
    }

    fn plan(&mut self, motion: &PlanMotion) {
        self.plan_m.clear();
        if motion.motion == 0 {
            return;
        }
        let segments = [&motion.current, &motion.next].into_iter().filter_map(segment_of);
        for segment in segments {
            let (each, length_m) = (PATH_POSES / 2, segment.path.length());
            let at = |i: usize| <[f64; 3]>::from(segment.path.point(length_m * i as f64 / (each - 1) as f64));
            self.plan_m.extend((0..each).map(at));
        }
    }

    /// Adds a reading at the present position of the node, or a sample at its own position, to a point cloud.
    fn add_point(&mut self, channel: &str, type_name: &str, sample: &[u8]) {
        let Some((_, name)) = channel.split_once('/') else { return };
        let (place, value, quality) = if let Some(sample) = read::<Sample>(type_name, sample) {
            (sample.position_m, sample.value[0], sample.quality)
        } else if let (Some(reading), Some(node)) = (read::<Reading>(type_name, sample), self.node()) {
            (node.position_m, reading.value[0], reading.quality)
        } else {
            return;
        };
        // As in maps: a value that a driver repeats was not measured here.
        if matches!(quality, Reading::QUALITY_STALE | Reading::QUALITY_INVALID) || !value.is_finite() {
            return;
        }
        // Separate clouds for readings and samples of a sensor, because samples are more accurate.
        let key = channel.replace('/', "-");
        let cloud = self.clouds.entry(if channel.starts_with("sample/") { name.to_owned() } else { key }).or_default();
        if cloud.len() == CLOUD_POINTS {
            let mut keep = false;
            cloud.retain(|_| {
                keep = !keep;
                keep
            });
        }
        cloud.push([place[0] as f32, place[1] as f32, place[2] as f32, value as f32]);
    }

    fn unix_ns(&self, mono_ns: u64) -> u64 {
        mono_ns.saturating_add_signed(self.unix_less_mono_ns)
    }

    /// Draws the moving parts: transform, pose, cables. Returns nothing if the position is unknown.
    #[must_use]
    pub fn frame(&self) -> Vec<Drawing> {
        let Some(node) = self.node() else { return Vec::new() };
        let unix_ns = self.unix_ns(node.header.stamp_ns);
        let drawing =
            |channel: &str, kind, cdr: Cdr| Drawing { channel: channel.to_owned(), kind, unix_ns, body: cdr.0 };
        vec![
            drawing("tf", Kind::Tf, transform(unix_ns, &node.position_m)),
            drawing("visualization/pose", Kind::Pose, pose(unix_ns, &node.position_m)),
            drawing("visualization/robot", Kind::Markers, self.robot(unix_ns, &node)),
        ]
    }

    /// Draws the slowly changing parts: the planned path, the track, and the measured values.
    #[must_use]
    pub fn slow_frame(&self) -> Vec<Drawing> {
        let Some(node) = self.node() else { return Vec::new() };
        let unix_ns = self.unix_ns(node.header.stamp_ns);
        let drawing = |channel: String, kind, cdr: Cdr| Drawing { channel, kind, unix_ns, body: cdr.0 };
        let mut drawings = vec![
            drawing("visualization/plan".to_owned(), Kind::Path, path(unix_ns, &self.plan_m, &node.position_m)),
            drawing(
                "visualization/track".to_owned(),
                Kind::Path,
                path(unix_ns, &self.track.points_m, &node.position_m),
            ),
        ];
        let clouds = self.clouds.iter();
        drawings.extend(clouds.map(|(name, points)| {
            drawing(format!("visualization/samples/{name}"), Kind::Cloud, cloud(unix_ns, points))
        }));
        drawings
    }

    /// Draws cables, anchors, node, and the tension of each cable.
    fn robot(&self, unix_ns: u64, node: &NodeEstimate) -> Cdr {
        let last = self.anchors_m.len().saturating_sub(1);
        // Every list has the length for the largest number of cables; the last cable is repeated.
        let cables = || (0..CABLES).map(move |i| i.min(last));
        let anchor = |i: usize| self.anchors_m.get(i).copied().unwrap_or(node.position_m);
        let colour = |i: usize| if node.slack[i] == 1 { SLACK } else { COLOURS[i] };
        let mut cdr = Cdr::default();
        cdr.u32(3 + CABLES as u32);

        let ends: Vec<[f64; 3]> = cables().flat_map(|i| [anchor(i), node.position_m]).collect();
        let colours: Vec<[f32; 3]> = cables().flat_map(|i| [colour(i), colour(i)]).collect();
        marker(
            &mut cdr,
            unix_ns,
            &Marker {
                id: 0,
                kind: Marker::LINE_LIST,
                size_m: [CABLE_WIDTH_M, 0.0, 0.0],
                points: (&ends, &colours),
                ..Marker::default()
            },
        );
        let ends: Vec<[f64; 3]> = cables().map(anchor).collect();
        let colours: Vec<[f32; 3]> = cables().map(|i| COLOURS[i]).collect();
        marker(
            &mut cdr,
            unix_ns,
            &Marker {
                id: 1,
                kind: Marker::SPHERE_LIST,
                size_m: [0.12; 3],
                points: (&ends, &colours),
                ..Marker::default()
            },
        );
        marker(
            &mut cdr,
            unix_ns,
            &Marker { id: 2, kind: Marker::SPHERE, size_m: [0.1; 3], at_m: node.position_m, ..Marker::default() },
        );
        for i in 0..CABLES {
            let anchor = anchor(i.min(last));
            let at_m = std::array::from_fn(|k| 0.75 * node.position_m[k] + 0.25 * anchor[k]);
            let text = format!("{:5.1} N", node.tension_n[i].clamp(-999.0, 9999.0));
            let (id, shown) = (3 + i as i32, i <= last);
            marker(
                &mut cdr,
                unix_ns,
                &Marker {
                    id,
                    kind: Marker::TEXT,
                    size_m: [0.0, 0.0, 0.14],
                    at_m,
                    text: &text[..7],
                    shown,
                    ..Marker::default()
                },
            );
        }
        cdr
    }

    fn map(&self, name: &str, map: &FieldMap) -> Drawing {
        let unix_ns = self.unix_ns(map.header.stamp_ns);
        Drawing {
            channel: format!("visualization/map/{name}"),
            kind: Kind::Grid,
            unix_ns,
            body: grid(unix_ns, MAP, map).0,
        }
    }

    fn log(&self, event: &LogEvent) -> Drawing {
        let unix_ns = self.unix_ns(event.header.stamp_ns);
        let mut cdr = Cdr::default();
        cdr.time(unix_ns);
        cdr.u8(match event.level {
            LogEvent::LEVEL_ERROR => 40,
            LogEvent::LEVEL_WARN => 30,
            LogEvent::LEVEL_INFO => 20,
            _ => 10,
        });
        cdr.text(&text_of(&event.process));
        // Bytes that are no valid text can become longer by the conversion, so limit the text again.
        let mut text = [0_u8; 512];
        put_text(&mut text, &text_of(&event.text));
        cdr.text(&text_of(&text));
        cdr.text("");
        // The unused field for the name of a function pads the body to its fixed length.
        cdr.align(4);
        let room = LOG_BYTES.saturating_sub(cdr.0.len() + 9);
        cdr.text(&" ".repeat(room));
        cdr.u32(0);
        Drawing { channel: "log".to_owned(), kind: Kind::Log, unix_ns, body: cdr.0 }
    }
}

/// Returns a sample of a known type; `None` for another type or version.
fn read<T: Message>(type_name: &str, sample: &[u8]) -> Option<T> {
    (type_name == T::type_name() && sample.len() == size_of::<T>()).then(|| pod_read_unaligned(sample))
}

fn transform(unix_ns: u64, position_m: &[f64; 3]) -> Cdr {
    let mut cdr = Cdr::default();
    cdr.u32(1);
    cdr.header(unix_ns, MAP);
    cdr.text(NODE);
    cdr.pose(position_m);
    cdr
}

fn pose(unix_ns: u64, position_m: &[f64; 3]) -> Cdr {
    let mut cdr = Cdr::default();
    cdr.header(unix_ns, MAP);
    cdr.pose(position_m);
    cdr
}

/// Returns a path with the points, padded to its fixed length with the last point or the node.
fn path(unix_ns: u64, points_m: &[[f64; 3]], node_m: &[f64; 3]) -> Cdr {
    let mut cdr = Cdr::default();
    cdr.header(unix_ns, MAP);
    cdr.u32(PATH_POSES as u32);
    let last = points_m.last().unwrap_or(node_m);
    for point in points_m.iter().chain(std::iter::repeat(last)).take(PATH_POSES) {
        cdr.header(unix_ns, MAP);
        cdr.pose(point);
    }
    cdr
}

/// Returns a cloud with the points, padded to its fixed length with NaN.
fn cloud(unix_ns: u64, points: &[[f32; 4]]) -> Cdr {
    const FLOAT32: u8 = 7;
    let mut cdr = Cdr::default();
    cdr.header(unix_ns, MAP);
    cdr.u32(1);
    cdr.u32(CLOUD_POINTS as u32);
    cdr.u32(4);
    for (at, name) in ["x", "y", "z", "value"].into_iter().enumerate() {
        cdr.text(name);
        cdr.u32(4 * at as u32);
        cdr.u8(FLOAT32);
        cdr.u32(1);
    }
    cdr.u8(0);
    cdr.u32(CLOUD_POINT_BYTES as u32);
    cdr.u32((CLOUD_POINTS * CLOUD_POINT_BYTES) as u32);
    cdr.u32((CLOUD_POINTS * CLOUD_POINT_BYTES) as u32);
    for point in points.iter().chain(std::iter::repeat(&[f32::NAN; 4])).take(CLOUD_POINTS) {
        cdr.f32s(point);
    }
    cdr.u8(0);
    cdr
}

/// Properties of a marker.
struct Marker<'a> {
    id: i32,
    kind: i32,
    at_m: [f64; 3],
    size_m: [f64; 3],
    /// Points, each with its colour.
    points: (&'a [[f64; 3]], &'a [[f32; 3]]),
    text: &'a str,
    shown: bool,
}

impl Marker<'_> {
    const SPHERE: i32 = 2;
    const LINE_LIST: i32 = 5;
    const SPHERE_LIST: i32 = 7;
    const TEXT: i32 = 9;
}

impl Default for Marker<'_> {
    fn default() -> Self {
        Self { id: 0, kind: 0, at_m: [0.0; 3], size_m: [0.0; 3], points: (&[], &[]), text: "", shown: true }
    }
}

/// Appends `visualization_msgs/Marker`.
fn marker(cdr: &mut Cdr, unix_ns: u64, look: &Marker<'_>) {
    const ADD: i32 = 0;
    const DELETE: i32 = 2;
    cdr.header(unix_ns, MAP);
    cdr.text("nims");
    cdr.i32(look.id);
    cdr.i32(look.kind);
    cdr.i32(if look.shown { ADD } else { DELETE });
    cdr.pose(&look.at_m);
    cdr.f64s(&look.size_m);
    cdr.f32s(&[0.1, 0.1, 0.12, 1.0]);
    // Lifetime 0: shown until replaced.
    cdr.i32(0);
    cdr.u32(0);
    cdr.u8(0);
    cdr.u32(look.points.0.len() as u32);
    look.points.0.iter().for_each(|point| cdr.f64s(point));
    cdr.u32(look.points.1.len() as u32);
    for [r, g, b] in look.points.1 {
        cdr.f32s(&[*r, *g, *b, 1.0]);
    }
    // Without texture and mesh.
    cdr.text("");
    cdr.header(0, "");
    cdr.text("");
    cdr.u32(0);
    cdr.u32(0);
    cdr.text(look.text);
    cdr.text("");
    cdr.text("");
    cdr.u32(0);
    cdr.u8(0);
}
