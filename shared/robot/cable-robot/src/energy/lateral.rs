//! Paths that swing sideways as well as down, an extension of section VIII of the paper.
//!
//! With a self-locking gear, paying out cable costs almost nothing and reeling in is expensive. A path that sags and
//! swings lets cables do more of their length change by paying out; with ideal motors the gain is negligible. The shape
//! is a [`Bow`]: three vertical and three sideways harmonics. Because the cost has several minima, a coordinate search
//! starts from the best parabola and from swings to both sides of it.
//!
//! # Example
//! ```
//! use cable_robot::{Anchors, Distribution, Vector3, energy::{Bounds, WinchEnergy}, motor::Motor};
//! let anchors = Anchors::new(&[[0.0, 0.0, 3.2], [9.8, 0.0, 3.45], [4.4, 8.0, 3.05]])?;
//! let motor = Motor::default(); // nearly locks itself
//! let winch_energy = WinchEnergy {
//!     anchors: &anchors,
//!     wrench_n: Vector3::new(0.0, 0.0, 19.62),
//!     drag_n_s2_m2: 0.0,
//!     cable_weight_n_m: 0.0,
//!     limits_n: [1.0, 150.0],
//!     method: Distribution::Unique,
//!     current: &motor,
//! };
//! let (from, to) = (Vector3::new(3.3, 1.6, 2.45), Vector3::new(6.6, 1.9, 2.35));
//! let found = winch_energy.best_lateral(&from, &to, 0.2, 32, &Bounds { ground_m: Some(0.0), time_weight_w: 0.0 })?;
//! let (bow, cost) = found.lateral.expect("such a path costs less than the best parabola here");
//! assert!(cost.energy_j < found.parabola.cost.energy_j && bow.side_m != [0.0; 3]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use nalgebra::Vector3;

use super::optimum::{Precision, SCAN_INTERVALS};
use super::parabola::FractionPoint;
use super::winch_energy::{check_intervals, check_speed};
use super::{Best, Bounds, Cost, EnergyError, WinchEnergy, parabola};
use crate::path::{Bow, HARMONICS};

/// Number of amplitudes: three down, three to the side.
const COUNT: usize = 2 * HARMONICS;

/// Starting swings of the search, in lengths of the move; the cost has a minimum on each side.
const SWINGS: [f64; 4] = [-0.3, -0.1, 0.1, 0.3];

/// First step of the search, and last steps with the coarse and the fine cost, in lengths of the move. Smaller steps
/// change the cost by less than its own error.
const STEPS: [f64; 3] = [0.04, 0.004, 0.0004];

/// Largest number of rounds over all amplitudes.
const MAX_ROUNDS: usize = 120;

/// Smallest relative saving over the best parabola; less does not justify a path that is harder to predict.
const LEAST_SAVING: f64 = 1e-3;

/// The best path that may swing sideways, with the best parabola for comparison.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BestLateral {
    /// Shape and cost; None if no bow costs clearly less than the best parabola.
    pub lateral: Option<(Bow, Cost)>,
    /// The best parabola.
    pub parabola: Best,
    /// Cost, without the weight of time, of the best shape without swing: the gain of richer paths in
    /// the vertical plane.
    pub upright: Cost,
}

impl BestLateral {
    /// Result for moves that cannot swing: vertical moves and planar robots.
    pub(super) fn without_bow(parabola: Best) -> Self {
        Self { lateral: None, parabola, upright: parabola.cost }
    }
}

impl WinchEnergy<'_> {
    /// Cost of a bow at constant speed, quasi-static, like [`WinchEnergy::constant_speed`] for a parabola.
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

    /// Computes the path between two points, of three vertical and three sideways harmonics, with the lowest cost at
    /// constant speed: I²R loss plus the weight of time.
    ///
    /// Fails like [`WinchEnergy::best_parabola`], from which it starts.
    pub fn best_lateral(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        speed_m_s: f64,
        intervals: usize,
        bounds: &Bounds,
    ) -> Result<BestLateral, EnergyError> {
        let found = self.best_parabola(from, to, speed_m_s, intervals, bounds)?;
        if self.anchors.is_planar() {
            return Ok(BestLateral::without_bow(found));
        }
        Ok(best(from, to, bounds, found, |bow, precision| {
            let coarse = SCAN_INTERVALS.min(intervals);
            let intervals = if precision == Precision::Coarse { coarse } else { intervals };
            check_ground(bow, bounds, intervals)?;
            self.integrate_bow(bow, speed_m_s, intervals)
        }))
    }
}

/// Rejects a bow that goes below the ground, including the bound on its sag between the sampled points.
pub(super) fn check_ground(bow: &Bow, bounds: &Bounds, intervals: usize) -> Result<(), EnergyError> {
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

/// Computes the best bow between two points for any cost function, given the best parabola; a cost that fails counts as
/// infinite. Returns no bow for a vertical move.
pub fn best(
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    bounds: &Bounds,
    parabola: Best,
    mut cost: impl FnMut(&Bow, Precision) -> Result<Cost, EnergyError>,
) -> BestLateral {
    let none = BestLateral::without_bow(parabola);
    let line = crate::path::Parabola { from: *from, to: *to, mu_per_m: 0.0 };
    if parabola::is_vertical(&line) {
        return none;
    }
    let priced = |cost: &Cost| cost.energy_j + bounds.time_weight_w * cost.duration_s;
    let mut objective = |at: &[f64; COUNT], precision| {
        cost(&bow_from_amplitudes(from, to, at), precision).map_or(f64::INFINITY, |found| priced(&found))
    };
    let length_m = (to - from).norm();
    let sag_m = 0.25 * parabola.mu_per_m * line.extent() * line.extent();
    let [first, coarse, fine] = STEPS.map(|step| step * length_m);
    let mut candidates = [[0.0; COUNT]; 2 + SWINGS.len()];
    // The full sag may touch the ground, where a sum of harmonics dips below it.
    for (candidate, share) in candidates.iter_mut().zip([1.0, 0.8]) {
        *candidate = coordinate_search(
            |at| objective(at, Precision::Coarse),
            &parabola_harmonics(share * sag_m),
            HARMONICS,
            first,
            coarse,
        );
    }
    let by_cost = |a: &(f64, [f64; COUNT]), b: &(f64, [f64; COUNT])| a.0.total_cmp(&b.0);
    let lowest = |candidates: &[[f64; COUNT]], objective: &mut dyn FnMut(&[f64; COUNT]) -> f64| {
        candidates.iter().map(|at| (objective(at), *at)).min_by(by_cost).map_or([0.0; COUNT], |(_, at)| at)
    };
    let start = lowest(&candidates[..2], &mut |at| objective(at, Precision::Coarse));
    let upright = coordinate_search(|at| objective(at, Precision::Fine), &start, HARMONICS, coarse, fine);
    for (candidate, swing) in candidates[2..].iter_mut().zip(SWINGS) {
        let mut swung = parabola_harmonics(0.8 * sag_m);
        swung[HARMONICS] = swing * length_m;
        *candidate = coordinate_search(|at| objective(at, Precision::Coarse), &swung, COUNT, first, coarse);
    }
    candidates[0] = coordinate_search(|at| objective(at, Precision::Coarse), &upright, COUNT, first, coarse);
    let start = lowest(&candidates, &mut |at| objective(at, Precision::Coarse));
    let found = coordinate_search(|at| objective(at, Precision::Fine), &start, COUNT, coarse, fine);
    let fine_cost = |at: &[f64; COUNT], cost: &mut dyn FnMut(&Bow, Precision) -> Result<Cost, EnergyError>| {
        let bow = bow_from_amplitudes(from, to, at);
        cost(&bow, Precision::Fine).ok().map(|cost| (bow, cost))
    };
    let upright = match fine_cost(&upright, &mut cost) {
        Some((_, upright)) if priced(&upright) < priced(&parabola.cost) => upright,
        _ => parabola.cost,
    };
    let worthwhile = |(_, cost): &(Bow, Cost)| priced(cost) < (1.0 - LEAST_SAVING) * priced(&parabola.cost);
    BestLateral { lateral: fine_cost(&found, &mut cost).filter(worthwhile), parabola, upright }
}

fn bow_from_amplitudes(from: &Vector3<f64>, to: &Vector3<f64>, at: &[f64; COUNT]) -> Bow {
    let [d1, d2, d3, s1, s2, s3] = *at;
    Bow { from: *from, to: *to, down_m: [d1, d2, d3], side_m: [s1, s2, s3] }
}

/// Harmonics of the parabola with this sag in its middle, m: 4u(1-u) = 32/π³ (sin πu + sin 3πu / 27 + ..).
fn parabola_harmonics(sag_m: f64) -> [f64; COUNT] {
    let first = sag_m * 32.0 / std::f64::consts::PI.powi(3);
    [first, 0.0, first / 27.0, 0.0, 0.0, 0.0]
}

/// Minimises a function of the first `count` amplitudes: steps along each in turn; the step length grows after a
/// success and shrinks otherwise, until all are below `last`.
fn coordinate_search(
    mut objective: impl FnMut(&[f64; COUNT]) -> f64,
    start: &[f64; COUNT],
    count: usize,
    first: f64,
    last: f64,
) -> [f64; COUNT] {
    let mut at = *start;
    let mut here = objective(&at);
    let mut steps = [first; COUNT];
    for _ in 0..MAX_ROUNDS {
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
        let found = coordinate_search(cost, &[2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2, 0.2, 1e-4);
        // The gradient vanishes where 2(x-1)+y = 0, 2(y-0.7)+x = 0.
        assert!((found[0] - 2.6 / 3.0).abs() < 5e-3 && (found[1] - 0.8 / 3.0).abs() < 5e-3, "{found:?}");
    }

    #[test]
    fn three_harmonics_are_nearly_the_parabola() {
        let (from, to) = (Vector3::new(0.0, 0.0, 2.0), Vector3::new(4.0, 0.0, 2.0));
        let bow = bow_from_amplitudes(&from, &to, &parabola_harmonics(1.0));
        for i in 0..=20 {
            let u = f64::from(i) / 20.0;
            assert!((bow.at_fraction(u).position.z - (2.0 - 4.0 * u * (1.0 - u))).abs() < 0.02, "{u}");
        }
    }
}
