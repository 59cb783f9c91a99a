//! How well what a robot file states is known; [`crate::model_error`] has what follows for the position.

use nalgebra::Vector3;

use crate::MAX_CABLES;
use crate::robot_error::{RobotError, not_negative};

/// Standard deviations of what a robot file states.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Uncertainty {
    /// Per axis and cable, of the anchors and of the points where the cables are tied to the node, m.
    pub anchors_m: f64,
    /// Radius of the pulleys, the same error for all, m.
    pub pulley_radius_m: f64,
    /// Counted length of each cable, as a share.
    pub cable_scale: f64,
    /// Stiffness EA, the same error for all cables, as a share.
    pub stiffness: f64,
    /// Weight of the node, as a share.
    pub node_weight: f64,
    /// Compliance of the poles, which the model takes for rigid, m/N; each of its own.
    pub pole_m_n: f64,
    /// Friction of the pulleys between drum and node, as a share of the tension; its sign changes with the motion.
    pub pulley_friction: f64,
    /// Length of all cables since the lengths were set, by temperature and creep, as a share.
    pub expansion: f64,
}

impl Uncertainty {
    /// Rejects standard deviations that are negative or not finite.
    pub fn check(&self) -> Result<(), RobotError> {
        let Self { anchors_m, pulley_radius_m, cable_scale, stiffness, node_weight, .. } = *self;
        let Self { pole_m_n, pulley_friction, expansion, .. } = *self;
        let lengths_m = [anchors_m, pulley_radius_m, pole_m_n];
        let shares = [cable_scale, stiffness, node_weight, pulley_friction, expansion];
        lengths_m
            .iter()
            .chain(&shares)
            .try_for_each(|value| not_negative("uncertainty", *value, "finite standard deviations of 0 or more"))
    }
}

/// Sources with the same error for all cables.
pub(crate) const COMMON: usize = 3;

/// Errors of the cables' lengths at one pose, each by one standard deviation of its source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LengthErrors {
    pub(crate) count: usize,
    /// Unit vector of each cable, for the errors of its anchor.
    pub(crate) directions: [Vector3<f64>; MAX_CABLES],
    /// Lengths of the cables, m, for the errors of their scales; and their derivatives with respect to the radius.
    pub(crate) lengths_m: [f64; MAX_CABLES],
    pub(crate) by_radius: [f64; MAX_CABLES],
    /// Common to all cables, m: stiffness, weight of the node, expansion.
    pub(crate) common_m: [[f64; MAX_CABLES]; COMMON],
    /// Independent for each cable, m: pole.
    pub(crate) pole_m: [f64; MAX_CABLES],
    /// Independent, with a sign that changes with the motion, m.
    pub(crate) friction_m: [f64; MAX_CABLES],
}

impl LengthErrors {
    pub(crate) const fn none(count: usize) -> Self {
        Self {
            count,
            directions: [Vector3::new(0.0, 0.0, 0.0); MAX_CABLES],
            lengths_m: [0.0; MAX_CABLES],
            by_radius: [0.0; MAX_CABLES],
            common_m: [[0.0; MAX_CABLES]; COMMON],
            pole_m: [0.0; MAX_CABLES],
            friction_m: [0.0; MAX_CABLES],
        }
    }
}
