//! Whether the preload of a floating node is more than what the uncertainty of its robot file makes of it.
//!
//! Cables that only pull against each other are tensioned by their lengths, and a stiff cable turns an error of
//! millimetres into newtons. An error counts by how much it differs from the one where the lengths were set, as in
//! `cable_robot::model_error`: of an anchor by the angle by which its cable has turned since, of a scale by the cable
//! that has passed, of the pulleys' radius by the change of the arc. Friction and poles are not in it.

use crate::finding::{Finding, note, warning};
use cable_robot::elastic::{self, Realisation};
use cable_robot::{CableVec, Distribution, Robot, Vector3};
use command::points;

/// Change of a length with which its effect on the tensions is computed, m: a tenth of a newton on stiff cables.
const STEP_M: f64 = 1e-4;
/// Share of the expected tension below which motor-io takes a cable for slack or broken: `LACKING_SHARE` in its
/// `load.rs` is the missing share.
const SLACK_SHARE: f64 = 0.6;
/// Standard deviations to either side of the chosen tension that are stated.
const SIGMAS: f64 = 2.0;

/// The node at rest at a position.
struct Pose {
    at: Vector3<f64>,
    held: Realisation,
    directions: Vec<Vector3<f64>>,
    /// Derivative of each length with respect to the radius of its pulley.
    by_radius: CableVec,
}

/// The tension of a cable that may be too small by the largest share.
#[derive(Debug, Clone, Copy)]
struct Preload {
    /// Number of the cable, from 1.
    cable: usize,
    at: Vector3<f64>,
    chosen_n: f64,
    /// Standard deviation, N.
    sigma_n: f64,
}

impl Pose {
    /// `None` where the cables cannot hold the node.
    fn new(robot: &Robot, at: Vector3<f64>, distribution: Distribution) -> Option<Self> {
        let held = elastic::realise(robot, &at, &Vector3::zeros(), distribution).ok()?;
        let wider_m = robot.anchors().lengths_with_wider_m(&at, STEP_M);
        let by_radius = wider_m.zip_map(&held.lengths_m, |wider_m, length_m| (wider_m - length_m) / STEP_M);
        let directions = robot.anchors().pulleys().map(|pulley| Some(pulley.cable_to(&at).ok()?.direction));
        Some(Self { at, held, directions: directions.collect::<Option<_>>()?, by_radius })
    }

    /// Returns the change of every tension per change of the length of a cable, N/m.
    fn by_length(&self, robot: &Robot, cable: usize) -> Option<CableVec> {
        let mut lengths_m = self.held.unstretched_m;
        lengths_m[cable] += STEP_M;
        let changed = elastic::equilibrium(robot, &lengths_m, &Vector3::zeros(), Some(&self.at)).ok()?;
        Some(changed.tensions_n.zip_map(&self.held.tensions_n, |then_n, now_n| (then_n - now_n) / STEP_M))
    }

    /// Returns the tension that may be too small by the largest share, if the lengths were set at another pose.
    fn weakest(&self, robot: &Robot, zero: &Self) -> Option<Preload> {
        let count = robot.cable_count();
        let stated = robot.uncertainty();
        let by_length = (0..count).map(|cable| self.by_length(robot, cable)).collect::<Option<Vec<_>>>()?;
        let (mut own, mut radius, mut warm) = (CableVec::zeros(count), CableVec::zeros(count), CableVec::zeros(count));
        for (i, effect) in by_length.iter().enumerate() {
            let turned_m = stated.anchors_m * (self.directions[i] - zero.directions[i]).norm();
            let passed_m = stated.cable_scale * (self.held.lengths_m[i] - zero.held.lengths_m[i]);
            let arc_m = stated.pulley_radius_m * (self.by_radius[i] - zero.by_radius[i]);
            let warm_m = stated.expansion * (self.held.lengths_m[i] + robot.routed_length_m()[i]);
            for (cable, by_length) in effect.iter().enumerate() {
                own[cable] += by_length * by_length * (turned_m * turned_m + passed_m * passed_m);
                radius[cable] += by_length * arc_m;
                warm[cable] += by_length * warm_m;
            }
        }
        let of = |cable: usize| Preload {
            cable: cable + 1,
            at: self.at,
            chosen_n: self.held.tensions_n[cable],
            sigma_n: (own[cable] + radius[cable] * radius[cable] + warm[cable] * warm[cable]).sqrt(),
        };
        (0..count).map(of).max_by(|one, other| one.share().total_cmp(&other.share()))
    }
}

impl Preload {
    /// Returns the share of the tension that may be missing.
    fn share(&self) -> f64 {
        SIGMAS * self.sigma_n / self.chosen_n
    }
}

/// States how far the tensions of a floating node may be from the chosen ones, with the lengths set in the middle and
/// the node halfway from there to each anchor. None for a node with weight, which tensions its cables itself, and for
/// rigid cables, whose tensions the model does not have.
pub(crate) fn finding(robot: &Robot, middle: &Vector3<f64>, distribution: Distribution) -> Option<Finding> {
    if robot.net_weight_n() != 0.0 || robot.stiffness_n().is_none() {
        return None;
    }
    let zero = Pose::new(robot, *middle, distribution)?;
    let halfway = robot.anchors().iter().map(|anchor| 0.5 * (middle + anchor));
    let poses = halfway.filter_map(|at| Pose::new(robot, at, distribution)?.weakest(robot, &zero));
    let weakest = poses.max_by(|one, other| one.share().total_cmp(&other.share()))?;
    let Preload { cable, at, chosen_n, sigma_n } = weakest;
    let sentence = format!(
        "with the lengths set in the middle and the node at {}, cable {cable} has the chosen {chosen_n:.1} N within {:.1} N \
         by [uncertainty] (two standard deviations)",
        points::in_words(robot, &at),
        SIGMAS * sigma_n
    );
    if weakest.share() <= 1.0 - SLACK_SHARE {
        return Some(note(sentence));
    }
    let least_n = SLACK_SHARE * chosen_n;
    Some(warning(
        format!("{sentence}, and below {least_n:.1} N motor-io takes a cable for slack and stops"),
        "raise the least tension in tension_limits_n, state `pulley` and its radius, calibrate the anchors, or use softer \
         cables; missions near the place where the lengths were set are not affected",
    ))
}
