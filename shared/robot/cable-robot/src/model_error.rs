//! How wrong the position of an elastic equilibrium may be, because the robot is not its model.
//!
//! Each source has one standard deviation in [`Uncertainty`]. Its effect is the error of the cables' lengths that it
//! makes at a pose, and the sensitivity of the equilibrium turns lengths into positions. Lengths were set where the
//! node was known to be, so an error counts by how much it differs from the one that it made there: a wrong scale
//! counts by the cable that has passed since, and a wrong anchor by the angle by which its cable has turned since. What
//! a calibration was uncertain about counts in the same way, with all its correlations.
//!
//! To first order; independent sources. Wind, slack cables and what the operator stated wrongly are not in it.

use nalgebra::{Matrix3, Vector3};

use crate::calibrated::{LengthGradient, RADIUS, SCALE};
use crate::elastic::Equilibrium;
use crate::modes::{stiffness_at_n_m, stiffness_n_m};
use crate::uncertainty::{COMMON, LengthErrors};
use crate::{CableVec, MAX_CABLES, NodeJacobian, Robot, Uncertainty, linalg, tension};

/// Change of a pulley's radius with which the effect of its error is computed, m.
const RADIUS_STEP_M: f64 = 1e-4;

/// The errors at an unknown place, for any number of cables.
static UNKNOWN: LengthErrors = LengthErrors::none(MAX_CABLES);

impl Uncertainty {
    /// Computes the errors of the lengths at an equilibrium; zero for a cable without a direction there.
    #[inline]
    pub fn length_errors(&self, robot: &Robot, at: &Equilibrium) -> LengthErrors {
        self.errors_with(robot, &at.position, &at.tensions_n, stiffness_at_n_m(robot, at))
    }

    /// The same with the node at a position, m, under these tensions, N.
    pub fn length_errors_at(&self, robot: &Robot, position: &Vector3<f64>, tensions_n: &CableVec) -> LengthErrors {
        self.errors_with(robot, position, tensions_n, stiffness_n_m(robot, position, tensions_n))
    }

    #[inline]
    fn errors_with(
        &self,
        robot: &Robot,
        position: &Vector3<f64>,
        tensions_n: &CableVec,
        stiffness_n_m: Option<Matrix3<f64>>,
    ) -> LengthErrors {
        let count = robot.cable_count();
        let mut errors = LengthErrors::none(count);
        let yields_m = weight_shift_m(robot, stiffness_n_m);
        let wider_m = robot.anchors().lengths_with_wider_m(position, RADIUS_STEP_M);
        for i in 0..count {
            let pulley = robot.anchors().pulley(i);
            let Ok(cable) = pulley.cable_to(position) else { continue };
            let (tension_n, total_m) = (tensions_n[i], cable.length_m + robot.routed_length_m()[i]);
            let strain = robot.stiffness_n().map_or(0.0, |ea| tension_n / ea);
            let level_sq = cable.direction.x * cable.direction.x + cable.direction.y * cable.direction.y;
            errors.directions[i] = cable.direction;
            errors.lengths_m[i] = cable.length_m;
            let by_radius = (wider_m[i] - cable.length_m) / RADIUS_STEP_M;
            errors.by_radius[i] = if by_radius.is_finite() { by_radius } else { 0.0 };
            errors.common_m[0][i] = self.stiffness * strain * total_m;
            errors.common_m[1][i] = self.node_weight * cable.direction.dot(&yields_m);
            errors.common_m[2][i] = self.expansion * total_m;
            errors.pole_m[i] = self.pole_m_n * tension_n * level_sq;
            errors.friction_m[i] = self.pulley_friction * strain * robot.routed_length_m()[i];
        }
        errors
    }

    /// Covariance of the position of an equilibrium, m², with that of the robot's calibration. `zero`: the errors where
    /// the lengths were set; `None` if that is unknown, so that every error counts whole.
    pub fn covariance_m2(&self, robot: &Robot, at: &Equilibrium, zero: Option<&LengthErrors>) -> Matrix3<f64> {
        self.covariance_of(robot, &self.length_errors(robot, at), &at.sensitivity, zero)
    }

    /// The same for errors at a position with this sensitivity to the lengths.
    #[inline]
    pub fn covariance_of(
        &self,
        robot: &Robot,
        errors: &LengthErrors,
        sensitivity: &NodeJacobian,
        zero: Option<&LengthErrors>,
    ) -> Matrix3<f64> {
        let zero = zero.filter(|zero| zero.count == errors.count).unwrap_or(&UNKNOWN);
        let mut sum = Matrix3::zeros();
        for (source, (here_m, there_m)) in errors.common_m.iter().zip(&zero.common_m).enumerate() {
            let mut shift_m = Vector3::zeros();
            for (i, column) in sensitivity.iter().enumerate() {
                // What happened since the lengths were set was not there.
                let there_m = if source == COMMON - 1 { 0.0 } else { there_m[i] };
                shift_m += column * (here_m[i] - there_m);
            }
            sum += linalg::outer(&shift_m, &shift_m);
        }
        sum += geometry_m2(robot, errors, sensitivity, zero);
        let stated = self.not_calibrated(robot);
        let mut by_radius_m = Vector3::zeros();
        let square = |x: f64| x * x;
        for (i, column) in sensitivity.iter().enumerate() {
            by_radius_m += column * (stated.pulley_radius_m * (errors.by_radius[i] - zero.by_radius[i]));
            let variance_m2 = square(stated.anchors_m) * (errors.directions[i] - zero.directions[i]).norm_squared()
                + square(stated.cable_scale * (errors.lengths_m[i] - zero.lengths_m[i]))
                + square(errors.pole_m[i] - zero.pole_m[i])
                + square(errors.friction_m[i])
                + square(zero.friction_m[i]);
            sum += linalg::outer(column, column) * variance_m2;
        }
        sum + linalg::outer(&by_radius_m, &by_radius_m)
    }

    /// The same without what the calibration of the robot covers: its anchors, and of the scales and the radii those
    /// that it has a variance for.
    fn not_calibrated(&self, robot: &Robot) -> Self {
        let mut stated = *self;
        if let Some(calibrated) = robot.calibrated() {
            stated.anchors_m = 0.0;
            if calibrated.variance(0, SCALE) > 0.0 {
                stated.cable_scale = 0.0;
            }
            if calibrated.variance(0, RADIUS) > 0.0 {
                stated.pulley_radius_m = 0.0;
            }
        }
        stated
    }
}

/// Covariance of the position by that of the calibration, m². What the lengths depend on is wrong by the same at the
/// place where they were set, so only the difference counts. The rotation of elastic cables with their anchors is
/// neglected: a few percent of the standard deviation, a sixth close below the anchors. A calibration that states its
/// anchors alone counts whole: how its anchors and the points where the cables are tied are wrong together is unknown
/// then.
fn geometry_m2(robot: &Robot, errors: &LengthErrors, sensitivity: &NodeJacobian, zero: &LengthErrors) -> Matrix3<f64> {
    let mut sum = Matrix3::zeros();
    let Some(calibrated) = robot.calibrated() else { return sum };
    let zero = if calibrated.anchors_alone { &UNKNOWN } else { zero };
    let by = |i: usize| {
        let turned = zero.directions[i] - errors.directions[i];
        let (paid_m, by_radius) = (errors.lengths_m[i] - zero.lengths_m[i], errors.by_radius[i] - zero.by_radius[i]);
        LengthGradient::new(turned.x, turned.y, turned.z, paid_m, by_radius)
    };
    for (i, column_i) in sensitivity.iter().enumerate() {
        for (j, column_j) in sensitivity.iter().enumerate() {
            sum += linalg::outer(column_i, column_j) * calibrated.between((i, &by(i)), (j, &by(j)));
        }
    }
    sum
}

impl Robot {
    /// The same robot, whose lengths were set with the node at rest at this position, m; `None`: it is unknown where,
    /// so that every error counts whole in the margins of obstacles. It stays unknown where the node cannot hang.
    #[must_use]
    pub fn with_lengths_set_at(&self, position: Option<&Vector3<f64>>) -> Self {
        let errors = position.and_then(|position| {
            let held = tension::at(self, position, &Vector3::zeros(), self.default_distribution()).ok()?;
            Some(self.uncertainty().length_errors_at(self, position, &held.tensions_n))
        });
        self.with_errors_at_zero(errors)
    }
}

/// Displacement of the node by its own weight while the drums stand still, m.
fn weight_shift_m(robot: &Robot, stiffness_n_m: Option<Matrix3<f64>>) -> Vector3<f64> {
    let softness = stiffness_n_m.and_then(|stiffness| stiffness.try_inverse());
    softness.map_or_else(Vector3::zeros, |softness| softness * Vector3::new(0.0, 0.0, robot.net_weight_n()))
}
