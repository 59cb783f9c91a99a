//! The fit of a plane around the centre of a cell, and the selection of its radius.

use super::cell::GridCell;
use super::moments::{Moments, add};
use super::spec::{GridOptions, GridSpec};
use nalgebra::{Matrix3, Vector3};

/// Largest number of radii.
const MAX_RADII: usize = 8;
/// Ratio of a radius to the previous one.
const RADIUS_RATIO: f64 = 1.5;
/// Smallest radius, cells: slightly more than the corners of the cell.
const SMALLEST_RADIUS: f64 = 0.8;
/// Half width of the confidence intervals, standard deviations. Wider intervals average more noise and blur edges more;
/// with this value both errors stay below those of one radius for all cells
/// (`edges_and_noise_have_smaller_errors_than_with_one_radius` in the tests).
const CONFIDENCE: f64 = 1.5;
/// Number of samples beyond those that determine the plane, so that the scatter is meaningful.
const MIN_FREEDOM: f64 = 3.0;
/// Shares of three terms in the variance of a cell with samples. Noise counts by this share of it more than through a
/// fit of a given radius, because the radius is selected with the same samples. Scatter beyond the noise lies partly
/// elsewhere in the circle. The largest change of the last enlargements bounds the effect of curvature more than it
/// estimates it. With these shares the standard deviations cover as many errors as normal ones, over drawn fields of
/// other seeds than those that judge them (`tests/surveys/coverage.rs`).
const NOISE_EXCESS: f64 = 0.35;
const STRUCTURE_SHARE: f64 = 0.42;
const BEND_SHARE: f64 = 0.085;
/// Relative weight of a slope prior that keeps the equations solvable without affecting the result.
const FAINT_PRIOR: f64 = 1e-9;

/// Radii of the fit, cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Radii {
    radii: [f64; MAX_RADII],
    count: usize,
    cell_m: f64,
}

impl Radii {
    pub fn new(cell_m: f64, options: &GridOptions) -> Self {
        let narrowest = SMALLEST_RADIUS.max(0.5 * options.footprint_m / cell_m);
        let widest = (options.reach_m / cell_m).max(narrowest);
        let mut radii = [widest; MAX_RADII];
        let mut count = 0;
        let mut radius = narrowest;
        while radius < widest / RADIUS_RATIO.sqrt() && count < MAX_RADII - 1 {
            radii[count] = radius;
            count += 1;
            radius *= RADIUS_RATIO;
        }
        Self { radii, count: count + 1, cell_m }
    }

    fn radii(&self) -> &[f64] {
        &self.radii[..self.count]
    }

    /// Largest radius, cells.
    pub fn widest(&self) -> f64 {
        self.radii[self.count - 1]
    }
}

/// Properties of the whole map that a fit uses: variance of a value of weight 1, standard deviation
/// of a slope per cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surroundings {
    pub noise: f64,
    pub slope: f64,
}

/// Weighted sums over a circle: with the weights, and with their squares for the noise.
struct Circle {
    once: [f64; 6],
    twice: [f64; 6],
    values: [f64; 3],
    square: f64,
    places_m2: [f64; 3],
    /// Sum of the weights without q.
    weight: f64,
}

impl Circle {
    /// Sums over a circle around a cell; `None` if it contains no sample.
    fn around(spec: &GridSpec, moments: &[Moments], at: usize, radius: f64) -> Option<Self> {
        let (column, row) = ((at % spec.columns) as isize, (at / spec.columns) as isize);
        let reach = (radius + 0.5).ceil() as isize;
        let mut circle =
            Self { once: [0.0; 6], twice: [0.0; 6], values: [0.0; 3], square: 0.0, places_m2: [0.0; 3], weight: 0.0 };
        let within = |i: isize, count: usize| (i - reach).max(0)..(i + reach + 1).min(count as isize);
        for r in within(row, spec.rows) {
            for c in within(column, spec.columns) {
                let cell = &moments[spec.index(c as usize, r as usize)];
                if cell.count == 0 {
                    continue;
                }
                let offset = [(c - column) as f64, (r - row) as f64];
                let mean = cell.mean();
                let (x, y) = (offset[0] + mean[0], offset[1] + mean[1]);
                let inside = 1.0 - (x * x + y * y) / (radius * radius);
                if inside <= 0.0 {
                    continue;
                }
                let weight = inside * inside * cell.share();
                let (design, values) = cell.shifted(offset);
                add(&mut circle.once, weight, &design);
                add(&mut circle.twice, weight * weight, &design);
                add(&mut circle.values, weight, &values);
                circle.square += weight * cell.square;
                add(&mut circle.places_m2, weight, &cell.places_m2);
                circle.weight += weight * f64::from(cell.count);
            }
        }
        (circle.weight > 0.0).then_some(circle)
    }
}

/// A plane, in cells.
struct Fit {
    value: f64,
    slope: [f64; 2],
    /// Variance of the value from noise, and with that from the unknown slope.
    by_noise: f64,
    variance: f64,
    /// Mean square of the residuals relative to noise of variance 1, and its degrees of freedom.
    residual: f64,
    freedom: f64,
}

fn symmetric([a, b, c, d, e, f]: [f64; 6]) -> Matrix3<f64> {
    Matrix3::new(a, b, c, b, d, e, c, e, f)
}

fn fit(circle: &Circle, around: &Surroundings) -> Option<Fit> {
    let once = symmetric(circle.once);
    let twice = symmetric(circle.twice);
    let values = Vector3::from(circle.values);
    let faint = FAINT_PRIOR * circle.once[0];
    // weight of the prior relative to a sample; without variation, slopes are zero
    let prior = if around.slope > 0.0 { (around.noise / (around.slope * around.slope)).max(faint) } else { faint };
    let held = Matrix3::from_diagonal(&Vector3::new(0.0, prior, prior));
    let inverse = (once + held).cholesky()?.inverse();
    let plane = inverse * values;
    let by_noise = inverse * twice * inverse;
    let by_slope = inverse * held * held * inverse;
    let from_noise = around.noise * by_noise[(0, 0)];
    let variance = from_noise + around.slope * around.slope * by_slope[(0, 0)];
    let squares = (circle.square - 2.0 * plane.dot(&values) + (plane.transpose() * once * plane)[(0, 0)]).max(0.0);
    let freedom = circle.weight - 2.0 * (inverse * twice).trace() + (by_noise * once).trace();
    Some(Fit {
        value: plane[0],
        slope: [plane[1], plane[2]],
        by_noise: from_noise,
        variance,
        residual: if freedom > 0.0 { squares / freedom } else { 0.0 },
        freedom,
    })
    .filter(|fit| fit.value.is_finite() && fit.variance.is_finite())
}

/// The residual of the narrowest fit with enough samples around a cell, relative to noise of variance
/// 1; NaN if none has.
pub(super) fn residual(spec: &GridSpec, scales: &Radii, moments: &[Moments], at: usize, slope: f64) -> f64 {
    // as if there were no noise, so that the prior does not matter
    let around = Surroundings { noise: 0.0, slope };
    let fits = scales.radii().iter().filter_map(|radius| fit(&Circle::around(spec, moments, at, *radius)?, &around));
    fits.into_iter().find(|fit| fit.freedom >= MIN_FREEDOM).map_or(f64::NAN, |fit| fit.residual)
}

/// A cell, and the variance by the uncertainty of positions that is part of its sigma.
pub(super) struct Fitted {
    pub cell: GridCell,
    pub by_place: f64,
}

/// Estimates a cell from the samples; the value is relative to that of the sums.
pub(super) fn cell(
    spec: &GridSpec,
    scales: &Radii,
    moments: &[Moments],
    at: usize,
    around: &Surroundings,
) -> Option<Fitted> {
    let mut tried = [(0.0, 0.0); MAX_RADII];
    let mut count = 0;
    let mut chosen = None;
    let mut common = [f64::NEG_INFINITY, f64::INFINITY];
    for radius in scales.radii() {
        let Some(circle) = Circle::around(spec, moments, at, *radius) else { continue };
        let Some(fit) = fit(&circle, around) else { continue };
        let half = CONFIDENCE * fit.variance.sqrt();
        common = [common[0].max(fit.value - half), common[1].min(fit.value + half)];
        if common[0] > common[1] && chosen.is_some() {
            break;
        }
        tried[count] = (*radius, fit.value);
        count += 1;
        chosen = Some((*radius, circle, fit));
    }
    let (radius, circle, fit) = chosen?;
    let gradient_per_m = fit.slope.map(|slope| slope / scales.cell_m);
    let [gx, gy] = gradient_per_m;
    let [xx, xy, yy] = circle.places_m2.map(|sum| sum / circle.once[0]);
    let by_place = (gx * gx * xx + 2.0 * gx * gy * xy + gy * gy * yy).max(0.0);
    // the effect of curvature on the value grows with the square of the radius, so two radii determine it
    let bend = |(narrower, value): &(f64, f64)| (value - fit.value) / (1.0 - (narrower / radius) * (narrower / radius));
    let bent = tried[..count - 1].iter().rev().take(2).map(bend).fold(0.0, |most: f64, one| most.max(one.abs()));
    // scatter within chance is noise; the excess does not average out
    let chance = around.noise * (1.0 + 2.0 * (2.0 / fit.freedom.max(1.0)).sqrt());
    let structure =
        if fit.freedom >= 1.0 { (fit.residual - chance).max(0.0) * circle.weight / circle.once[0] } else { 0.0 };
    let variance =
        fit.variance + NOISE_EXCESS * fit.by_noise + by_place + STRUCTURE_SHARE * structure + BEND_SHARE * bent * bent;
    let cell = GridCell {
        value: fit.value,
        sigma: variance.sqrt(),
        gradient_per_m,
        structure: structure.sqrt(),
        radius_m: radius * scales.cell_m,
        samples: moments[at].count,
    };
    Some(Fitted { cell, by_place })
}
