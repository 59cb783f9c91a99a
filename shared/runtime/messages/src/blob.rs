//! Messages of ROS 2 whose samples have different lengths: pictures, scans and grids.
//!
//! They are the one exception from samples of fixed size. A channel `blob/NAME` reserves memory for samples of its
//! largest length when its publisher is created. No process of the control chain reads or writes one.

use std::sync::OnceLock;

use crate::cdr::Cdr;
use crate::message::expanded::complete;
use crate::message::hash_of;
use crate::ros::{GRID, HEADER, IMAGE, META, POINT, POSE, QUATERNION, TIME};

/// Type of the samples of a blob channel. A sample is a CDR body of it; every tool that knows ROS 2 shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlobType {
    /// `sensor_msgs/CompressedImage`: a picture as a JPEG or PNG file.
    CompressedImage,
    /// `sensor_msgs/Image`: a picture as rows of pixels.
    Image,
    /// `sensor_msgs/LaserScan`: distances in a plane.
    LaserScan,
    /// `nav_msgs/OccupancyGrid`: cells with -1 for unknown, 0 to 100 else.
    OccupancyGrid,
}

impl BlobType {
    /// Every type.
    pub const ALL: [Self; 4] = [Self::CompressedImage, Self::Image, Self::LaserScan, Self::OccupancyGrid];

    /// Returns the type with this type name; `None` for others.
    #[must_use]
    pub fn of_name(type_name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.type_name() == type_name)
    }

    /// Returns `package/Type/hash`.
    #[must_use]
    pub fn type_name(self) -> &'static str {
        &self.texts().0
    }

    /// Returns the complete definition.
    #[must_use]
    pub fn schema(self) -> &'static str {
        &self.texts().1
    }

    /// Type name and definition.
    fn texts(self) -> &'static (String, String) {
        static TEXTS: [OnceLock<(String, String)>; 4] = [const { OnceLock::new() }; 4];
        let (name, own, nested): (&str, &str, &[(&str, &str)]) = match self {
            Self::CompressedImage => (IMAGE.0, IMAGE.1, &[HEADER, TIME]),
            Self::Image => (
                "sensor_msgs/Image",
                "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n\
                 uint8[] data\n",
                &[HEADER, TIME],
            ),
            Self::LaserScan => (
                "sensor_msgs/LaserScan",
                "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\n\
                 float32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\n\
                 float32[] intensities\n",
                &[HEADER, TIME],
            ),
            Self::OccupancyGrid => (GRID.0, GRID.1, &[HEADER, TIME, META, POSE, POINT, QUATERNION]),
        };
        TEXTS[self as usize].get_or_init(|| {
            let nested: Vec<(&'static str, String)> =
                nested.iter().map(|(name, lines)| (*name, (*lines).to_owned())).collect();
            let schema = complete(own, &nested);
            (format!("{name}/{:08x}", hash_of(&schema)), schema)
        })
    }
}

/// Encodes a [`BlobType::CompressedImage`] into `body`, whose memory is used again. `format` is `jpeg` or `png`.
pub fn compressed_image(body: &mut Vec<u8>, unix_ns: u64, frame: &str, format: &str, file: &[u8]) {
    encode(body, unix_ns, frame, |cdr| {
        cdr.text(format);
        cdr.bytes(file);
    });
}

/// Rows of pixels of a [`BlobType::Image`].
#[derive(Debug, Clone, Copy)]
pub struct Pixels<'a> {
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// As in `sensor_msgs/image_encodings`, e.g. `rgb8` or `mono16`.
    pub encoding: &'a str,
    /// Row by row; numbers of more than one byte with the lowest byte first.
    pub data: &'a [u8],
}

/// Encodes a [`BlobType::Image`] into `body`, whose memory is used again.
pub fn image(body: &mut Vec<u8>, unix_ns: u64, frame: &str, pixels: &Pixels<'_>) {
    encode(body, unix_ns, frame, |cdr| {
        cdr.u32(pixels.height);
        cdr.u32(pixels.width);
        cdr.text(pixels.encoding);
        cdr.u8(0);
        cdr.u32(pixels.data.len() as u32 / pixels.height.max(1));
        cdr.bytes(pixels.data);
    });
}

/// Distances of a [`BlobType::LaserScan`].
#[derive(Debug, Clone, Copy)]
pub struct Scan<'a> {
    /// Angles of the first and the last distance, rad.
    pub angles_rad: [f32; 2],
    /// Duration of the scan, s.
    pub duration_s: f32,
    /// Distances between which the device measures, m.
    pub limits_m: [f32; 2],
    /// Distances, m.
    pub distances_m: &'a [f32],
}

/// Encodes a [`BlobType::LaserScan`] into `body`, whose memory is used again.
pub fn laser_scan(body: &mut Vec<u8>, unix_ns: u64, frame: &str, scan: &Scan<'_>) {
    let steps = scan.distances_m.len().saturating_sub(1).max(1) as f32;
    let [first_rad, last_rad] = scan.angles_rad;
    encode(body, unix_ns, frame, |cdr| {
        cdr.f32s(&[first_rad, last_rad, (last_rad - first_rad) / steps, scan.duration_s / steps, scan.duration_s]);
        cdr.f32s(&scan.limits_m);
        cdr.u32(scan.distances_m.len() as u32);
        cdr.f32s(scan.distances_m);
        cdr.u32(0);
    });
}

/// Cells of a [`BlobType::OccupancyGrid`].
#[derive(Debug, Clone, Copy)]
pub struct Cells<'a> {
    /// Side of a cell, m.
    pub cell_m: f32,
    /// Cells in x.
    pub columns: u32,
    /// Corner with the lowest x and y, m.
    pub origin_m: [f64; 3],
    /// Row by row from the lowest y; -1 for unknown, 0 to 100 else.
    pub data: &'a [i8],
}

/// Encodes a [`BlobType::OccupancyGrid`] into `body`, whose memory is used again.
pub fn occupancy_grid(body: &mut Vec<u8>, unix_ns: u64, frame: &str, cells: &Cells<'_>) {
    encode(body, unix_ns, frame, |cdr| {
        cdr.time(unix_ns);
        cdr.f32s(&[cells.cell_m]);
        cdr.u32(cells.columns);
        cdr.u32(cells.data.len() as u32 / cells.columns.max(1));
        cdr.pose(&cells.origin_m);
        cdr.bytes(bytemuck::cast_slice(cells.data));
    });
}

fn encode(body: &mut Vec<u8>, unix_ns: u64, frame: &str, fields: impl FnOnce(&mut Cdr)) {
    let mut cdr = Cdr(std::mem::take(body));
    cdr.0.clear();
    cdr.header(unix_ns, frame);
    fields(&mut cdr);
    *body = cdr.0;
}
