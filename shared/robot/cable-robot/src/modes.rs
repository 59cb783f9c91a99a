//! Modes of vibration of the node on elastic cables, for small motions about a position at rest.
//!
//! The node of mass m moves by M d²x/dt² + K x = 0 with M = m I and the second derivative of the cables' potential,
//! K = Σ k_i u_i u_i' + T_i C_i, where k_i = EA / (l_i + Lx) is the stiffness of a cable from drum to node, u its
//! direction and C the curvature of its length (see [`crate::pulley`]). Drums stand still; cables have no mass and no
//! damping. Angular frequencies are the square roots of the eigenvalues of K / m.

use nalgebra::{Matrix3, Vector3};

use crate::Robot;
use crate::elastic::{Equilibrium, unstretched};
use crate::kinematics::inverse_kinematics;
use crate::linalg::eigen::SymmetricEigen;

/// One mode of vibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// Unit vector of the motion.
    pub direction: Vector3<f64>,
    /// Angular frequency, rad/s.
    pub angular_rad_s: f64,
}

impl Mode {
    /// Period, s.
    pub fn period_s(&self) -> f64 {
        2.0 * std::f64::consts::PI / self.angular_rad_s
    }

    /// Largest distance from its place, m, after the node's acceleration jumps by this, m/s²: the new place of rest is
    /// a / ω² away, and the node swings by as much about it.
    pub fn swing_m(&self, acceleration_m_s2: &Vector3<f64>) -> f64 {
        2.0 * self.direction.dot(acceleration_m_s2).abs() / (self.angular_rad_s * self.angular_rad_s)
    }
}

/// Axes of a stiffness, from which those of a similar one are found: those of space by default.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes([Vector3<f64>; 3]);

impl Default for Axes {
    fn default() -> Self {
        Self([Vector3::x(), Vector3::y(), Vector3::z()])
    }
}

/// Modes at a position, the slowest first; two for a planar robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Modes {
    modes: [Mode; 3],
    count: usize,
}

impl std::ops::Deref for Modes {
    type Target = [Mode];

    fn deref(&self) -> &[Mode] {
        &self.modes[..self.count]
    }
}

impl Modes {
    /// Computes the modes at a position, m, with these tensions, N. None for rigid cables, at a position without
    /// directions, and where the cables do not hold the node in every direction.
    pub fn at(robot: &Robot, position: &Vector3<f64>, tensions_n: &[f64]) -> Option<Self> {
        Self::near(robot, &stiffness_n_m(robot, position, tensions_n)?, &mut Axes::default())
    }

    /// Computes the modes of a node on cables of this stiffness, N/m, from the axes of a stiffness that differs little,
    /// which takes less time, and stores the axes. None where the cables do not hold the node in every direction.
    pub fn near(robot: &Robot, stiffness_n_m: &Matrix3<f64>, axes: &mut Axes) -> Option<Self> {
        let eigen = SymmetricEigen::near(&(stiffness_n_m / robot.node_mass_kg()), &axes.0)?;
        axes.0 = eigen.vectors;
        let mut modes =
            [0, 1, 2].map(|i| Mode { direction: eigen.vectors[i], angular_rad_s: eigen.values[i].max(0.0).sqrt() });
        if robot.is_planar() {
            // The motion across the plane goes to the end.
            modes.sort_by(|a, b| a.direction.y.abs().total_cmp(&b.direction.y.abs()));
        }
        let count = if robot.is_planar() { 2 } else { 3 };
        modes[..count].sort_by(|a, b| a.angular_rad_s.total_cmp(&b.angular_rad_s));
        (modes[0].angular_rad_s > 0.0).then_some(Self { modes, count })
    }

    /// The mode that swings most after a jump of the acceleration, m/s².
    pub fn largest(&self, acceleration_m_s2: &Vector3<f64>) -> Mode {
        let swing_m = |mode: &Mode| mode.swing_m(acceleration_m_s2);
        let [first, rest @ ..] = &self[..] else { return self.modes[0] };
        rest.iter().fold(*first, |most, mode| if swing_m(mode) > swing_m(&most) { *mode } else { most })
    }
}

/// [`stiffness_n_m`] at an equilibrium, which has it already if no cable is slack.
pub fn stiffness_at_n_m(robot: &Robot, at: &Equilibrium) -> Option<Matrix3<f64>> {
    if at.any_slack() { stiffness_n_m(robot, &at.position, &at.tensions_n) } else { at.stiffness_n_m }
}

/// Force per displacement of the node while the drums stand still, N/m. A cable with weight is softer than its stretch
/// alone, because its bow straightens. None for rigid cables, and at a position without directions.
pub fn stiffness_n_m(robot: &Robot, position: &Vector3<f64>, tensions_n: &[f64]) -> Option<Matrix3<f64>> {
    let ea = robot.stiffness_n()?;
    let (anchors, routed) = (robot.anchors(), robot.routed_length_m());
    if tensions_n.len() != robot.cable_count() {
        return None;
    }
    let free = unstretched(robot, position, &inverse_kinematics(anchors, position), tensions_n);
    let mut sum = Matrix3::zeros();
    for (i, tension_n) in tensions_n.iter().enumerate() {
        let cable = anchors.pulley(i).cable_to(position).ok()?;
        let u = cable.direction;
        let (load, total) = (robot.cable_load(i, position), free[i] + routed[i]);
        // A bow gives way too.
        let along = if load.bow_n2_m > 0.0 { 1.0 / load.softness_m_n(*tension_n, total / ea) } else { ea / total };
        sum += u * u.transpose() * along + cable.curvature() * *tension_n;
    }
    sum.iter().all(|entry| entry.is_finite()).then_some(sum)
}
