//! Distances of the node and the cables from obstacles and keep-out boxes, with the weight of the cables and the stated
//! uncertainty of the position. Lengths in m, tensions in N.
//!
//! A cable is every curve between the straight line from its eye or pulley to the node and its parabola when it is wet
//! ([`sag::WET`]). It is exempt only near its pulley, which a trunk may carry: its first metre may be
//! closer to a body than the margin, but must not approach it.

use nalgebra::Vector3;

use crate::obstacle::{Contact, Obstacle};
use crate::{CableVec, Distribution, Matrix3, NodeJacobian, Robot, sag, tension};

/// Standard deviations within which 95 % of a normal error of three dimensions lie: the root of the 95 % quantile of
/// chi squared with three degrees of freedom.
const SIGMAS_95: f64 = 2.795;
/// Largest bound that is computed, m: where the lengths do not determine the position.
const MOST_M: f64 = 10.0;
/// Halvings of a distance within a margin.
const HALVINGS: u32 = 26;
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
    /// Half-width of the 95 % interval of a position that the lengths determine, m, by the covariance of the anchors
    /// in the calibration; 0 if the robot file has none. It is an upper bound: the larger of the variances is bounded
    /// by the sum of a row.
    pub fn position_bound_m(&self, position: &Vector3<f64>) -> f64 {
        if self.anchor_covariance_m2(0, 0).is_none() {
            return 0.0;
        }
        let Ok(inverse) = NodeJacobian::at(self.anchors(), position) else { return MOST_M };
        let mut covariance = Matrix3::zeros();
        let unit = |cable: usize| self.anchors().pulley(cable).direction(position).unwrap_or_else(|_| Vector3::zeros());
        for (i, column_i) in inverse.iter().enumerate() {
            for (j, column_j) in inverse.iter().enumerate() {
                let Some(between) = self.anchor_covariance_m2(i, j) else { return MOST_M };
                covariance += column_i * column_j.transpose() * unit(i).dot(&(between * unit(j)));
            }
        }
        bound_95_m(&covariance)
    }

    /// Least distances from an obstacle with the node at a position: the clearance and the bound of the position; for a
    /// cable the bound of its anchor, if that is larger.
    fn margins(&self, position: &Vector3<f64>) -> Margins {
        let node_m = self.position_bound_m(position);
        let anchor_m = |cable| self.anchor_covariance_m2(cable, cable).map_or(0.0, bound_95_m);
        let clearance_m = self.clearance_m();
        Margins {
            node_m: clearance_m + node_m,
            cable_m: CableVec::from_fn(self.cable_count(), |cable| clearance_m + node_m.max(anchor_m(cable))),
        }
    }

    /// Least distance of the node from an obstacle with the node at a position, m: `clearance_m`, and the bound of the
    /// position if the calibration states one.
    pub fn obstacle_margin_m(&self, position: &Vector3<f64>) -> f64 {
        self.clearance_m() + self.position_bound_m(position)
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
        let margins = self.margins(position);
        let hit = |obstacle, cable| Some(Contact { obstacle, cable });
        let node_hits = |obstacle: &Obstacle| obstacle.is_near(before, position, margins.node_m);
        if let Some(number) = self.obstacles().position(node_hits) {
            return hit(number, None);
        }
        let tensions_n = if self.cable_weight_n_m() == 0.0 {
            None
        } else {
            tension::at(self, position, &Vector3::zeros(), distribution).ok().map(|held| held.tensions_n)
        };
        let way_m = (position - before).norm();
        for (cable, margin_m) in margins.cable_m.iter().enumerate() {
            let hanging = self.hanging(cable, position, tensions_n.as_ref().map(|tensions_n| tensions_n[cable]));
            let blocked = |obstacle: &Obstacle| hanging.is_blocked(obstacle, margin_m + way_m);
            if let Some(number) = self.obstacles().position(blocked) {
                return hit(number, Some(cable));
            }
        }
        None
    }

    /// Finds a body that the node, moved from `from` to `to`, or a cable would come closer to than its margin and
    /// `more_m`, and closer than at `from`: what leads away from a body, or along it, is free. The margin of a keep-out
    /// box is that of the node from an obstacle. `tensions_n` are those of the cables. Works without allocation.
    pub fn approached(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        more_m: f64,
        tensions_n: &[f64],
    ) -> Option<Border> {
        let closer = |from_m: f64, to_m: f64, margin_m: f64| to_m < margin_m && to_m < from_m - ROUNDING_M;
        if !self.keep_out().is_empty() {
            let margin_m = self.obstacle_margin_m(to) + more_m;
            if let Some(number) =
                self.keep_out().iter().position(|b| closer(b.distance_m(from), b.distance_m(to), margin_m))
            {
                return Some(Border::KeepOut(number));
            }
        }
        self.obstacles().next()?;
        let margins = self.margins(to);
        let node_m = margins.node_m + more_m;
        let approaches = |body: &Obstacle| closer(body.distance_m(from), body.distance_m(to), node_m);
        if let Some(obstacle) = self.obstacles().position(approaches) {
            return Some(Border::Obstacle(Contact { obstacle, cable: None }));
        }
        for (cable, margin_m) in margins.cable_m.iter().enumerate() {
            let tension_n = tensions_n.get(cable).copied();
            let margin_m = margin_m + more_m;
            let after = self.hanging(cable, to, tension_n);
            let before = self.hanging(cable, from, tension_n);
            for (obstacle, body) in self.obstacles().enumerate() {
                if after.is_blocked(body, margin_m)
                    && closer(before.distance_m(body, margin_m), after.distance_m(body, margin_m), margin_m)
                {
                    return Some(Border::Obstacle(Contact { obstacle, cable: Some(cable) }));
                }
            }
        }
        None
    }

    /// The cable with the node at a position; without a tension it hangs as under the lowest one.
    fn hanging(&self, cable: usize, position: &Vector3<f64>, tension_n: Option<f64>) -> Hanging {
        let pulley = self.anchors().pulley(cable);
        let start = pulley.cable_to(position).map_or(pulley.anchor, |free| position - free.direction * free.free_m);
        let [least_n, _] = self.tension_limits_n();
        let tension_n = tension_n.unwrap_or(least_n).max(least_n);
        let sag_m = sag::WET * sag::sag_m(self.cable_weight_n_m(), (position - start).norm(), tension_n);
        Hanging { start, end: *position, sag_m }
    }
}

/// A cable from its eye or pulley to the node, with the largest sag in its middle.
struct Hanging {
    start: Vector3<f64>,
    end: Vector3<f64>,
    sag_m: f64,
}

impl Hanging {
    fn is_blocked(&self, body: &Obstacle, margin_m: f64) -> bool {
        body.blocks_cable(&self.start, &self.end, margin_m, self.sag_m)
    }

    /// Largest margin with which the body does not block the cable, at most `most_m`; 0 if it always does.
    fn distance_m(&self, body: &Obstacle, most_m: f64) -> f64 {
        if !self.is_blocked(body, most_m) {
            return most_m;
        }
        let (mut free_m, mut blocked_m) = (0.0, most_m);
        for _ in 0..HALVINGS {
            let middle_m = 0.5 * (free_m + blocked_m);
            if self.is_blocked(body, middle_m) { blocked_m = middle_m } else { free_m = middle_m }
        }
        free_m
    }
}

/// Half-width of the 95 % interval in the worst direction, m, or more.
fn bound_95_m(covariance_m2: &Matrix3<f64>) -> f64 {
    let row = |i: usize| covariance_m2.row(i).iter().map(|x| x.abs()).sum::<f64>();
    let variance_m2 = row(0).max(row(1)).max(row(2)).min(covariance_m2.trace());
    (SIGMAS_95 * variance_m2.max(0.0).sqrt()).min(MOST_M)
}
