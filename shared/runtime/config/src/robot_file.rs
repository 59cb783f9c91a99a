//! The robot file: geometry, node, lines and motors.

use super::{CalibrationFile, MotorTableFile, Point, Points};
use serde::Deserialize;
use std::path::PathBuf;

/// A robot file as written; lengths in metres, forces in newtons, z up, z = 0 is the reference plane.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotFile {
    /// What people call this robot.
    pub name: String,
    /// Geometry, node and limits.
    pub robot: RobotSection,
    /// The lines; leave out for rigid lines without routing.
    #[serde(default)]
    pub lines: LinesSection,
    /// The motors, seen from the line.
    #[serde(default)]
    pub motor: MotorSection,
    /// Where on Earth it stands; only for georeferenced maps.
    pub site: Option<SiteSection>,
    /// The calibration that `[robot]` names.
    #[serde(skip)]
    pub calibration: Option<CalibrationFile>,
    /// The table that `[motor]` names.
    #[serde(skip)]
    pub motor_table: Option<MotorTableFile>,
}

/// `[robot]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotSection {
    /// Mass of the node with its sensors, kg; in water with the water that moves along.
    pub node_mass_kg: f64,
    /// Weight less buoyancy, N; default node_mass_kg x g.
    pub net_weight_n: Option<f64>,
    /// Drag of the node per square of its speed, N s²/m².
    #[serde(default)]
    pub drag_n_s2_m2: f64,
    /// A file of `nims calibrate --out`, from the folder of this file: it gives the anchors and how well they are known.
    pub calibration: Option<PathBuf>,
    /// Where the lines leave their pulleys, one `[x, y, z]` per cable, 3 to 8; `[x, z]`, 2 to 8, for a planar robot; or else
    /// `calibration`.
    #[serde(default)]
    pub anchors_m: Points,
    /// Least and largest line tension allowed, N.
    pub tension_limits_n: [f64; 2],
    /// Largest speed of the node, m/s.
    pub speed_limit_m_s: f64,
    /// Largest acceleration of the node, m/s².
    pub acceleration_limit_m_s2: f64,
    /// Largest cable velocity, m/s; default twice the node's speed.
    pub cable_speed_limit_m_s: Option<f64>,
    /// Shortest and longest line paid out beyond the pulley, m.
    #[serde(default = "default_length_limits")]
    pub length_limits_m: [f64; 2],
    /// The node stays above this height, m.
    #[serde(default)]
    pub ground_m: f64,
    /// Boxes the node must not enter: `[[[x0, y0, z0], [x1, y1, z1]], ..]`, m; of a planar robot `[[[x0, z0], [x1, z1]], ..]`.
    #[serde(default)]
    pub keep_out: Vec<[Point; 2]>,
}

/// `[lines]`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinesSection {
    /// EA, N: tension per unit of strain. Leave out for rigid lines.
    pub stiffness_n: Option<f64>,
    /// Line from the drum to the pulley, which stretches too, m per cable; default 0.
    #[serde(default)]
    pub routed_length_m: Vec<f64>,
}

/// `[motor]`: what the motors draw, by a model or as `table` has it measured. By the model, current = (T (1 + gear_friction s) + coulomb s + viscous v) / force_constant, s = tanh(v / transition), v > 0 reels in.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotorSection {
    /// A file of `nims motor-table --out`, from the folder of this file: the cost of moves is reckoned from it. Faults are still
    /// judged by the model, which also holds outside of what was measured.
    pub table: Option<PathBuf>,
    /// Line tension per ampere, N/A.
    pub force_constant_n_a: f64,
    /// Armature resistance, ohm.
    pub resistance_ohm: f64,
    /// 0 for an ideal gear, near 1 for a self-locking one.
    pub gear_friction: f64,
    /// Friction that does not depend on tension, N.
    pub coulomb_n: f64,
    /// Friction that grows with speed, N s/m.
    pub viscous_n_s_m: f64,
    /// Speed over which friction changes its sign, m/s.
    pub transition_m_s: f64,
    /// Largest continuous current, A.
    pub current_limit_a: f64,
}

impl Default for MotorSection {
    /// A heavily geared brushed motor on a 20 mm drum, as in the comparison of the paper's moves with real motors.
    fn default() -> Self {
        Self {
            table: None,
            force_constant_n_a: 40.0,
            resistance_ohm: 1.2,
            gear_friction: 0.85,
            coulomb_n: 3.0,
            viscous_n_s_m: 20.0,
            transition_m_s: 0.02,
            current_limit_a: 5.0,
        }
    }
}

/// `[site]`.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SiteSection {
    /// Of the origin, degrees north.
    pub latitude_deg: f64,
    /// Of the origin, degrees east.
    pub longitude_deg: f64,
    /// Of the x axis, degrees clockwise from north.
    pub azimuth_deg: f64,
}

fn default_length_limits() -> [f64; 2] {
    [0.05, 200.0]
}
