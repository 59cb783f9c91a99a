//! Newton's iteration for the position with given lengths, with the second derivatives of the lengths.
//!
//! With the Jacobian J and the differences e of the lengths, a step solves H d = g with H = Jᵀ J and g = Jᵀ e. The
//! gradient at its end follows from the second derivatives, and a second solution with the same H removes it: where
//! lengths fit, convergence is cubic. From the position of the last cycle, two evaluations suffice. H does not depend
//! on the lengths, so a processor inverts it while it still computes the angles on the wheels.
//!
//! Along a straight way of s, H and what the differences of the lengths add to it fall by at most K s on average, with
//! K = 2 Σ 1 / t and the free lengths t: the mean of 1 / (t - s) over a way is at most 2 / t up to s = 0.79 t, and the
//! bound of s below is smaller. The second derivative of half the sum of the squares is H + Σ e C, with the curvatures
//! C of at most 1 / t. So within R = (λ - Σ |e| / t) / K of the position, with the smallest eigenvalue λ of H there,
//! the sum of the squares rises, and no other position fits better than its surroundings. A starting point within R / 2
//! is nearer to this position than to any other. Close to the axis of a wheel the lengths bend more; a node has to stay
//! away from there (`pulley`).

mod equations;
mod square;

use equations::{Equations, sum};
use nalgebra::Vector3;
use square::Square;
use wide::f64x2;

use crate::Anchors;
use crate::linalg::cofactors;
use crate::pulley::Both;

/// Bound of the iteration, which needs two or three evaluations; more are left to damped steps.
const MAX_EVALUATIONS: usize = 4;

/// The iteration ends if the next step would be smaller, m.
const NEXT_STEP_M: f64 = 1e-13;

/// Determinant of H below which the pose is too near a singular one for plain steps: with three cables the sine of the
/// angle between the plane of the anchors and the cables is about 1 / 100.
const LEAST_DETERMINANT: f64 = 1e-4;

/// A position to which the iteration converged.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    pub position: Vector3<f64>,
    /// Sum of the squared differences of the lengths, m².
    pub cost: f64,
    /// Every other position is farther from this one, m.
    pub alone_m: f64,
}

/// Computes the position of a robot in space with these lengths, one for each of its cables, from a starting point.
/// None if the iteration does not converge quickly.
pub(super) fn newton(anchors: &Anchors, lengths_m: &[f64], start: &Vector3<f64>) -> Option<Found> {
    if let [a, b, c] = *lengths_m {
        return iterate(start, |x| Square::at(anchors, &[a, b, c], x));
    }
    // Most other robots have four cables.
    if lengths_m.len() <= 4 { least::<2>(anchors, lengths_m, start) } else { least::<4>(anchors, lengths_m, start) }
}

fn least<const PAIRS: usize>(anchors: &Anchors, lengths_m: &[f64], start: &Vector3<f64>) -> Option<Found> {
    let given: [Given; PAIRS] = std::array::from_fn(|k| Given::of(lengths_m, 2 * k));
    iterate(start, |x| Differences::at(anchors, &given, x))
}

/// Computes the position near a hint; None unless it is certain that no other position is nearer to the hint.
pub(super) fn near(anchors: &Anchors, lengths_m: &[f64], hint: &Vector3<f64>) -> Option<Found> {
    let found = newton(anchors, lengths_m, hint)?;
    ((found.position - hint).norm_squared() <= 0.25 * found.alone_m * found.alone_m).then_some(found)
}

#[inline(always)]
fn iterate<E: Equations>(start: &Vector3<f64>, at: impl Fn(&Vector3<f64>) -> Option<E>) -> Option<Found> {
    let mut x = *start;
    let mut before_m = f64::INFINITY;
    for _ in 0..MAX_EVALUATIONS {
        let at = at(&x)?;
        let step = at.step();
        let (eigenvalue, curved, change_per_m, step_m) =
            (at.least_eigenvalue(), at.curved(), at.change_per_m(), step.norm());
        let alone_m = (eigenvalue - curved).max(0.0) / change_per_m;
        if step_m * (step_m * change_per_m + curved) <= NEXT_STEP_M * eigenvalue {
            return Some(Found { position: x - step, cost: at.cost_after(&step), alone_m });
        }
        let (correction, cost) = at.correction(&step);
        let both = step + correction;
        x -= both;
        let size_m = both.norm();
        // With cubic convergence the next step is C size³, and C = size / before³. Where lengths do not fit, each of
        // the two solutions also leaves a share of the step.
        let share = curved / eigenvalue;
        let next_m = size_m * (size_m * size_m * size_m / (before_m * before_m * before_m) + share * share);
        if before_m.is_finite() && next_m <= NEXT_STEP_M {
            return Some(Found { position: x, cost, alone_m });
        }
        // Also true for NaN.
        if !(size_m <= 0.25 * before_m) {
            return None;
        }
        before_m = size_m;
    }
    None
}

/// Upper triangle of a symmetric matrix: xx, xy, xz, yy, yz, zz.
type Symmetric = [f64; 6];

/// The given lengths of two cables; unused lanes count nothing.
#[derive(Clone, Copy)]
struct Given {
    length: f64x2,
    /// 1, or 0 in an unused lane.
    counts: f64x2,
}

impl Given {
    #[inline(always)]
    fn of(lengths_m: &[f64], from: usize) -> Self {
        let lane = |i: usize| lengths_m.get(i).map_or([0.0; 2], |length_m| [*length_m, 1.0]);
        let [a, b] = [lane(from), lane(from + 1)];
        Self { length: f64x2::new([a[0], b[0]]), counts: f64x2::new([a[1], b[1]]) }
    }
}

/// Differences of the lengths at a position, two cables at a time.
struct Differences<const PAIRS: usize> {
    cables: [Both; PAIRS],
    /// Length at the position less the given one, m.
    off: [f64x2; PAIRS],
    counts: [f64x2; PAIRS],
    /// Half of the derivative of `cost`, m.
    gradient: Vector3<f64>,
    inverse: Inverse,
    /// Sum of the squared differences, m².
    cost: f64,
    curved: f64,
    change_per_m: f64,
}

impl<const PAIRS: usize> Differences<PAIRS> {
    #[inline(always)]
    fn at(anchors: &Anchors, given: &[Given; PAIRS], x: &Vector3<f64>) -> Option<Self> {
        let mut gradient = [f64x2::ZERO; 3];
        let mut hessian = [f64x2::ZERO; 6];
        let [mut cost, mut curved, mut change] = [f64x2::ZERO; 3];
        let (mut cables, mut off) = ([Both::NONE; PAIRS], [f64x2::ZERO; PAIRS]);
        for (k, Given { length, counts }) in given.iter().enumerate() {
            let both = anchors.both_cables(k, x)?;
            let Both { direction: u, per_free, bend, .. } = both;
            let [cx, cy, cz] = u.map(|u| u * *counts);
            for (hessian, square) in
                hessian.iter_mut().zip([cx * u[0], cx * u[1], cx * u[2], cy * u[1], cy * u[2], cz * u[2]])
            {
                *hessian += square;
            }
            let steepest = (per_free + bend.abs()) * *counts;
            change += steepest;
            let off_m = (both.length - *length) * *counts;
            for (gradient, u) in gradient.iter_mut().zip(u) {
                *gradient += u * off_m;
            }
            cost += off_m * off_m;
            curved += off_m.abs() * steepest;
            (cables[k], off[k]) = (both, off_m);
        }
        Some(Self {
            cables,
            off,
            counts: given.map(|given| given.counts),
            gradient: Vector3::from(gradient.map(sum)),
            inverse: Inverse::of(&hessian.map(sum))?,
            cost: sum(cost),
            curved: sum(curved),
            change_per_m: 2.0 * sum(change),
        })
    }
}

impl<const PAIRS: usize> Equations for Differences<PAIRS> {
    #[inline(always)]
    fn step(&self) -> Vector3<f64> {
        self.inverse.times(&self.gradient)
    }

    #[inline(always)]
    fn correction(&self, step: &Vector3<f64>) -> (Vector3<f64>, f64) {
        let [x, y, z] = [step.x, step.y, step.z].map(f64x2::splat);
        let square = f64x2::splat(step.norm_squared());
        let (mut gradient, mut cost) = ([f64x2::ZERO; 3], f64x2::ZERO);
        for ((both, off), counts) in self.cables.iter().zip(self.off).zip(self.counts) {
            let Both { direction: [ux, uy, uz], per_free, bend, across: [ax, ay], .. } = *both;
            let along = (ux * x + uy * y) + uz * z;
            let across = ax * x + ay * y;
            let aside = across * bend;
            let bow = (square - along * along) * per_free + aside * across;
            let off = ((off - along) + bow * f64x2::splat(0.5)) * counts;
            let turned = [
                (ux - (x - ux * along) * per_free) - ax * aside,
                (uy - (y - uy * along) * per_free) - ay * aside,
                uz - (z - uz * along) * per_free,
            ];
            for (gradient, u) in gradient.iter_mut().zip(turned) {
                *gradient += u * off;
            }
            cost += off * off;
        }
        (self.inverse.times(&Vector3::from(gradient.map(sum))), sum(cost))
    }

    fn cost_after(&self, step: &Vector3<f64>) -> f64 {
        (self.cost - self.gradient.dot(step)).max(0.0)
    }

    fn least_eigenvalue(&self) -> f64 {
        self.inverse.least_eigenvalue
    }

    fn curved(&self) -> f64 {
        self.curved
    }

    fn change_per_m(&self) -> f64 {
        self.change_per_m
    }
}

/// Inverse of a symmetric positive definite matrix.
struct Inverse {
    inverse: Symmetric,
    /// Lower bound of the smallest eigenvalue: the product of the two others is at most the square of half the trace.
    least_eigenvalue: f64,
}

impl Inverse {
    /// None if the determinant is too small, negative or NaN.
    #[inline(always)]
    fn of(m: &Symmetric) -> Option<Self> {
        let [xx, _, _, yy, _, zz] = *m;
        let (cofactors, determinant) = cofactors(m);
        let (trace, least_minor) = (xx + yy + zz, cofactors[0].min(cofactors[3]).min(cofactors[5]));
        if !(determinant >= LEAST_DETERMINANT && least_minor > 0.0 && trace > 0.0) {
            return None;
        }
        let per_determinant = 1.0 / determinant;
        let least_eigenvalue = 4.0 * determinant / (trace * trace);
        Some(Self { inverse: cofactors.map(|c| c * per_determinant), least_eigenvalue })
    }

    #[inline(always)]
    fn times(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.inverse;
        Vector3::new(xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z, xz * v.x + yz * v.y + zz * v.z)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{descend, inverse_kinematics, least_squares, pulleys};
    use super::*;
    use proptest::prelude::*;

    fn robots() -> impl Strategy<Value = Anchors> {
        let corner = ([-0.6..0.6f64, -0.6..0.6f64, 2.5..4.0f64], prop_oneof![1 => Just(0.0), 3 => 0.01..0.1f64]);
        (proptest::collection::vec(corner, 3..=8), 0..3_usize).prop_map(|(corners, kind)| {
            let turn = 2.0 * std::f64::consts::PI / corners.len() as f64;
            let point = |(i, (off, _)): (usize, &([f64; 3], f64))| {
                let angle = turn * i as f64;
                [6.0 * libm::cos(angle) + off[0], 6.0 * libm::sin(angle) + off[1], off[2]]
            };
            let points: Vec<_> = corners.iter().enumerate().map(point).collect();
            // Only eyes, only pulleys, and both.
            let radius = |(_, radius_m): &([f64; 3], f64)| [0.0, radius_m.max(0.01), *radius_m][kind];
            let radii_m: Vec<_> = corners.iter().map(radius).collect();
            Anchors::new(&points).unwrap().with_pulleys(&radii_m).unwrap()
        })
    }

    fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        [-size..size, -size..size, -size..size].prop_map(Vector3::from)
    }

    proptest! {
        /// The solution from the intersections of spheres is the oracle.
        #[test]
        fn a_position_near_a_hint_is_that_of_the_general_solution(
            anchors in robots(), p in vector(2.0), off in vector(0.2), share in 0.0..1.0f64,
            noise in proptest::collection::vec(-0.02..0.02f64, 8),
        ) {
            let exact = anchors.len() == 3;
            let lengths_m = inverse_kinematics(&anchors, &p).zip_map(&noise, |l, e| if exact { l } else { l + e });
            let hint = p + off * (share * share);
            let Some(found) = near(&anchors, &lengths_m, &hint) else { return Ok(()) };
            let general = if anchors.have_pulleys() {
                pulleys::forward_kinematics(&anchors, &lengths_m, Some(&hint)).unwrap()
            } else if exact {
                super::super::forward_kinematics(&anchors, &lengths_m, Some(&hint)).unwrap()
            } else {
                least_squares(&anchors, &lengths_m, Some(&hint), |start| descend(&anchors, &lengths_m, start)).unwrap()
            };
            let gradient = |x: &Vector3<f64>| {
                let mut gradient = Vector3::zeros();
                anchors.each_cable(x, |i, cable| gradient += cable.direction * (cable.length_m - lengths_m[i]));
                gradient.norm()
            };
            prop_assert!(gradient(&found.position) < 1e-12, "{found:?}");
            let rms_m = (found.cost / anchors.len() as f64).sqrt();
            // Over pulleys the general solution ends at a gradient that does not matter.
            let tolerance_m = if anchors.have_pulleys() { 1e-8 } else { 1e-9 };
            prop_assert!((found.position - general.position).norm() < tolerance_m, "{found:?} {general:?}");
            prop_assert!((rms_m - general.residual_rms_m).abs() < 1e-9, "{rms_m} {general:?}");
        }

        /// Where a control cycle needs it, the hint is used.
        #[test]
        fn the_position_of_the_last_cycle_is_near_enough(anchors in robots(), p in vector(2.0), off in vector(0.003)) {
            let p = p - Vector3::z();
            let lengths_m = inverse_kinematics(&anchors, &p);
            let found = near(&anchors, &lengths_m, &(p + off));
            prop_assert!(found.is_some_and(|found| (found.position - p).norm() < 1e-12), "{found:?}");
        }
    }

    #[test]
    fn a_hint_on_the_other_side_or_beside_the_plane_of_the_anchors_is_left_to_the_general_solution() {
        let anchors = Anchors::new(&[[0.0, 0.0, 3.0], [9.0, 0.0, 3.0], [9.0, 9.0, 3.0], [0.0, 9.0, 3.0]]).unwrap();
        let lengths_m = inverse_kinematics(&anchors, &Vector3::new(4.0, 3.0, 2.0));
        for z in [2.9, 3.0, 3.1] {
            assert!(near(&anchors, &lengths_m, &Vector3::new(4.0, 3.0, z)).is_none(), "{z}");
        }
        assert!(near(&anchors, &lengths_m, &Vector3::repeat(f64::NAN)).is_none());
    }
}
