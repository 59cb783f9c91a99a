//! Entries of patterns over an area, a line or points; lengths in metres.

use config::Point;
use serde::{Deserialize, Serialize};

/// Rectangle with one constant coordinate: level, or upright along x or y.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Raster {
    /// Corner at which it begins, m.
    pub corner_m: Point,
    /// The opposite corner, m.
    pub opposite_m: Point,
    /// Width of the strip that one line covers, m.
    pub pitch_m: f64,
    /// Share of that width that the next line overlaps, 0 to 0.9; default 0.
    #[serde(default)]
    pub overlap: f64,
    /// Direction of the lines; default: along the longer side.
    pub along: Option<Axis>,
    /// Cruise speed, m/s.
    pub speed_m_s: Option<f64>,
}

/// Points that are visited in order, with a stay at each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DwellPoints {
    /// The points, m.
    pub points_m: Vec<Point>,
    /// Duration of the stay at each, s.
    pub duration_s: f64,
    /// Cruise speed, m/s.
    pub speed_m_s: Option<f64>,
}

/// Straight line between two points with optional stays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transect {
    /// Start, m.
    pub from_m: Point,
    /// End, m.
    pub to_m: Point,
    /// Longest distance between two stays, m; default: no stays on the way.
    pub step_m: Option<f64>,
    /// Duration of the stays at both ends and between them, s; default 0.
    #[serde(default)]
    pub dwell_s: f64,
    /// Cruise speed, m/s.
    pub speed_m_s: Option<f64>,
}

/// A straight line up or down.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Start, m.
    pub at_m: Point,
    /// Height gained, m; negative descends.
    pub rise_m: f64,
    /// Longest distance between two stays, m; default: no stays on the way.
    pub step_m: Option<f64>,
    /// Duration of the stays at both ends and between them, s; default 0.
    #[serde(default)]
    pub dwell_s: f64,
    /// Cruise speed, m/s.
    pub speed_m_s: Option<f64>,
}

/// Fine lines over the parts of a level rectangle that a map marks as worth a second look; an earlier leg makes the
/// map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Adaptive {
    /// Name of the map: its channel is `map/NAME`.
    pub map: String,
    /// A corner of the area, m.
    pub corner_m: Point,
    /// The opposite corner, m, at the same height.
    pub opposite_m: Point,
    /// Distance of the fine lines, m.
    pub pitch_m: f64,
    /// Side of the squares that the area is divided into, m; default: three times `pitch_m`. Half the pitch of the
    /// coarse raster is a good choice.
    pub tile_m: Option<f64>,
    /// Largest share of the area that is scanned, 0 to 1; default 0.5.
    #[serde(default = "half")]
    pub share: f64,
    /// Parts with less than this share of the largest merit are not scanned, 0 to 1; default 0.2.
    #[serde(default = "fifth")]
    pub least: f64,
    /// Merit of a part; default: `gradient`.
    #[serde(default)]
    pub by: By,
    /// Cruise speed, m/s.
    pub speed_m_s: Option<f64>,
}

/// Merit of a part of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum By {
    /// Change of the field along a track or from one track to the next.
    #[default]
    Gradient,
    /// Uncertainty of the map.
    Variance,
}

fn half() -> f64 {
    0.5
}

fn fifth() -> f64 {
    0.2
}

/// An axis of the robot's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Level.
    X,
    /// Level, across x.
    Y,
    /// Up.
    Z,
}

impl Axis {
    /// Every axis with its name, in the order of coordinates.
    pub const ALL: [(Self, &'static str); 3] = [(Self::X, "x"), (Self::Y, "y"), (Self::Z, "z")];

    /// Returns the number of its coordinate.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }
}

impl Raster {
    /// Largest distance between neighbouring lines, m.
    #[must_use]
    pub fn spacing_m(&self) -> f64 {
        self.pitch_m * (1.0 - self.overlap)
    }
}
