//! The robot file: geometry, node, cables and motors.

use super::{
    CalibrationFile, IdentifiedFile, MotorTableFile, ObstacleSection, Point, Points, Replaced, UncertaintySection,
};
use crate::section::{above, between};
use cable_robot::anchors::RADII_M;
use serde::Deserialize;
use std::path::PathBuf;

crate::choice! {
    /// Kind of the points where the cables leave for the node.
    #[derive(Default)]
    pub enum PulleyKind {
        /// Pulleys that swivel about the vertical axis through the anchor.
        Swivel = "swivel",
        /// Eyes: the cables leave from the anchors themselves.
        #[default]
        Eye = "eye",
    }
}

impl From<PulleyKind> for cable_robot::PulleyKind {
    fn from(kind: PulleyKind) -> Self {
        match kind {
            PulleyKind::Eye => Self::Eye,
            PulleyKind::Swivel => Self::Swivel,
        }
    }
}

/// A robot file as written; lengths in metres, forces in newtons, z up, z = 0 is the reference plane.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotFile {
    /// Name of the robot.
    pub name: String,
    /// Geometry, node and limits.
    pub robot: RobotSection,
    /// The cables; omit it for rigid cables without routing.
    #[serde(default)]
    pub lines: LinesSection,
    /// The drums, if the encoders count their turns; omit it for encoders on idlers.
    pub drum: Option<DrumSection>,
    /// The motors, with all quantities at the cable.
    #[serde(default)]
    pub motor: MotorSection,
    /// How well all of this is known.
    #[serde(default)]
    pub uncertainty: UncertaintySection,
    /// Bodies that neither the node nor a cable may touch.
    #[serde(default)]
    pub obstacle: Vec<ObstacleSection>,
    /// Geographic position; only for georeferenced maps.
    pub site: Option<SiteSection>,
    /// The calibration that `robot.calibration` names.
    #[serde(skip)]
    pub calibration: Option<CalibrationFile>,
    /// The tables that `motor.table` names: none, one for all motors, or one per cable.
    #[serde(skip)]
    pub motor_tables: Vec<MotorTableFile>,
    /// The file that `robot.identified` names.
    #[serde(skip)]
    pub identified: Option<IdentifiedFile>,
    /// The values that it replaced; the sections have those in use.
    #[serde(skip)]
    pub replaced: Vec<Replaced>,
    /// Lowest supply voltage of the drives, V, if a system file names this robot.
    #[serde(skip)]
    pub supply_min_v: Option<f64>,
}

crate::section! {
    /// `[robot]`. The values are checked against generous limits for such robots: larger ones are in another unit or
    /// lack a decimal point.
    pub struct RobotSection {
        /// Mass of the node with its sensors, kg; in water with the water that moves along.
        pub node_mass_kg: f64 => above(0.0, 1000.0, "kg"),
        /// Weight less buoyancy, N; default node_mass_kg x g.
        pub net_weight_n: Option<f64> => between(0.0, 1e4, "N"),
        /// Drag of the node per square of its speed, N s²/m².
        #[serde(default)]
        pub drag_n_s2_m2: f64 => between(0.0, 1e4, "N s²/m²"),
        /// A file from `nims calibrate --out`, relative to the folder of this file, with the anchors and their
        /// covariance.
        pub calibration: Option<PathBuf>,
        /// A file from `nims identify --out`, relative to the folder of this file. Its values take the places of
        /// `node_mass_kg`, of `stiffness_n` in `[lines]` and of those in `[motor]`; its delay and lag are those of the
        /// drives where the system file states no `drive_lag_s`.
        pub identified: Option<PathBuf>,
        /// The points where the cables leave for the node, or where they enter their swivelling pulleys, m: one
        /// `[x, y, z]` per cable, 3 to 8; one `[x, z]` per cable, 2 to 8, for a planar robot. Omit them with a
        /// `calibration`.
        #[serde(default)]
        pub anchors_m: Points,
        /// What the cables leave from: `"eye"`, the anchor itself, or `"swivel"`, a pulley that swivels about the
        /// vertical axis through the anchor; the cable enters it from below along this axis. Omitted: eyes, of which
        /// every estimate states that they may be pulleys.
        pub pulley: Option<PulleyKind>,
        /// Radius of each pulley to the middle of the cable, m per cable; 0 for a cable through an eye. Only with
        /// `pulley = "swivel"`.
        #[serde(default)]
        pub pulley_radius_m: Vec<f64> => between(*RADII_M.start(), *RADII_M.end(), "m (are these millimetres?)").each("radii"),
        /// Smallest and largest allowed cable tension, N.
        #[serde(deserialize_with = "crate::exactly")]
        pub tension_limits_n: [f64; 2] => between(0.0, 1e5, "N").each("two tensions"),
        /// Largest speed of the node, m/s. Such a robot moves at walking pace.
        pub speed_limit_m_s: f64 => above(0.0, 10.0, "m/s"),
        /// Largest acceleration of the node, m/s².
        pub acceleration_limit_m_s2: f64 => above(0.0, 50.0, "m/s²"),
        /// Largest cable velocity, m/s; default: twice the speed limit of the node.
        pub cable_speed_limit_m_s: Option<f64> => above(0.0, 10.0, "m/s"),
        /// Shortest and longest cable beyond the pulley, m.
        #[serde(default = "default_length_limits", deserialize_with = "crate::exactly")]
        pub length_limits_m: [f64; 2] => above(0.0, 2000.0, "m").each("two lengths"),
        /// Smallest height of the node, m.
        #[serde(default)]
        pub ground_m: f64 => between(-500.0, 500.0, "m"),
        /// Boxes that the node must not enter, m: `[[[x0, y0, z0], [x1, y1, z1]], ..]`, or
        /// `[[[x0, z0], [x1, z1]], ..]` for a planar robot.
        #[serde(default, deserialize_with = "crate::each_exactly")]
        pub keep_out: Vec<[Point; 2]> => between(-1e4, 1e4, "m").each("coordinates"),
        /// Smallest distance of node and cables from every `[[obstacle]]`, m.
        #[serde(default = "default_clearance")]
        pub clearance_m: f64 => between(0.0, 10.0, "m"),
    }
}

crate::section! {
    /// `[lines]`.
    #[derive(Default)]
    pub struct LinesSection {
        /// Stiffness EA, N: tension per unit of strain. Omit it for rigid cables.
        pub stiffness_n: Option<f64> => between(100.0, 1e7, "N (EA, tension per unit of strain)"),
        /// Mass of the cables, kg/m; in water less the water that they displace. 0: their weight does not count.
        #[serde(default)]
        pub mass_kg_m: f64 => between(0.0, 1.0, "kg/m"),
        /// Whether the idlers count the cable as stretched as it passes: true or false, or one of them per cable.
        #[serde(default)]
        pub counts_stretched: CountsStretched,
        /// Length from the drum to the pulley, which stretches too, m per cable; default 0.
        #[serde(default)]
        pub routed_length_m: Vec<f64> => between(0.0, 1000.0, "m").each("lengths"),
    }
}

crate::choice! {
    /// Encoder of each cable that counts turns of its drum.
    #[derive(Default)]
    pub enum DrumEncoder {
        /// The one by which the robot counts its cables.
        #[default]
        First = "first",
        /// The second one, which is compared; the first one is on an idler.
        Second = "second",
    }
}

crate::section! {
    /// `[drum]`: encoders are on the motors or on the drums. A turn winds the more cable the more of it is on the drum
    /// already. Their counts per metre in the system file, and all of `[motor]`, are those of the bare drum.
    pub struct DrumSection {
        /// Diameter of the circle on which the middle of the cable runs on the bare drum, m: drum plus cable.
        pub diameter_m: f64 => between(0.005, 2.0, "m (are these millimetres?)"),
        /// Diameter of the cable, m.
        pub cable_diameter_m: f64 => between(0.0, 0.05, "m (are these millimetres?)"),
        /// Turns of cable that lie side by side in a layer.
        pub turns_per_layer: f64 => between(1.0, 1e4, "turns"),
        /// Cable from its end on the drum to the node, m per cable, which also limits the length; without the turns
        /// that have to stay on the drum.
        pub cable_m: Vec<f64> => between(0.1, 2000.0, "m").each("lengths"),
        /// Encoders that count turns of the drum: `"first"`, those of `counts_per_m`, or `"second"`, those of
        /// `second_counts_per_m` of the system file, which are compared with idlers.
        #[serde(default)]
        pub encoder: DrumEncoder,
        /// Cable from the drum to the idler, m; 0: the idler is beside the drum. It stretches between the two encoders.
        #[serde(default)]
        pub idler_m: f64 => between(0.0, 200.0, "m"),
    }
}

/// `motor.table`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(untagged, expecting = "the path of a table, or a list with one path per cable")]
pub enum TablePaths {
    /// The same motors everywhere.
    All(PathBuf),
    /// For the motor of each cable; empty: no table.
    Each(Vec<PathBuf>),
}

impl TablePaths {
    /// Returns the paths, in the order of the cables.
    #[must_use]
    pub fn paths(&self) -> &[PathBuf] {
        match self {
            Self::All(path) => std::slice::from_ref(path),
            Self::Each(paths) => paths,
        }
    }
}

/// `lines.counts_stretched`.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "true or false, or a list with one of them per cable")]
pub enum CountsStretched {
    /// The same for all cables.
    All(bool),
    /// For each cable.
    Each(Vec<bool>),
}

impl Default for CountsStretched {
    fn default() -> Self {
        Self::All(false)
    }
}

impl CountsStretched {
    /// Returns the value of a cable, counted from 0.
    #[must_use]
    pub fn at(&self, cable: usize) -> bool {
        match self {
            Self::All(stretched) => *stretched,
            Self::Each(cables) => cables.get(cable).copied().unwrap_or(false),
        }
    }

    /// Returns whether any cable is counted stretched.
    #[must_use]
    pub fn any(&self) -> bool {
        match self {
            Self::All(stretched) => *stretched,
            Self::Each(cables) => cables.contains(&true),
        }
    }

    /// Returns one value per cable; a list keeps its length.
    pub(super) fn list(&self, cables: usize) -> Vec<bool> {
        match self {
            Self::All(stretched) => vec![*stretched; cables],
            Self::Each(list) => list.clone(),
        }
    }
}

crate::section! {
    /// `[motor]`: the current of the motors, from a model or measured in `table`. The defaults are a brushed motor with
    /// a high gear ratio on a 20 mm drum, as in the paper's comparison of moves with real motors.
    ///
    /// Model: current = (T (1 + gear_friction s) + coulomb s + viscous v) / force_constant, with
    /// s = tanh(v / transition); v > 0 reels in.
    pub struct MotorSection {
        /// A file from `nims motor-table --out`, relative to the folder of this file, or a list with one per cable, for
        /// currents and the energy of moves. Fault detection uses the model, which is valid outside the measured range
        /// too.
        pub table: TablePaths = TablePaths::Each(Vec::new()),
        /// Cable tension per ampere, N/A.
        pub force_constant_n_a: f64 = 40.0 => between(1e-3, 1e5, "N/A"),
        /// Armature resistance, ohm.
        pub resistance_ohm: f64 = 1.2 => between(0.0, 1e4, "ohm"),
        /// 0 for an ideal gear, near 1 for a self-locking one.
        pub gear_friction: f64 = 0.85 => between(0.0, 100.0, ""),
        /// Friction that does not depend on tension, N.
        pub coulomb_n: f64 = 3.0 => between(0.0, 1e5, "N"),
        /// Friction that grows with speed, N s/m.
        pub viscous_n_s_m: f64 = 20.0 => between(0.0, 1e6, "N s/m"),
        /// Width of the velocity range in which friction changes its sign, m/s.
        pub transition_m_s: f64 = 0.02 => between(0.0, 10.0, "m/s"),
        /// Largest continuous current, A.
        pub current_limit_a: f64 = 5.0 => above(0.0, 500.0, "A"),
    }
}

crate::section! {
    /// `[site]`.
    #[derive(Copy)]
    pub struct SiteSection {
        /// Latitude of the origin, degrees north.
        pub latitude_deg: f64 => between(-90.0, 90.0, ""),
        /// Longitude of the origin, degrees east.
        pub longitude_deg: f64 => between(-180.0, 180.0, ""),
        /// Azimuth of the x axis, degrees clockwise from north.
        pub azimuth_deg: f64 => between(-360.0, 360.0, ""),
    }
}

/// About three times the largest position error in drawn worlds of 10 m, 35 mm (`docs/truth.md`).
fn default_clearance() -> f64 {
    0.1
}

fn default_length_limits() -> [f64; 2] {
    [0.05, 200.0]
}
