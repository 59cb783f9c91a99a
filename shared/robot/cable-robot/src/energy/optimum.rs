//! The µ with the lowest cost, between the straight line and the ground.
//!
//! With real motors the cost has several minima and its optimum may lie where the path touches the ground. Part of the
//! range may violate the tension limits (there the cost counts as infinite, even for the straight line), and with
//! least-sum tensions the cost jumps. Therefore the whole range is scanned, with more points near the straight line,
//! and the lowest points are refined.
//!
//! µ in 1/m, costs in J and s. [`best`] fails with the straight line's reason if no parabola is possible, and with
//! `invalid_argument` if the weight of time is not valid.
//!
//! ```
//! use cable_robot::{Vector3, energy::{Bounds, Cost, optimum::best}};
//! // A cost with two low places: one at µ = 0.05, a lower one at µ = 0.3.
//! let cost = |mu: f64| 1.0 + (mu - 0.05).abs().min(0.1 + 5.0 * (mu - 0.3).abs()) - if mu > 0.25 { 0.2 } else { 0.0 };
//! let (from, to) = (Vector3::new(0.0, 0.0, 4.0), Vector3::new(5.0, 0.0, 4.0));
//! let found = best(&from, &to, &Bounds { ground_m: Some(0.0), time_weight_w: 0.0 }, |path, _| {
//!     let energy_j = cost(path.mu_per_m);
//!     Ok(Cost { energy_j, duration_s: 1.0, length_m: 5.0, peak_tension_n: 0.0, peak_current_a: 0.0, margin_n: 1.0 })
//! })?;
//! assert!((found.mu_per_m - 0.3).abs() < 1e-3);
//! # Ok::<(), cable_robot::energy::EnergyError>(())
//! ```

use nalgebra::Vector3;

use super::winch_energy::{check_intervals, check_speed};
use super::{Cost, EnergyError, WinchEnergy, parabola};
use crate::path::Parabola;

/// Number of points of the scan.
const SCAN_POINTS: usize = 80;

/// Number of low points of the scan that are refined.
const MAX_REFINED: usize = 3;

/// Intervals on each side of a low point in which the scan gets a further point.
const HALVED: usize = 2;

/// Largest number of brackets through which a minimum is followed.
const MAX_BRACKETS: usize = 10;

/// Width to which a minimum is refined, as a share of its bracket. The cost changes by about a thousandth from one
/// point of the scan to the next, so that a minimum at a jump is found to 1e-7 of the cost, and a smooth one to less.
const BRACKET_SHARE: f64 = 1e-4;

/// Largest number of refinement steps: this many golden sections reach [`BRACKET_SHARE`].
const MAX_SECTIONS: usize = 20;

/// Bisections of the edge of an infeasible interval, to a hundredth of the distance of the scan's points.
const EDGE_STEPS: usize = 7;

/// Simpson intervals in the scan, which only has to distinguish low points from high ones.
pub(super) const SCAN_INTERVALS: usize = 16;

/// Precision of a cost evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// For the scan, whose low points are evaluated again: it may leave out checks of what is possible.
    Coarse,
    /// For the refinement and the result.
    Fine,
}

/// Deepest sag without a ground limit, in lengths of the move (extent and height): a sag of ten lengths costs more than
/// twenty times the straight line.
const DEEPEST_SAG: f64 = 10.0;

/// Bounds and weights of the optimisation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Lowest height of the path, m; None for no limit.
    pub ground_m: Option<f64>,
    /// Additional cost of a second, W (J per second); 0 for least loss.
    pub time_weight_w: f64,
}

/// The best parabola.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Best {
    /// µ, 1/m; 0 for the straight line.
    pub mu_per_m: f64,
    /// Its cost, without the weight of time.
    pub cost: Cost,
    /// Cost of the straight line; None if the cables cannot hold the node on it.
    pub line: Option<Cost>,
}

impl WinchEnergy<'_> {
    /// Computes the parabola between two points with the lowest cost at constant speed: I²R loss plus
    /// the weight of time.
    ///
    /// Fails with the straight line's reason if no parabola is possible.
    pub fn best_parabola(
        &self,
        from: &Vector3<f64>,
        to: &Vector3<f64>,
        speed_m_s: f64,
        intervals: usize,
        bounds: &Bounds,
    ) -> Result<Best, EnergyError> {
        check_speed(speed_m_s)?;
        check_intervals(intervals)?;
        best(from, to, bounds, |path, precision| {
            let coarse = SCAN_INTERVALS.min(intervals);
            self.integrate(path, speed_m_s, if precision == Precision::Coarse { coarse } else { intervals })
        })
    }
}

/// Computes the parabola between two points with the lowest cost for any cost function.
pub fn best(
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    bounds: &Bounds,
    mut cost: impl FnMut(&Parabola, Precision) -> Result<Cost, EnergyError>,
) -> Result<Best, EnergyError> {
    if !(bounds.time_weight_w >= 0.0 && bounds.time_weight_w.is_finite()) {
        let (what, accepted) = ("time_weight_w", "a finite power of 0 W or more");
        return Err(EnergyError::InvalidArgument { what, value: bounds.time_weight_w, accepted });
    }
    let deepest = deepest(from, to, bounds.ground_m)?;
    let path = |mu_per_m: f64| Parabola { from: *from, to: *to, mu_per_m };
    let line = cost(&path(0.0), Precision::Fine);
    if let Err(error) = &line
        && (!error.is_of_the_path() || deepest == 0.0)
    {
        return Err(error.clone());
    }
    let mut objective = |mu: f64, precision| match cost(&path(mu), precision) {
        Ok(found) => found.energy_j + bounds.time_weight_w * found.duration_s,
        Err(_) => f64::INFINITY,
    };
    let mu = if deepest > 0.0 {
        // A narrow infeasible interval may slip through a coarse scan and then spoil every point it found.
        minimise(&mut objective, deepest, Precision::Coarse)
            .or_else(|| minimise(&mut objective, deepest, Precision::Fine))
    } else {
        Some(0.0)
    };
    match (mu, &line) {
        (Some(mu_per_m), _) => {
            let found = cost(&path(mu_per_m), Precision::Fine)?;
            let total = |cost: &Cost| cost.energy_j + bounds.time_weight_w * cost.duration_s;
            // The coarse scan may prefer a parabola that costs more than the line.
            match line {
                Ok(line) if total(&line) < total(&found) => Ok(Best { mu_per_m: 0.0, cost: line, line: Some(line) }),
                line => Ok(Best { mu_per_m, cost: found, line: line.ok() }),
            }
        }
        (None, Err(error)) => Err(error.clone()),
        (None, Ok(found)) => Ok(Best { mu_per_m: 0.0, cost: *found, line: Some(*found) }),
    }
}

/// Largest µ of the search, 1/m.
fn deepest(from: &Vector3<f64>, to: &Vector3<f64>, ground_m: Option<f64>) -> Result<f64, EnergyError> {
    let line = Parabola { from: *from, to: *to, mu_per_m: 0.0 };
    parabola::check(&line)?;
    if parabola::is_vertical(&line) {
        if let Some(ground) = ground_m {
            parabola::mu_limit(from, to, ground)?;
        }
        return Ok(0.0);
    }
    let xf = line.extent();
    // The sag below the middle of the line is µ xf² / 4.
    let cap = 4.0 * DEEPEST_SAG * (xf + (to.z - from.z).abs()) / (xf * xf);
    match ground_m {
        None => Ok(cap),
        Some(ground) => Ok(parabola::mu_limit(from, to, ground)?.unwrap_or(0.0).min(cap)),
    }
}

/// Returns the argument in 0..=`end` with the lowest value; None if every evaluated point is infinite.
fn minimise(objective: &mut impl FnMut(f64, Precision) -> f64, end: f64, scan: Precision) -> Option<f64> {
    let (points, low) = scanned(objective, end, scan);
    let (last, grid) = (points.len() - 1, |i: usize| points[i].mu);
    let mut best: Option<(f64, f64)> = None;
    for i in low {
        keep(&mut best, grid(i), points[i].value());
        // The true minimum may lie in a neighbouring interval: move the bracket as long as the result is at its end.
        let (mut a, mut b) = (i.saturating_sub(1), (i + 1).min(last));
        for _ in 0..MAX_BRACKETS {
            let (mu, value) = brent_minimum(|mu| objective(mu, Precision::Fine), grid(a), grid(b));
            keep(&mut best, mu, value);
            let edge = 1e-3 * (grid(b) - grid(a));
            if mu - grid(a) < edge && a > 0 {
                (a, b) = (a - 1, a + 1);
            } else if grid(b) - mu < edge && b < last {
                (a, b) = (b - 1, b + 1);
            } else {
                break;
            }
        }
    }
    // The lowest place may be beside an infeasible interval, between two points of the scan.
    for pair in points.windows(2) {
        let (mut inside, mut outside) = match [&pair[0], &pair[1]].map(|point| point.value().is_finite()) {
            [true, false] => (pair[0].mu, pair[1].mu),
            [false, true] => (pair[1].mu, pair[0].mu),
            _ => continue,
        };
        for _ in 0..EDGE_STEPS {
            let middle = 0.5 * (inside + outside);
            let value = objective(middle, Precision::Fine);
            keep(&mut best, middle, value);
            *(if value.is_finite() { &mut inside } else { &mut outside }) = middle;
        }
    }
    best.map(|(mu, _)| mu)
}

/// A point of the scan.
struct Point {
    mu: f64,
    scanned: f64,
    /// Its fine value, if it is known.
    fine: Option<f64>,
}

impl Point {
    /// The best known value.
    fn value(&self) -> f64 {
        self.fine.unwrap_or(self.scanned)
    }

    /// For the comparison with other points: infinite if it is known to be impossible.
    fn rank(&self) -> f64 {
        if self.fine == Some(f64::INFINITY) { f64::INFINITY } else { self.scanned }
    }
}

/// Scans 0..=`end`: points in their order, and the low ones among them, which have a fine value. Around the low points
/// the scan is twice as dense, so that two valleys beside each other do not pass for one.
fn scanned(objective: &mut impl FnMut(f64, Precision) -> f64, end: f64, scan: Precision) -> (Vec<Point>, Vec<usize>) {
    // Squared spacing puts more points near the straight line, where the cost falls fastest. The last share is 1.
    let share = |i: usize| i as f64 / (SCAN_POINTS - 1) as f64;
    let mut points: Vec<_> = (0..SCAN_POINTS).map(|i| point(objective, end * share(i) * share(i), scan)).collect();
    let low = possible_low_points(&mut points, objective);
    let is_near = |k: usize| low.iter().any(|i| (i.saturating_sub(HALVED)..i + HALVED).contains(&k));
    let halved: Vec<_> = (0..points.len() - 1).filter(|k| is_near(*k)).collect();
    let between: Vec<_> =
        halved.iter().map(|k| point(objective, 0.5 * (points[*k].mu + points[k + 1].mu), scan)).collect();
    points.extend(between);
    points.sort_by(|a, b| a.mu.total_cmp(&b.mu));
    let low = possible_low_points(&mut points, objective);
    (points, low)
}

fn point(objective: &mut impl FnMut(f64, Precision) -> f64, mu: f64, scan: Precision) -> Point {
    let scanned = objective(mu, scan);
    Point { mu, scanned, fine: (scan == Precision::Fine).then_some(scanned) }
}

/// Low points that are possible by their fine value. Where one is not, its neighbours take its place.
fn possible_low_points(points: &mut [Point], objective: &mut impl FnMut(f64, Precision) -> f64) -> Vec<usize> {
    loop {
        let low = low_points(points);
        let Some(i) = low.iter().copied().find(|i| points[*i].fine.is_none()) else { return low };
        points[i].fine = Some(objective(points[i].mu, Precision::Fine));
    }
}

/// The lowest local minima among points in their order, at most [`MAX_REFINED`].
fn low_points(points: &[Point]) -> Vec<usize> {
    let value = |i: usize| points.get(i).map_or(f64::INFINITY, Point::rank);
    let before = |i: usize| if i > 0 { value(i - 1) } else { f64::INFINITY };
    let is_low = |i: &usize| value(*i).is_finite() && value(*i) <= before(*i) && value(*i) <= value(i + 1);
    let mut low: Vec<_> = (0..points.len()).filter(is_low).collect();
    low.sort_by(|i, j| value(*i).total_cmp(&value(*j)));
    low.truncate(MAX_REFINED);
    low
}

/// Keeps a place if it is lower than the best one.
fn keep(best: &mut Option<(f64, f64)>, mu: f64, value: f64) {
    if value.is_finite() && best.is_none_or(|(_, least)| value < least) {
        *best = Some((mu, value));
    }
}

/// Brent's minimisation between `a` and `b`: the vertex of the parabola through the three best points while that makes
/// progress, otherwise a golden section. Jumps and infinite values only cost additional evaluations.
///
/// Golden sections need thirty steps to a minimum at an end. Where three points fall towards an end, and their parabola
/// has no vertex inside, that end is therefore tried once: it is the result if the values fall up to there.
fn brent_minimum(mut objective: impl FnMut(f64) -> f64, mut a: f64, mut b: f64) -> (f64, f64) {
    const SHARE: f64 = 0.381_966_011_250_105_1;
    let closest = BRACKET_SHARE * (b - a);
    // The best point, the second best, and the previous second best.
    let mut x = a + SHARE * (b - a);
    let mut fx = objective(x);
    let (mut w, mut fw, mut v, mut fv) = (x, fx, x, fx);
    let (mut step, mut step_before) = (0.0f64, 0.0f64);
    let mut end_tried = false;
    for _ in 0..MAX_SECTIONS {
        let middle = 0.5 * (a + b);
        if (x - middle).abs() + 0.5 * (b - a) <= 2.0 * closest {
            break;
        }
        let (r, q) = ((x - w) * (fx - fv), (x - v) * (fx - fw));
        let vertex = ((x - v) * q - (x - w) * r) / (2.0 * (r - q));
        // Accept the vertex if it is inside the bracket, finite, and less than half the step before the last.
        let inside = (a + closest..b - closest).contains(&(x + vertex));
        let gains = inside && vertex.abs() < 0.5 * step_before.abs();
        if !inside && !end_tried && (v - w) * (w - x) > 0.0 && fx < fw && fw < fv {
            end_tried = true;
            let (end, inward) = if x > w { (b - closest, -closest) } else { (a + closest, closest) };
            let at_end = objective(end);
            if at_end < fx && (at_end..fx).contains(&objective(end + inward)) {
                return (end, at_end);
            }
        }
        step_before = step;
        if gains {
            step = vertex;
        } else {
            step_before = if x < middle { b - x } else { a - x };
            step = SHARE * step_before;
        }
        let y = x + if step.abs() >= closest { step } else { closest.copysign(step) };
        let fy = objective(y);
        if fy <= fx {
            if y < x {
                b = x
            } else {
                a = x
            }
            (v, fv, w, fw, x, fx) = (w, fw, x, fx, y, fy);
        } else {
            if y < x {
                a = y
            } else {
                b = y
            }
            if fy <= fw || w == x {
                (v, fv, w, fw) = (w, fw, y, fy);
            } else if fy <= fv || v == x || v == w {
                (v, fv) = (y, fy);
            }
        }
    }
    (x, fx)
}
