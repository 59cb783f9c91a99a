//! Paths that swing sideways as well as down, beyond section VIII of the paper.
//!
//! With a gear that locks itself, paying line out is almost free and reeling in is dear. A path that sags and swings lets
//! lines change more of their length by paying out; with ideal motors it gains next to nothing. The shape is a [`Bow`]: three
//! harmonics down and three to the side, found by a search along the coordinates that starts from the best parabola and from
//! swings to both sides of it, because the cost has several minima.
//!
//! # Example
//! ```
//! use cable_robot::{Distribution, Vector3, energy::{Bounds, WinchEnergy}, motor::Motor};
//! let anchors = [[0.0, 0.0, 3.2], [9.8, 0.0, 3.45], [4.4, 8.0, 3.05]].map(Vector3::from);
//! let motor = Motor::default(); // nearly locks itself
//! let winch_energy = WinchEnergy {
//!     anchors: &anchors,
//!     planar: false,
//!     wrench_n: Vector3::new(0.0, 0.0, 19.62),
//!     drag_n_s2_m2: 0.0,
//!     limits_n: [1.0, 150.0],
//!     method: Distribution::Unique,
//!     current: &motor,
//! };
//! let (from, to) = (Vector3::new(3.3, 1.6, 2.45), Vector3::new(6.6, 1.9, 2.35));
//! let found = winch_energy.best_lateral(&from, &to, 0.2, 32, &Bounds { ground_m: Some(0.0), time_weight_w: 0.0 })?;
//! let (bow, cost) = found.lateral.expect("such a path costs less than the best parabola here");
//! assert!(cost.energy_j < found.parabola.cost.energy_j && bow.side_m != [0.0; 3]);
//! # Ok::<(), cable_robot::energy::EnergyError>(())
//! ```

use nalgebra::Vector3;

use super::optimum::{Precision, SCAN_INTERVALS};
use super::parabola::FractionPoint;
use super::winch_energy::{check_intervals, check_speed};
use super::{Best, Bounds, Cost, EnergyError, WinchEnergy, parabola};
use crate::path::{Bow, HARMONICS};

/// Six amplitudes: three down, three to the side.
const COUNT: usize = 2 * HARMONICS;

/// Swings that the search starts from, in lengths of the move; the cost has a minimum on either side.
const SWINGS: [f64; 4] = [-0.3, -0.1, 0.1, 0.3];

/// First step of the search, and the last with a coarse and with a fine cost, in lengths of the move: where the cost is flat
/// enough that a smaller step changes it by less than the cost is known.
const STEPS: [f64; 3] = [0.04, 0.004, 0.0004];

/// Most rounds over all amplitudes.
const ROUNDS: usize = 120;

/// What must be saved against the best parabola, as a share: less is not worth a path that is harder to foresee.
const WORTHWHILE: f64 = 1e-3;

/// The best path that may swing sideways.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BestLateral {
    /// Its shape and its cost; None where none costs clearly less than the best parabola.
    pub lateral: Option<(Bow, Cost)>,
    /// The best parabola.
    pub parabola: Best,
    /// The best shape without any swing: what richer paths in the vertical plane come to, as a cost without the weight of time.
    pub upright: Cost,
}

impl BestLateral {
    /// Where nothing can swing: straight up and down, and in a plane.
    pub(super) fn none_beside(parabola: Best) -> Self {
        Self { lateral: None, parabola, upright: parabola.cost }
    }
}

impl WinchEnergy<'_> {
    /// Cost of a bow at constant speed, quasi-static, as [`WinchEnergy::constant_speed`] has that of a parabola.
    pub fn bow_at_constant_speed(&self, bow: &Bow, speed_m_s: f64, intervals: usize) -> Result<Cost, EnergyError> {
        check_speed(speed_m_s)?;
        check_intervals(intervals)?;
        parabola::check(&crate::path::Parabola { from: bow.from, to: bow.to, mu_per_m: 0.0 })?;
        self.integrate_bow(bow, speed_m_s, intervals)
    }

    pub(super) fn integrate_bow(&self, bow: &Bow, speed_m_s: f64, intervals: usize) -> Result<Cost, EnergyError> {
        let at = |u| {
            let point = bow.at_fraction(u);
            FractionPoint { position: point.position, tangent: point.first }
        };
        self.integrate_by(at, bow.length_m(), speed_m_s, intervals)
    }

    /// The path between two points, of three harmonics down and three to the side, that costs least at constant speed: I²R
    /// loss plus the weight of time.
    ///
    /// Fails like [`WinchEnergy::best_parabola`], which it starts from.
    pub fn best_lateral(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        speed_m_s: f64,
        intervals: usize,
        bounds: &Bounds,
    ) -> Result<BestLateral, EnergyError> {
        let found = self.best_parabola(from, to, speed_m_s, intervals, bounds)?;
        if self.planar {
            return Ok(BestLateral::none_beside(found));
        }
        Ok(best(from, to, bounds, found, |bow, precision| {
            let coarse = SCAN_INTERVALS.min(intervals);
            let intervals = if precision == Precision::Coarse { coarse } else { intervals };
            above_ground(bow, bounds, intervals)?;
            self.integrate_bow(bow, speed_m_s, intervals)
        }))
    }
}

/// Refuses a bow that goes below the ground, between its points as far as its curvature lets it.
pub(super) fn above_ground(bow: &Bow, bounds: &Bounds, intervals: usize) -> Result<(), EnergyError> {
    let Some(ground_m) = bounds.ground_m else { return Ok(()) };
    let step = 1.0 / intervals as f64;
    let spare_m = bow.sagitta_m(step);
    for i in 1..intervals {
        let height_m = bow.at_fraction(i as f64 * step).position.z;
        if !(height_m - spare_m >= ground_m) {
            return Err(EnergyError::BelowGround { height_m, ground_m });
        }
    }
    Ok(())
}

/// The best bow between two points by any reckoning of a path's cost, given the best parabola; a cost that fails counts as
/// infinite. Straight up and down there is none.
pub fn best(
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    bounds: &Bounds,
    parabola: Best,
    mut cost: impl FnMut(&Bow, Precision) -> Result<Cost, EnergyError>,
) -> BestLateral {
    let none = BestLateral::none_beside(parabola);
    let line = crate::path::Parabola { from: *from, to: *to, mu_per_m: 0.0 };
    if parabola::is_vertical(&line) {
        return none;
    }
    let priced = |cost: &Cost| cost.energy_j + bounds.time_weight_w * cost.duration_s;
    let mut objective = |at: &[f64; COUNT], precision| {
        cost(&bow(from, to, at), precision).map_or(f64::INFINITY, |found| priced(&found))
    };
    let length_m = (to - from).norm();
    let sag_m = 0.25 * parabola.mu_per_m * line.extent() * line.extent();
    let [first, coarse, fine] = STEPS.map(|step| step * length_m);
    let mut candidates = [[0.0; COUNT]; 2 + SWINGS.len()];
    // The whole sag may touch the ground, where a sum of harmonics dips below it.
    for (candidate, share) in candidates.iter_mut().zip([1.0, 0.8]) {
        *candidate =
            search(|at| objective(at, Precision::Coarse), &like_a_parabola(share * sag_m), HARMONICS, first, coarse);
    }
    let by_cost = |a: &(f64, [f64; COUNT]), b: &(f64, [f64; COUNT])| a.0.total_cmp(&b.0);
    let least = |of: &[[f64; COUNT]], objective: &mut dyn FnMut(&[f64; COUNT]) -> f64| {
        of.iter().map(|at| (objective(at), *at)).min_by(by_cost).map_or([0.0; COUNT], |(_, at)| at)
    };
    let start = least(&candidates[..2], &mut |at| objective(at, Precision::Coarse));
    let upright = search(|at| objective(at, Precision::Fine), &start, HARMONICS, coarse, fine);
    for (candidate, swing) in candidates[2..].iter_mut().zip(SWINGS) {
        let mut swung = like_a_parabola(0.8 * sag_m);
        swung[HARMONICS] = swing * length_m;
        *candidate = search(|at| objective(at, Precision::Coarse), &swung, COUNT, first, coarse);
    }
    candidates[0] = search(|at| objective(at, Precision::Coarse), &upright, COUNT, first, coarse);
    let start = least(&candidates, &mut |at| objective(at, Precision::Coarse));
    let found = search(|at| objective(at, Precision::Fine), &start, COUNT, coarse, fine);
    let fine_cost = |at: &[f64; COUNT], cost: &mut dyn FnMut(&Bow, Precision) -> Result<Cost, EnergyError>| {
        let bow = bow(from, to, at);
        cost(&bow, Precision::Fine).ok().map(|cost| (bow, cost))
    };
    let upright = match fine_cost(&upright, &mut cost) {
        Some((_, upright)) if priced(&upright) < priced(&parabola.cost) => upright,
        _ => parabola.cost,
    };
    let worthwhile = |(_, cost): &(Bow, Cost)| priced(cost) < (1.0 - WORTHWHILE) * priced(&parabola.cost);
    BestLateral { lateral: fine_cost(&found, &mut cost).filter(worthwhile), parabola, upright }
}

fn bow(from: &Vector3<f64>, to: &Vector3<f64>, at: &[f64; COUNT]) -> Bow {
    let [d1, d2, d3, s1, s2, s3] = *at;
    Bow { from: *from, to: *to, down_m: [d1, d2, d3], side_m: [s1, s2, s3] }
}

/// The harmonics of the parabola that sags by this much in its middle, m: 4u(1-u) = 32/π³ (sin πu + sin 3πu / 27 + ..).
fn like_a_parabola(sag_m: f64) -> [f64; COUNT] {
    let first = sag_m * 32.0 / std::f64::consts::PI.powi(3);
    [first, 0.0, first / 27.0, 0.0, 0.0, 0.0]
}

/// The least of a function of the first `count` amplitudes: a step along each in turn, its length growing with success and
/// shrinking without, until all are below `last`.
fn search(
    mut objective: impl FnMut(&[f64; COUNT]) -> f64,
    start: &[f64; COUNT],
    count: usize,
    first: f64,
    last: f64,
) -> [f64; COUNT] {
    let mut at = *start;
    let mut here = objective(&at);
    let mut steps = [first; COUNT];
    for _ in 0..ROUNDS {
        for k in 0..count {
            let moved = [1.0, -1.0].into_iter().any(|direction| {
                let mut next = at;
                next[k] += direction * steps[k];
                let found = objective(&next);
                let better = found < here;
                if better {
                    (at, here) = (next, found);
                }
                better
            });
            steps[k] *= if moved { 1.3 } else { 0.6 };
        }
        if steps[..count].iter().all(|step| *step < last) {
            break;
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_search_finds_a_minimum_off_the_axes() {
        let cost = |at: &[f64; COUNT]| {
            let [x, y, ..] = *at;
            if x > 3.0 { f64::INFINITY } else { (x - 1.0) * (x - 1.0) + (y - 0.7) * (y - 0.7) + x * y }
        };
        let found = search(cost, &[2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2, 0.2, 1e-4);
        // Where the gradient vanishes: 2(x-1)+y = 0, 2(y-0.7)+x = 0.
        assert!((found[0] - 2.6 / 3.0).abs() < 5e-3 && (found[1] - 0.8 / 3.0).abs() < 5e-3, "{found:?}");
    }

    #[test]
    fn three_harmonics_are_nearly_the_parabola() {
        let (from, to) = (Vector3::new(0.0, 0.0, 2.0), Vector3::new(4.0, 0.0, 2.0));
        let bow = bow(&from, &to, &like_a_parabola(1.0));
        for i in 0..=20 {
            let u = f64::from(i) / 20.0;
            assert!((bow.at_fraction(u).position.z - (2.0 - 4.0 * u * (1.0 - u))).abs() < 0.02, "{u}");
        }
    }
}
