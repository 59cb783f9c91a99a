//! Messages that ROS 2 defines, for tools that draw a robot without knowing nims.
//!
//! They contain texts and lists, but every sample of one type here is a CDR body of the same length, with texts and
//! lists of fixed length. It therefore travels like any other sample, and the recorder writes it unchanged. The
//! visualization process makes these bodies.

use bytemuck::{Pod, Zeroable};

use crate::message::expanded::complete;
use crate::message::hash_of;

/// Payload of a channel: a [`crate::Message`], or a message of ROS 2 as a CDR body of fixed length.
pub trait Payload: Pod + Send + Sync {
    /// The type's name, e.g. `MotorState`.
    const NAME: &'static str;
    /// The complete ROS 2 definition, nested types included.
    fn schema() -> &'static str;
    /// `package/NAME/hash`: what peers compare before they connect.
    fn type_name() -> &'static str;
    /// Fills in number and time of publication, if it has fields for them.
    fn number(&mut self, _seq: u64, _published_ns: u64) {}
    /// Number of the sample; 0 without such a field.
    fn seq(&self) -> u64 {
        0
    }
}

impl<T: crate::Message> Payload for T {
    const NAME: &'static str = <T as crate::Message>::NAME;
    fn schema() -> &'static str {
        <T as crate::Message>::schema()
    }
    fn type_name() -> &'static str {
        <T as crate::Message>::type_name()
    }
    fn number(&mut self, seq: u64, published_ns: u64) {
        let header = self.header_mut();
        (header.seq, header.published_ns) = (seq, published_ns);
    }
    fn seq(&self) -> u64 {
        self.header().seq
    }
}

/// Poses of a [`Path`].
pub const PATH_POSES: usize = 256;
/// Points of a [`PointCloud2`].
pub const CLOUD_POINTS: usize = 1024;
/// Bytes of one point: x, y, z, value as `float32`.
pub const CLOUD_POINT_BYTES: usize = 16;

pub(crate) const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const DURATION: (&str, &str) = ("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n");
pub(crate) const HEADER: (&str, &str) = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n");
pub(crate) const POINT: (&str, &str) = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n");
const VECTOR3: (&str, &str) = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
pub(crate) const QUATERNION: (&str, &str) =
    ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n");
pub(crate) const POSE: (&str, &str) =
    ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n");
const POSE_STAMPED: (&str, &str) = ("geometry_msgs/PoseStamped", "std_msgs/Header header\ngeometry_msgs/Pose pose\n");
const TRANSFORM: (&str, &str) =
    ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n");
const TRANSFORM_STAMPED: (&str, &str) = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
);
const COLOUR: (&str, &str) = ("std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n");
const MARKER: (&str, &str) = (
    "visualization_msgs/Marker",
    "int32 ARROW=0\nint32 CUBE=1\nint32 SPHERE=2\nint32 CYLINDER=3\nint32 LINE_STRIP=4\nint32 LINE_LIST=5\nint32 CUBE_LIST=6\n\
     int32 SPHERE_LIST=7\nint32 POINTS=8\nint32 TEXT_VIEW_FACING=9\nint32 MESH_RESOURCE=10\nint32 TRIANGLE_LIST=11\n\
     int32 ARROW_STRIP=12\nint32 ADD=0\nint32 MODIFY=0\nint32 DELETE=2\nint32 DELETEALL=3\nstd_msgs/Header header\nstring ns\n\
     int32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n\
     builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\n\
     string texture_resource\nsensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\nstring text\n\
     string mesh_resource\nvisualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials\n",
);
pub(crate) const IMAGE: (&str, &str) =
    ("sensor_msgs/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n");
/// Cells of a grid.
pub(crate) const META: (&str, &str) = (
    "nav_msgs/MapMetaData",
    "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\ngeometry_msgs/Pose origin\n",
);
pub(crate) const GRID: (&str, &str) =
    ("nav_msgs/OccupancyGrid", "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data\n");
const UV: (&str, &str) = ("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v\n");
const MESH: (&str, &str) = ("visualization_msgs/MeshFile", "string filename\nuint8[] data\n");
const POINT_FIELD: (&str, &str) = (
    "sensor_msgs/PointField",
    "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\n\
     string name\nuint32 offset\nuint8 datatype\nuint32 count\n",
);

/// Declares a message of ROS 2: its struct, bytes of its body, its own lines, and the types it names.
macro_rules! ros {
    ($(#[$doc:meta])* $name:ident, $full:literal, $bytes:expr, $own:expr, [$($dependency:ident),*]) => {
        $(#[$doc])*
        #[repr(transparent)]
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
        pub struct $name(pub [u8; $bytes]);

        impl $name {
            /// From a CDR body; `None` if it has another length.
            #[must_use]
            pub fn from_body(body: &[u8]) -> Option<Self> {
                body.try_into().ok().map(Self)
            }
        }

        impl Payload for $name {
            const NAME: &'static str = stringify!($name);
            fn schema() -> &'static str {
                static TEXT: std::sync::OnceLock<String> = std::sync::OnceLock::new();
                TEXT.get_or_init(|| {
                    let dependencies: &[(&'static str, &str)] = &[$($dependency),*];
                    let owned: Vec<(&'static str, String)> =
                        dependencies.iter().map(|(name, lines)| (*name, (*lines).to_owned())).collect();
                    complete($own, &owned)
                })
            }
            fn type_name() -> &'static str {
                static NAME: std::sync::OnceLock<String> = std::sync::OnceLock::new();
                NAME.get_or_init(|| format!("{}/{:08x}", $full, hash_of(Self::schema())))
            }
        }
    };
}

ros! {
    /// `tf`: pose of the node, as one transform from the frame `map` to the frame `node`.
    TfMessage, "tf2_msgs/TFMessage", 88, "geometry_msgs/TransformStamped[] transforms\n",
    [TRANSFORM_STAMPED, HEADER, TIME, TRANSFORM, VECTOR3, QUATERNION]
}
ros! {
    /// `visualization/pose`: pose of the node.
    PoseStamped, "geometry_msgs/PoseStamped", 72, POSE_STAMPED.1, [HEADER, TIME, POSE, POINT, QUATERNION]
}
ros! {
    /// `visualization/plan` and `visualization/track`: planned path, and path flown so far.
    Path, "nav_msgs/Path", 24 + 72 * PATH_POSES, "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n",
    [HEADER, TIME, POSE_STAMPED, POSE, POINT, QUATERNION]
}
ros! {
    /// `visualization/robot`: anchors, cables, node, and the tension of each cable as text.
    MarkerArray, "visualization_msgs/MarkerArray", 3517, "visualization_msgs/Marker[] markers\n",
    [MARKER, HEADER, TIME, POSE, POINT, QUATERNION, VECTOR3, COLOUR, DURATION, IMAGE, UV, MESH]
}
ros! {
    /// `visualization/samples/NAME`: values of a sensor at the positions of their measurements.
    PointCloud2, "sensor_msgs/PointCloud2", 129 + CLOUD_POINTS * CLOUD_POINT_BYTES,
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\nuint32 point_step\n\
     uint32 row_step\nuint8[] data\nbool is_dense\n",
    [HEADER, TIME, POINT_FIELD]
}
ros! {
    /// `visualization/map/NAME`: map of a sensor's values.
    OccupancyGrid, "nav_msgs/OccupancyGrid", 100 + crate::FieldMap::CELLS, GRID.1,
    [HEADER, TIME, META, POSE, POINT, QUATERNION]
}
ros! {
    /// `log`: log events of the processes.
    Log, "rcl_interfaces/Log", 640,
    "uint8 DEBUG=10\nuint8 INFO=20\nuint8 WARN=30\nuint8 ERROR=40\nuint8 FATAL=50\nbuiltin_interfaces/Time stamp\nuint8 level\n\
     string name\nstring msg\nstring file\nstring function\nuint32 line\n",
    [TIME]
}

/// Returns the definition of a type name of this module; it does not travel with the channel.
#[must_use]
pub fn schema_of(type_name: &str) -> Option<&'static str> {
    fn row<T: Payload>() -> (&'static str, &'static str) {
        (T::type_name(), T::schema())
    }
    let all = [
        row::<TfMessage>(),
        row::<PoseStamped>(),
        row::<Path>(),
        row::<MarkerArray>(),
        row::<PointCloud2>(),
        row::<OccupancyGrid>(),
        row::<Log>(),
    ];
    all.into_iter().find(|(name, _)| *name == type_name).map(|(_, schema)| schema)
}
