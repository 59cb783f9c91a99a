//! The parts of a robot, and their checks.

use nalgebra::Vector3;

use crate::drum::{Drum, DrumParts};
use crate::energy::{CurrentTable, Motors};
use crate::keep_out::{KeepOut, MAX_KEEP_OUT};
use crate::motor::{DriveLimits, Motor};
use crate::obstacle::{MAX_OBSTACLES, Obstacle};
use crate::robot_error::{FARTHEST_M, RobotError, refuse};
use crate::{Anchors, CableVec, MAX_CABLES, Uncertainty};

/// Length limits if the robot file has none, m: the width of a hand, and longer than any winch holds.
pub const DEFAULT_LENGTH_LIMITS_M: [f64; 2] = [0.05, 1e3];

/// Kind of the points where the cables of a robot leave for the node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PulleyKind {
    /// Eyes: the cables leave from the anchors themselves.
    #[default]
    Eye,
    /// Pulleys that swivel about the vertical axis through the anchor, see [`crate::pulley`].
    Swivel,
}

/// The parts of a robot: the keys of the robot file. [`RobotParts::default`] sets only parts with a default; anchors,
/// mass, tension limits, speed and acceleration must be given.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotParts {
    /// Anchor positions, m, z up.
    pub anchors_m: Vec<[f64; 3]>,
    /// Whether the node moves only in the plane y = 0, in which all anchors lie.
    pub planar: bool,
    /// Kind of the points where the cables leave for the node.
    pub pulley: PulleyKind,
    /// Radius of the pulley per cable to the middle of the cable, m; 0 for a cable through an eye. None: eyes.
    pub pulley_radius_m: Option<Vec<f64>>,
    /// Mass of the node, kg; in water including the added mass.
    pub node_mass_kg: f64,
    /// Weight less buoyancy, N; default mass x standard gravity.
    pub net_weight_n: Option<f64>,
    /// Drag divided by squared speed, N s²/m²; default 0.
    pub drag_n_s2_m2: f64,
    /// Lowest and highest tension of a cable, N.
    pub tension_limits_n: [f64; 2],
    /// Highest speed of the node, m/s.
    pub speed_limit_m_s: f64,
    /// Highest speed of every cable, m/s; default twice that of the node.
    pub cable_speed_limit_m_s: Option<f64>,
    /// Highest acceleration of the node, m/s².
    pub acceleration_limit_m_s2: f64,
    /// Lowest height of the node, m.
    pub ground_m: f64,
    /// Keep-out boxes, each with its lower and upper corner, m.
    pub keep_out_m: Vec<[[f64; 3]; 2]>,
    /// Bodies that neither the node nor a cable may touch.
    pub obstacles: Vec<Obstacle>,
    /// Smallest distance of node and cables from every obstacle, m.
    pub clearance_m: f64,
    /// EA of the cables, N; None for rigid cables.
    pub stiffness_n: Option<f64>,
    /// Mass of the cables, kg/m; in water less the water that they displace. 0: too light to matter.
    pub cable_mass_kg_m: f64,
    /// Whether the idler of each cable counts the cable as stretched as it passes; None: none does.
    pub counts_stretched: Option<Vec<bool>>,
    /// Cable between drum and anchor per cable, m, which also stretches; default 0.
    pub routed_length_m: Option<Vec<f64>>,
    /// The drums; None: encoders on idlers, and drums whose radius does not matter.
    pub drum: Option<DrumParts>,
    /// Shortest and longest measured length per cable, m; default [`DEFAULT_LENGTH_LIMITS_M`].
    pub length_limits_m: Option<Vec<[f64; 2]>>,
    /// The winch motors, with quantities at the cable.
    pub motor: Motor,
    /// Measured current of the motors: none for the model, one for all, or one per cable. At most 24 speeds and 16
    /// tensions each.
    pub motor_tables: Vec<CurrentTable>,
    /// What the drives can deliver to the motors; default unlimited.
    pub drive_limits: DriveLimits,
    /// Covariance of x1, y1, z1, x2, .. of the anchors, a row per coordinate, m²; None if unknown.
    pub anchor_covariance_m2: Option<Vec<Vec<f64>>>,
    /// Covariance of what the lengths depend on, by a calibration; None if unknown. Per cable five rows: x, y and z of
    /// the anchor less those of the point where the cable is tied to the node (m), the scale of the length as a share
    /// (0: not calibrated), and the radius of the pulley (m; 0: not calibrated), by which all are wrong together.
    pub length_covariance: Option<Vec<Vec<f64>>>,
    /// Standard deviations of the other parts; default 0: they are exact.
    pub uncertainty: Uncertainty,
}

impl Default for RobotParts {
    fn default() -> Self {
        Self {
            anchors_m: Vec::new(),
            planar: false,
            pulley: PulleyKind::Eye,
            pulley_radius_m: None,
            node_mass_kg: 0.0,
            net_weight_n: None,
            drag_n_s2_m2: 0.0,
            tension_limits_n: [0.0, 0.0],
            speed_limit_m_s: 0.0,
            cable_speed_limit_m_s: None,
            acceleration_limit_m_s2: 0.0,
            ground_m: 0.0,
            keep_out_m: Vec::new(),
            obstacles: Vec::new(),
            clearance_m: 0.0,
            stiffness_n: None,
            cable_mass_kg_m: 0.0,
            counts_stretched: None,
            routed_length_m: None,
            drum: None,
            length_limits_m: None,
            motor: Motor::default(),
            motor_tables: Vec::new(),
            drive_limits: DriveLimits::default(),
            anchor_covariance_m2: None,
            length_covariance: None,
            uncertainty: Uncertainty::default(),
        }
    }
}

pub(crate) fn with_pulleys(anchors: Anchors, kind: PulleyKind, radii_m: Option<&[f64]>) -> Result<Anchors, RobotError> {
    match (kind, radii_m) {
        (PulleyKind::Eye, None) => Ok(anchors),
        (PulleyKind::Swivel, None) => {
            refuse("pulley_radius_m", "is missing for pulleys that swivel", "one radius per cable, in metres")
        }
        (PulleyKind::Eye, Some(radii_m)) => match radii_m.iter().find(|r| **r != 0.0) {
            Some(r) => refuse("pulley_radius_m", format!("contains {r} for an eye"), "0, or `pulley = \"swivel\"`"),
            None => anchors.with_pulleys(radii_m),
        },
        (PulleyKind::Swivel, Some(radii_m)) => anchors.with_pulleys(radii_m),
    }
}

/// The drum of each cable. Turns of a drum do not depend on the stretch.
pub(crate) fn drums(
    given: Option<&DrumParts>,
    routed_length_m: &CableVec,
    counts_stretched: u8,
) -> Result<[Drum; MAX_CABLES], RobotError> {
    let mut drums = [Drum::default(); MAX_CABLES];
    let Some(given) = given else { return Ok(drums) };
    if given.counted && counts_stretched != 0 {
        let accepted = "no counts_stretched with the section [drum], whose turns do not depend on the stretch";
        return refuse("counts_stretched", "is true beside encoders on drums".to_owned(), accepted);
    }
    let of_cables = Drum::of(given, routed_length_m)?;
    drums[..of_cables.len()].copy_from_slice(&of_cables);
    Ok(drums)
}

pub(crate) fn routed_lengths(lengths_m: Option<&[f64]>, cables: usize) -> Result<CableVec, RobotError> {
    const KEY: &str = "routed_length_m";
    let Some(lengths) = lengths_m else { return Ok(CableVec::zeros(cables)) };
    if lengths.len() != cables {
        let problem = format!("has {} values for {cables} cables", lengths.len());
        return refuse(KEY, problem, "one length per cable, in metres");
    }
    if let Some(i) = lengths.iter().position(|l| !(l.is_finite() && (0.0..=FARTHEST_M).contains(l))) {
        let problem = format!("number {} is {}", i + 1, lengths[i]);
        return refuse(KEY, problem, "finite lengths of 0 or more, in metres");
    }
    Ok(CableVec::from_fn(cables, |i| lengths[i]))
}

/// One bit per cable.
pub(crate) fn stretched_counts(given: Option<&[bool]>, cables: usize) -> Result<u8, RobotError> {
    let Some(given) = given else { return Ok(0) };
    if given.len() != cables {
        let problem = format!("has {} values for {cables} cables", given.len());
        return refuse("counts_stretched", problem, "true or false, or a list with one of them per cable");
    }
    Ok(given.iter().rev().fold(0, |bits, stretched| bits << 1 | u8::from(*stretched)))
}

/// The motors with their measured tables, if any.
pub(crate) fn motors(model: Motor, tables: &[CurrentTable], cables: usize) -> Result<Motors, RobotError> {
    Motors::new(model, tables, cables).or_else(|error| {
        let accepted = "one table for all motors or one per cable, each with at most 24 speeds and 16 tensions";
        refuse("table", format!("does not fit: {error}"), accepted)
    })
}

pub(crate) fn obstacle_places(obstacles: &[Obstacle]) -> Result<[Option<Obstacle>; MAX_OBSTACLES], RobotError> {
    if obstacles.len() > MAX_OBSTACLES {
        return refuse("obstacle", format!("has {} entries", obstacles.len()), "at most 16 obstacles");
    }
    Ok(std::array::from_fn(|i| obstacles.get(i).copied()))
}

/// Limits of the lengths; no cable is longer than what its drum holds.
pub(crate) fn length_limits(
    limits_m: Option<&[[f64; 2]]>,
    drums: &[Drum],
) -> Result<[[f64; 2]; MAX_CABLES], RobotError> {
    const KEY: &str = "length_limits_m";
    let mut length_limits_m = [DEFAULT_LENGTH_LIMITS_M; MAX_CABLES];
    let limits = limits_m.unwrap_or(&length_limits_m[..drums.len()]).to_vec();
    if limits.len() != drums.len() {
        let problem = format!("has {} pairs for {} cables", limits.len(), drums.len());
        return refuse(KEY, problem, "one [min, max] per cable, in metres");
    }
    for (i, ([min, max], drum)) in limits.iter().zip(drums).enumerate() {
        if !(*min > 0.0 && max > min && *max <= FARTHEST_M) {
            let problem = format!("number {} is [{min}, {max}]", i + 1);
            return refuse(KEY, problem, "[min, max] in metres with 0 < min < max <= 1e5");
        }
        let longest_m = max.min(drum.longest_m());
        if longest_m <= *min {
            let accepted = "more than routed_length_m and the least length of length_limits_m together, in metres";
            return refuse("cable_m", format!("leaves {longest_m} m beyond anchor {}", i + 1), accepted);
        }
        length_limits_m[i] = [*min, longest_m];
    }
    Ok(length_limits_m)
}

pub(crate) fn keep_out_boxes(given: &[[[f64; 3]; 2]]) -> Result<([KeepOut; MAX_KEEP_OUT], usize), RobotError> {
    const KEY: &str = "keep_out";
    if given.len() > MAX_KEEP_OUT {
        return refuse(KEY, format!("has {} boxes", given.len()), "at most 8 boxes [[min], [max]]");
    }
    let mut boxes = [KeepOut { min: Vector3::zeros(), max: Vector3::zeros() }; MAX_KEEP_OUT];
    for (i, [min, max]) in given.iter().enumerate() {
        if !(0..3).all(|k| min[k].is_finite() && max[k].is_finite() && min[k] < max[k]) {
            let problem = format!("box {} goes from {min:?} to {max:?}", i + 1);
            return refuse(KEY, problem, "[[min], [max]] with finite min below max in x, y and z");
        }
        boxes[i] = KeepOut { min: Vector3::from(*min), max: Vector3::from(*max) };
    }
    Ok((boxes, given.len()))
}
