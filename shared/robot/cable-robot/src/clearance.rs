//! Distances of the node and the cables from obstacles and keep-out boxes, with the weight of the cables and the
//! covariance of the anchors that a calibration states. Lengths in m, tensions in N.
//!
//! To `clearance_m` are added 95 % bounds: of the position that the lengths determine, by the covariance of the anchors
//! in a calibration and by [`crate::Uncertainty`] ([`crate::model_error`]), and for a cable that of its anchor, if that
//! is larger. Errors count from where the lengths were set ([`Robot::with_lengths_set_at`]), and whole if that is
//! unknown. The swing of the node, wind and warming beyond [`crate::Uncertainty`] are not added; `clearance_m` has to
//! contain them.
//!
//! A cable is every curve between the straight line from its eye or pulley to the node and its parabola when it is wet
//! ([`sag::WET`]). It is exempt only near its pulley, which a trunk may carry: its first metre may be
//! closer to a body than the margin, but must not approach it.

use nalgebra::Vector3;

use crate::obstacle::{Contact, Obstacle};
use crate::{CableVec, Distribution, Matrix3, NodeJacobian, Robot, Uncertainty, sag, tension};

/// Standard deviations within which 95 % of a normal error of three dimensions lie: the root of the 95 % quantile of
/// chi squared with three degrees of freedom.
const SIGMAS_95: f64 = 2.795;
/// Largest bound that is computed, m: where the lengths do not determine the position.
const MOST_M: f64 = 10.0;
/// Halvings of a distance within a margin: to [`ROUNDING_M`] within [`MOST_M`].
const HALVINGS: u32 = 24;
/// Sags that are compared, as shares of that of a wet cable: the wet cable, the dry one, the straight line.
const SAG_SHARES: [f64; 3] = [1.0, 1.0 / sag::WET, 0.0];
/// Most comparisons of a cable with a body, for a jog: one of the margin, then three, a distance and one, per sag.
#[cfg(test)]
const MOST_COMPARED: u32 = 1 + SAG_SHARES.len() as u32 * (HALVINGS + 4);
/// Change of a distance that counts as rounding, m.
const ROUNDING_M: f64 = 1e-6;

/// A body at whose border the node comes to rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Border {
    /// A keep-out box, by its index from 0.
    KeepOut(usize),
    /// An obstacle, and what comes near to it.
    Obstacle(Contact),
}

/// Least distances from an obstacle, m.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Margins {
    node_m: f64,
    cable_m: CableVec,
}

impl Robot {
    /// Half-width of the 95 % interval of a position that the lengths determine, m, under these tensions of the cables,
    /// N, by the covariance of the calibration and by what the robot file states of its uncertainty. It
    /// is an upper bound: the larger of the variances is bounded by the sum of a row.
    pub fn position_bound_m(&self, position: &Vector3<f64>, tensions_n: &CableVec) -> f64 {
        let calibrated = self.calibrated().is_some();
        let uncertainty = self.uncertainty();
        if !calibrated && *uncertainty == Uncertainty::default() {
            return 0.0;
        }
        let Ok(inverse) = NodeJacobian::at(self.anchors(), position) else { return MOST_M };
        let errors = uncertainty.length_errors_at(self, position, tensions_n);
        let covariance = uncertainty.covariance_of(self, &errors, &inverse, self.errors_at_zero());
        bound_95_m(&covariance)
    }

    /// Least distances from an obstacle with the node at a position: the clearance and the bound of the position; for a
    /// cable the bound of its anchor, if that is larger.
    fn margins(&self, position: &Vector3<f64>, tensions_n: &CableVec) -> Margins {
        let node_m = self.position_bound_m(position, tensions_n);
        let stated_m = SIGMAS_95 * self.uncertainty().anchors_m;
        let anchor_m = |cable| self.anchor_covariance_m2(cable).map_or(stated_m, bound_95_m);
        let clearance_m = self.clearance_m();
        Margins {
            node_m: clearance_m + node_m,
            cable_m: CableVec::from_fn(self.cable_count(), |cable| clearance_m + node_m.max(anchor_m(cable))),
        }
    }

    /// Least distance of the node from an obstacle with the node at rest at a position, m: `clearance_m` and the bound
    /// of the position.
    pub fn obstacle_margin_m(&self, position: &Vector3<f64>, distribution: Distribution) -> f64 {
        self.clearance_m() + self.position_bound_m(position, &self.at_rest_n(position, distribution))
    }

    /// Tensions at rest, N; the least ones where the node cannot hang.
    fn at_rest_n(&self, position: &Vector3<f64>, distribution: Distribution) -> CableVec {
        let [least_n, _] = self.tension_limits_n();
        match tension::at(self, position, &Vector3::zeros(), distribution) {
            Ok(held) => held.tensions_n.map(|t| t.max(least_n)),
            Err(_) => CableVec::repeat(self.cable_count(), least_n),
        }
    }

    /// Finds the first contact of the node or a cable with an obstacle, on the way of the node from `before` to
    /// `position`, m. In a short way every point of a cable moves by at most the way of the node, by which the margin
    /// grows. Cables with weight sag under the tensions at rest of this distribution.
    pub fn contact(
        &self,
        before: &Vector3<f64>,
        position: &Vector3<f64>,
        distribution: Distribution,
    ) -> Option<Contact> {
        self.obstacles().next()?;
        let tensions_n = self.at_rest_n(position, distribution);
        let margins = self.margins(position, &tensions_n);
        let hit = |obstacle, cable| Some(Contact { obstacle, cable });
        let node_hits = |obstacle: &Obstacle| obstacle.is_near(before, position, margins.node_m);
        if let Some(number) = self.obstacles().position(node_hits) {
            return hit(number, None);
        }
        let way_m = (position - before).norm();
        for (cable, margin_m) in margins.cable_m.iter().enumerate() {
            let hanging = self.hanging(cable, position, tensions_n[cable]);
            let blocked = |obstacle: &Obstacle| hanging.is_blocked(obstacle, margin_m + way_m);
            if let Some(number) = self.obstacles().position(blocked) {
                return hit(number, Some(cable));
            }
        }
        None
    }

    /// Finds a body that the node, moved from `from` to `to`, or a cable would come closer to than its margin and
    /// `more_m`, and closer than at `from`: what leads away from a body, or along it, is free. The margin of a keep-out
    /// box is that of the node from an obstacle.
    ///
    /// The wet cable, the dry one and the straight line are compared each with itself, so that a dry cable that still
    /// hangs clear is not moved into a body that the wet one would touch already. Works without allocation.
    pub fn approached(&self, from: &Held<'_>, to: &Held<'_>, more_m: f64) -> Option<Border> {
        let (from_m, to_m) = (&from.position_m, &to.position_m);
        let to_n = CableVec::from_fn(self.cable_count(), |i| to.tensions_n.get(i).copied().unwrap_or(0.0));
        let closer = |from_m: f64, to_m: f64, margin_m: f64| to_m < margin_m && to_m < from_m - ROUNDING_M;
        if !self.keep_out().is_empty() {
            let margin_m = self.clearance_m() + self.position_bound_m(to_m, &to_n) + more_m;
            if let Some(number) =
                self.keep_out().iter().position(|b| closer(b.distance_m(from_m), b.distance_m(to_m), margin_m))
            {
                return Some(Border::KeepOut(number));
            }
        }
        self.obstacles().next()?;
        let margins = self.margins(to_m, &to_n);
        let node_m = margins.node_m + more_m;
        let approaches = |body: &Obstacle| closer(body.distance_m(from_m), body.distance_m(to_m), node_m);
        if let Some(obstacle) = self.obstacles().position(approaches) {
            return Some(Border::Obstacle(Contact { obstacle, cable: None }));
        }
        for (cable, margin_m) in margins.cable_m.iter().enumerate() {
            let tension_n = |held: &Held<'_>| held.tensions_n.get(cable).copied().unwrap_or(0.0);
            let before = self.hanging(cable, from_m, tension_n(from));
            let after = self.hanging(cable, to_m, tension_n(to));
            let nears = |body: &Obstacle| after.comes_closer(&before, body, margin_m + more_m);
            if let Some(obstacle) = self.obstacles().position(nears) {
                return Some(Border::Obstacle(Contact { obstacle, cable: Some(cable) }));
            }
        }
        None
    }

    /// The cable with the node at a position under a tension, with the sag of a wet one.
    fn hanging(&self, cable: usize, position: &Vector3<f64>, tension_n: f64) -> Hanging {
        let pulley = self.anchors().pulley(cable);
        let start = pulley.cable_to(position).map_or(pulley.anchor, |free| position - free.direction * free.free_m);
        let sag_m = sag::WET * sag::sag_m(self.cable_weight_n_m(), (position - start).norm(), tension_n.max(0.0));
        Hanging { start, end: *position, sag_m }
    }
}

/// A position of the node, m, and the tensions of the cables there, N.
#[derive(Debug, Clone, Copy)]
pub struct Held<'a> {
    /// Position of the node, m.
    pub position_m: Vector3<f64>,
    /// Tension per cable, N.
    pub tensions_n: &'a [f64],
}

/// A cable from its eye or pulley to the node, with the largest sag in its middle.
struct Hanging {
    start: Vector3<f64>,
    end: Vector3<f64>,
    sag_m: f64,
}

impl Hanging {
    fn is_blocked(&self, body: &Obstacle, margin_m: f64) -> bool {
        #[cfg(test)]
        tests::COMPARED.with(|compared| compared.set(compared.get() + 1));
        body.blocks_cable(&self.start, &self.end, margin_m, self.sag_m)
    }

    /// The same cable with a share of its sag.
    fn with_sag(&self, share: f64) -> Self {
        Self { sag_m: share * self.sag_m, ..*self }
    }

    /// Whether the wet, the dry or the straight cable is closer to the body than the margin, and closer than it was
    /// before. Most bodies take one comparison, none more than `MOST_COMPARED`.
    fn comes_closer(&self, before: &Self, body: &Obstacle, margin_m: f64) -> bool {
        // The others hang within the wet one.
        if !self.is_blocked(body, margin_m) {
            return false;
        }
        let shares: &[f64] = if self.sag_m == 0.0 && before.sag_m == 0.0 { &[1.0] } else { &SAG_SHARES };
        shares.iter().any(|share| self.with_sag(*share).is_closer(&before.with_sag(*share), body, margin_m))
    }

    fn is_closer(&self, before: &Self, body: &Obstacle, margin_m: f64) -> bool {
        if !self.is_blocked(body, margin_m) {
            return false;
        }
        if !before.is_blocked(body, margin_m) {
            return true;
        }
        let after_m = self.distance_m(body, margin_m);
        after_m + ROUNDING_M < margin_m && !before.is_blocked(body, after_m + ROUNDING_M)
    }

    /// Largest margin with which the body does not block the cable, m, if `blocked_m` does; 0 if it always does.
    fn distance_m(&self, body: &Obstacle, mut blocked_m: f64) -> f64 {
        let mut free_m = 0.0;
        if self.is_blocked(body, free_m) {
            return free_m;
        }
        for _ in 0..HALVINGS {
            let middle_m = 0.5 * (free_m + blocked_m);
            if self.is_blocked(body, middle_m) { blocked_m = middle_m } else { free_m = middle_m }
        }
        free_m
    }
}

/// Half-width of the 95 % interval in the worst direction, m, or more; the largest bound for a covariance that is not a
/// number, which no maximum may hide.
fn bound_95_m(covariance_m2: &Matrix3<f64>) -> f64 {
    if covariance_m2.iter().any(|entry| entry.is_nan()) {
        return MOST_M;
    }
    let row = |i: usize| covariance_m2.row(i).iter().map(|x| x.abs()).sum::<f64>();
    let variance_m2 = row(0).max(row(1)).max(row(2)).min(covariance_m2.trace());
    (SIGMAS_95 * variance_m2.max(0.0).sqrt()).min(MOST_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RobotParts;
    use proptest::prelude::*;
    use std::cell::Cell;

    thread_local! {
        /// Comparisons of a cable with a body in this thread.
        pub(super) static COMPARED: Cell<u32> = const { Cell::new(0) };
    }

    /// Spans of 40 m with a cable of 60 g/m, which sags by decimetres.
    fn heavy(obstacles: Vec<Obstacle>) -> Robot {
        Robot::new(RobotParts {
            anchors_m: vec![[0.0, 0.0, 12.0], [40.0, 0.0, 12.0], [20.0, 35.0, 12.0]],
            node_mass_kg: 3.0,
            tension_limits_n: [10.0, 200.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            stiffness_n: Some(20_000.0),
            cable_mass_kg_m: 0.06,
            obstacles,
            clearance_m: 0.1,
            ..RobotParts::default()
        })
        .unwrap()
    }

    /// Least distance of a cable from a body, from its first metre on, by its points.
    fn parabola_m(body: &Obstacle, cable: &Hanging) -> f64 {
        let chord_m = (cable.end - cable.start).norm();
        (0..=4000)
            .map(|k| f64::from(k) / 4000.0)
            .filter(|u| u * chord_m > 1.0)
            .map(|u| {
                let depth_m = 4.0 * cable.sag_m * u * (1.0 - u);
                body.distance_m(&(cable.start + (cable.end - cable.start) * u - Vector3::new(0.0, 0.0, depth_m)))
            })
            .fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, cases: 4000, ..ProptestConfig::default() })]

        /// The top of a trunk stands between the wet cable and the dry one, within the margin of the dry one, and low
        /// enough that the slope of the cable does not touch its rim.
        #[test]
        fn a_dry_cable_is_checked_where_the_wet_one_touches(
            x in 12.0..28.0f64, y in 6.0..16.0f64, z in 5.0..9.0f64,
            at in 0.3..0.8f64, below_m in 0.035..0.09f64, lower_m in 0.02..0.2f64,
        ) {
            let bare = heavy(Vec::new());
            let from_m = Vector3::new(x, y, z);
            let tensions_n = [40.0; 3];
            let wet = bare.hanging(0, &from_m, 40.0);
            let chord = wet.start + (from_m - wet.start) * at;
            let depth_m = |share: f64| 4.0 * share * wet.sag_m * at * (1.0 - at);
            let top_m = chord.z - depth_m(1.0 / sag::WET) - below_m;
            let body = Obstacle::cylinder([chord.x, chord.y], 0.05, [-20.0, top_m]).unwrap();
            let robot = heavy(vec![body]);
            prop_assert!(wet.is_blocked(&body, 0.0));
            prop_assert!(!wet.with_sag(1.0 / sag::WET).is_blocked(&body, 0.0));
            let held = |down_m: f64| Held { position_m: from_m - Vector3::new(0.0, 0.0, down_m), tensions_n: &tensions_n };
            let border = Border::Obstacle(Contact { obstacle: 0, cable: Some(0) });
            prop_assert_eq!(robot.approached(&held(0.0), &held(lower_m), 0.0), Some(border));
            prop_assert_eq!(robot.approached(&held(lower_m), &held(0.0), 0.0), None);
        }

        /// Whatever the node's way and tensions: a dry cable that comes closer than the margin by its points, and was
        /// not so close before, is at a border, also if the node does not move and only its cable is loosened.
        #[test]
        fn what_comes_closer_by_its_points_is_a_border(
            x in 12.0..28.0f64, y in 6.0..16.0f64, z in 5.0..9.0f64,
            way in prop_oneof![Just([0.0; 3]), [-0.1..0.1f64, -0.1..0.1f64, -0.1..0.1f64]],
            before_n in 20.0..80.0f64, loosened in 0.05..1.0f64,
            at in 0.2..0.9f64, above_m in -0.05..0.09f64,
        ) {
            let bare = heavy(Vec::new());
            let from_m = Vector3::new(x, y, z);
            let to_m = from_m + Vector3::from(way);
            let (before_n, after_n) = ([before_n; 3], [loosened * before_n; 3]);
            let dry = |position_m, tension_n| bare.hanging(0, position_m, tension_n).with_sag(1.0 / sag::WET);
            let (before, after) = (dry(&from_m, before_n[0]), dry(&to_m, after_n[0]));
            let low = after.end * at + after.start * (1.0 - at);
            let top_m = low.z - 4.0 * after.sag_m * at * (1.0 - at) - above_m;
            let body = Obstacle::cylinder([low.x, low.y], 0.05, [-20.0, top_m]).unwrap();
            prop_assume!(parabola_m(&body, &after) < 0.1 && !before.is_blocked(&body, 0.1));
            let border = heavy(vec![body]).approached(
                &Held { position_m: from_m, tensions_n: &before_n },
                &Held { position_m: to_m, tensions_n: &after_n },
                0.0,
            );
            prop_assert!(border.is_some());
        }
    }

    #[test]
    fn what_is_not_a_number_has_the_largest_bound() {
        let known_m2 = Matrix3::identity() * 1e-4;
        assert!((bound_95_m(&known_m2) - SIGMAS_95 * 0.01).abs() < 1e-12);
        assert_eq!(bound_95_m(&(known_m2 * f64::INFINITY)), MOST_M);
        for at in 0..9 {
            let mut wrong_m2 = known_m2;
            wrong_m2[at] = f64::NAN;
            assert_eq!(bound_95_m(&wrong_m2), MOST_M, "{at}");
        }
        assert_eq!(bound_95_m(&Matrix3::repeat(f64::NAN)), MOST_M);
    }

    /// Eight cables and sixteen bodies, all of which are closer to every cable than the margin.
    #[test]
    fn the_comparisons_of_a_jog_are_bounded() {
        let rim = |k: u32| f64::from(k) * std::f64::consts::TAU / 8.0;
        let anchors_m =
            (0..8).map(|k| [20.0 * rim(k).cos(), 20.0 * rim(k).sin(), 12.0 - 0.1 * f64::from(k)]).collect::<Vec<_>>();
        let disc = |k: u32| {
            let (turn, away_m) = (rim(k), if k < 8 { 6.0 } else { 12.0 });
            Obstacle::cylinder([away_m * turn.cos(), away_m * turn.sin()], 0.3, [-2.0, 0.5]).unwrap()
        };
        let parts = |clearance_m: f64| RobotParts {
            anchors_m: Vec::clone(&anchors_m),
            node_mass_kg: 3.0,
            tension_limits_n: [10.0, 200.0],
            speed_limit_m_s: 0.4,
            acceleration_limit_m_s2: 0.5,
            cable_mass_kg_m: 0.06,
            obstacles: (0..16).map(disc).collect(),
            clearance_m,
            ..RobotParts::default()
        };
        // Every body is closer to every cable than this.
        let robot = Robot::new(parts(30.0)).unwrap();
        let tensions_n = [60.0; 8];
        let held = |z: f64| Held { position_m: Vector3::new(0.0, 0.0, z), tensions_n: &tensions_n };
        let compared = |from: f64, to: f64| {
            COMPARED.set(0);
            (robot.approached(&held(from), &held(to), 0.0), COMPARED.get())
        };
        // Up, away from all of them.
        let (free, all) = compared(6.0, 6.05);
        assert_eq!(free, None);
        assert!(all > 8 * 16 && all <= 8 * 16 * MOST_COMPARED, "{all} comparisons");
        let (down, fewer) = compared(6.0, 5.95);
        assert!(down.is_some() && fewer < all, "{fewer} comparisons");
        // With a margin that nothing is within, each takes one.
        let far = Robot::new(parts(0.1)).unwrap();
        COMPARED.set(0);
        assert_eq!(far.approached(&held(10.0), &held(9.95), 0.0), None);
        assert_eq!(COMPARED.get(), 8 * 16);
    }
}
