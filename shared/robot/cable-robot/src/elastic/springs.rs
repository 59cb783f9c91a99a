//! Cables without weight as springs, two at a time: what they pull at a position, and how the position follows them.

use nalgebra::{Matrix3, Vector3};
use wide::f64x2;

use crate::linalg::SymmetricInverse;
use crate::pulley::Both;
use crate::{Anchors, CableVec, MAX_CABLES, Robot};

/// The potential of all cables and the node at a position, with its derivatives.
pub(super) struct Balance {
    /// Gradient of the potential: minus the force out of balance, N.
    pub gradient: Vector3<f64>,
    pub hessian: Matrix3<f64>,
    pub potential: f64,
}

/// Two cables. An unused lane is as if its cable was endlessly long: slack.
#[derive(Debug, Clone, Copy)]
struct Springs {
    unstretched_m: f64x2,
    /// 1 / (l + Lx), 1/m.
    per_total: f64x2,
    /// EA / (l + Lx), N/m.
    stiffness: f64x2,
}

/// The springs of all cables of a robot.
#[derive(Debug, Clone, Copy)]
pub(super) struct AllSprings([Springs; MAX_CABLES / 2]);

/// What one position makes of two cables; zero where they are slack.
struct Pull {
    /// Extension, m.
    stretch: f64x2,
    tension: f64x2,
    stiffness: f64x2,
}

impl AllSprings {
    /// Cables with these measured lengths, m, one for each of the robot, and this stiffness, N.
    pub(super) fn new(robot: &Robot, unstretched_m: &[f64], stiffness_n: f64) -> Self {
        let routed_m = robot.routed_length_m();
        let lane = |i: usize| match (unstretched_m.get(i), routed_m.get(i)) {
            (Some(length_m), Some(routed_m)) => [*length_m, length_m + routed_m],
            _ => [f64::INFINITY, f64::INFINITY],
        };
        Self(std::array::from_fn(|k| {
            let [a, b] = [lane(2 * k), lane(2 * k + 1)];
            let per_total = f64x2::splat(1.0) / f64x2::new([a[1], b[1]]);
            let stiffness = f64x2::splat(stiffness_n) * per_total;
            Springs { unstretched_m: f64x2::new([a[0], b[0]]), per_total, stiffness }
        }))
    }

    /// Least stiffness of a cable, N/m.
    pub(super) fn softest(&self, cables: usize) -> f64 {
        let each = self.0.iter().flat_map(|springs| springs.stiffness.to_array());
        each.take(cables).fold(f64::INFINITY, f64::min)
    }

    /// Adds the pulls of the cables at a position. Where a cable has no direction, everything is NaN.
    pub(super) fn add(&self, balance: &mut Balance, anchors: &Anchors, x: &Vector3<f64>) {
        // Most robots have three or four cables.
        if anchors.len() <= 4 {
            self.add_pairs::<2>(balance, anchors, x)
        } else {
            self.add_pairs::<4>(balance, anchors, x)
        }
    }

    #[inline(always)]
    fn add_pairs<const PAIRS: usize>(&self, balance: &mut Balance, anchors: &Anchors, x: &Vector3<f64>) {
        let (mut gradient, mut hessian) = ([f64x2::ZERO; 3], [f64x2::ZERO; 6]);
        let mut twice_potential = f64x2::ZERO;
        for (k, springs) in self.0[..PAIRS].iter().enumerate() {
            let Some((both, pull)) = springs.pull(anchors, k, x) else { continue };
            let Both { direction: [ux, uy, uz], per_free, bend, across: [ax, ay], .. } = both;
            twice_potential += pull.tension * pull.stretch;
            for (gradient, u) in gradient.iter_mut().zip([ux, uy, uz]) {
                *gradient += u * pull.tension;
            }
            let (across, bend) = (pull.tension * per_free, pull.tension * bend);
            let along = pull.stiffness - across;
            let [sx, sy, bx] = [ux * along, uy * along, ax * bend];
            let turned = [
                (sx * ux + across) + bx * ax,
                sx * uy + bx * ay,
                sx * uz,
                (sy * uy + across) + (ay * bend) * ay,
                sy * uz,
                (uz * along) * uz + across,
            ];
            for (hessian, part) in hessian.iter_mut().zip(turned) {
                *hessian += part;
            }
        }
        let [xx, xy, xz, yy, yz, zz] = hessian.map(sum);
        balance.hessian += Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        balance.gradient += Vector3::from(gradient.map(sum));
        balance.potential += 0.5 * sum(twice_potential);
    }

    /// Lengths and tensions at a position, and how the position follows the measured lengths.
    pub(super) fn describe(&self, anchors: &Anchors, x: &Vector3<f64>, hessian: &Matrix3<f64>) -> Described {
        let inverse = SymmetricInverse::of(hessian).map_or([0.0; 6], |inverse| inverse.entries).map(f64x2::splat);
        let n = anchors.len();
        let (mut lengths, mut tensions) = ([[0.0; 2]; MAX_CABLES / 2], [[0.0; 2]; MAX_CABLES / 2]);
        let mut columns = [Vector3::zeros(); MAX_CABLES];
        for (k, springs) in self.0.iter().enumerate().take(n.div_ceil(2)) {
            let Some((both, pull)) = springs.pull(anchors, k, x) else { continue };
            (lengths[k], tensions[k]) = (both.length.to_array(), pull.tension.to_array());
            // H dX = u (-dT/dl) dl, with dT/dl = -EA (L + Lx) / (l + Lx)².
            let force = pull.stiffness * (f64x2::splat(1.0) + pull.stretch * springs.per_total);
            let [ux, uy, uz] = both.direction.map(|u| u * force);
            let [xx, xy, xz, yy, yz, zz] = inverse;
            let moved = [ux * xx + uy * xy + uz * xz, ux * xy + uy * yy + uz * yz, ux * xz + uy * yz + uz * zz];
            let [x, y, z] = moved.map(f64x2::to_array);
            for (lane, column) in columns.iter_mut().skip(2 * k).take(2_usize.min(n - 2 * k)).enumerate() {
                *column = Vector3::new(x[lane], y[lane], z[lane]);
            }
        }
        let [lengths_m, tensions_n] = [lengths, tensions].map(|pairs| CableVec::from_pairs(n, pairs.into_iter()));
        Described { lengths_m, tensions_n, columns }
    }
}

/// The state of all cables at a position.
pub(super) struct Described {
    pub lengths_m: CableVec,
    /// 0 for a slack cable, N.
    pub tensions_n: CableVec,
    /// Derivatives of the position with respect to each length; zero for a slack cable.
    pub columns: [Vector3<f64>; MAX_CABLES],
}

impl Springs {
    /// The pair of cables with this number at a position, with directions only where they pull.
    #[inline(always)]
    fn pull(&self, anchors: &Anchors, k: usize, x: &Vector3<f64>) -> Option<(Both, Pull)> {
        let both = anchors.both_cables(k, x)?;
        let stretch = both.length - self.unstretched_m;
        // False for NaN, which no step may hide.
        let slack = stretch.simd_le(f64x2::ZERO);
        let taut = |value: f64x2| slack.bitselect(f64x2::ZERO, value);
        let both = Both {
            direction: both.direction.map(taut),
            per_free: taut(both.per_free),
            bend: taut(both.bend),
            across: both.across.map(taut),
            ..both
        };
        let stretch = taut(stretch);
        let stiffness = taut(self.stiffness);
        Some((both, Pull { stretch, tension: stiffness * stretch, stiffness }))
    }
}

/// Sum of the two lanes.
#[inline(always)]
fn sum(lanes: f64x2) -> f64 {
    let [a, b] = lanes.to_array();
    a + b
}
