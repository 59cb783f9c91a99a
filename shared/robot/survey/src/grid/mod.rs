//! A map of a scalar field on a regular grid, from samples at uncertain places.
//!
//! # Method
//! The value of a cell is that of a plane, fitted to the samples around the cell's centre by weighted least squares (local linear
//! regression, as in Fan and Gijbels, *Local Polynomial Modelling and Its Applications*, 1996). What has to be chosen is how far around:
//! narrow keeps edges, wide averages noise. It is chosen for each cell on its own by the intersection of confidence intervals
//! (Goldenshluger and Nemirovski 1997; Katkovnik 1999): beginning with the narrowest circle, it is widened for as long as the intervals of
//! all circles so far have a value in common. Over smooth ground that ends wide, beside an edge it ends before the edge.
//!
//! * A sample weighs `1 / sigma^2` of its value, times a kernel `(1 - u^2)^2` of the distance `u` over the radius.
//! * Samples are summed up within their own cell (numbers, places, products of both up to the second order), and these sums are what
//!   circles are put together from. So a sample costs the same in the first second and after hours, and a plane still comes out exactly.
//! * A place where the node hovered counts as [`FULL_CELL`] samples at most against its neighbours.
//! * Slopes that the samples do not determine (one straight track) are held by a prior: zero, give or take the standard deviation of the
//!   values over the widest radius.
//!
//! # Uncertainty
//! The variance of a cell is the sum of five:
//! * noise of the values, through the fit. Its level is the given `sigma`; where none is given, or where residuals are larger than it in
//!   half of the cells, what the median cell scatters;
//! * the slope that is not known, times the distance to the samples (large between tracks and at the border of what was seen);
//! * the bend of the ground within the circle, from how much the last widenings changed the value: that grows with the square of the radius;
//! * scatter beyond the noise: structure that a plane does not describe, such as an edge within the circle. Averaging does not lessen it;
//! * the uncertainty of the places, times the slope. It is not lessened by averaging either, as most of it (anchors, line lengths) is the same
//!   for all samples of a neighbourhood.
//!
//! A cell without any sample within [`GridOptions::reach_m`] is unknown.

mod cell;
mod fit;
mod moments;
mod spec;

use crate::SurveyError;
pub use cell::{FULL_CELL, GridCell};
use fit::{Scales, Surroundings};
use moments::Moments;
pub use spec::{GridOptions, GridSample, GridSpec, MOST_CELLS};

/// What the noise or the spread of the values may change by before cells without new samples are made anew, ratio.
const STEADY: f64 = 1.2;

/// What became of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Added {
    /// It is in the map from the next [`GridMap::refresh`] on.
    Inside,
    /// It lies outside of the grid.
    Outside,
    /// A number of it is not finite, or a variance is below zero.
    Unusable,
}

/// Samples taken so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GridCounts {
    /// In the map.
    pub inside: u64,
    /// Outside of the grid.
    pub outside: u64,
    /// Not usable.
    pub unusable: u64,
    /// Time stamp of the newest one in the map, ns; 0 before the first.
    pub newest_ns: u64,
}

/// A map that grows by samples.
#[derive(Debug, Clone)]
pub struct GridMap {
    spec: GridSpec,
    options: GridOptions,
    scales: Scales,
    moments: Vec<Moments>,
    cells: Vec<Option<GridCell>>,
    /// Reduced residual of each cell's narrowest fit that has one; NaN without.
    residuals: Vec<f64>,
    scratch: Vec<f64>,
    /// Cells with new samples since the last refresh, and whether a cell is among them.
    fresh: Vec<u32>,
    is_fresh: Vec<bool>,
    /// Cells to be made anew in this refresh.
    due: Vec<bool>,
    /// Values are summed up against the first one, so that a small signal on a large value keeps its digits.
    base: Option<f64>,
    sum: f64,
    sum_squares: f64,
    /// Whether all samples say how uncertain their value is.
    sigmas_given: bool,
    last: Surroundings,
    counts: GridCounts,
}

impl GridMap {
    /// An empty map.
    ///
    /// # Errors
    /// A number of the specification or of the options that makes no sense.
    pub fn new(spec: GridSpec, options: GridOptions) -> Result<Self, SurveyError> {
        spec.check()?;
        options.check()?;
        let cells = spec.cells();
        Ok(Self {
            scales: Scales::new(spec.cell_m, &options),
            spec,
            options,
            moments: vec![Moments::default(); cells],
            cells: vec![None; cells],
            residuals: vec![f64::NAN; cells],
            scratch: Vec::with_capacity(cells),
            fresh: Vec::with_capacity(cells),
            is_fresh: vec![false; cells],
            due: vec![false; cells],
            base: None,
            sum: 0.0,
            sum_squares: 0.0,
            sigmas_given: true,
            last: Surroundings { noise: 0.0, slope: 0.0 },
            counts: GridCounts::default(),
        })
    }

    /// The map of these samples, made at once.
    ///
    /// # Errors
    /// See [`GridMap::new`].
    pub fn of<'a>(
        spec: GridSpec,
        options: GridOptions,
        samples: impl IntoIterator<Item = &'a GridSample>,
    ) -> Result<Self, SurveyError> {
        let mut map = Self::new(spec, options)?;
        for sample in samples {
            map.add(sample);
        }
        map.refresh_all();
        Ok(map)
    }

    /// Takes a sample in; it shows after the next [`GridMap::refresh`]. Constant time.
    pub fn add(&mut self, sample: &GridSample) -> Added {
        if !sample.is_usable() {
            self.counts.unusable += 1;
            return Added::Unusable;
        }
        let Some((column, row)) = self.spec.cell_at(sample.position_m) else {
            self.counts.outside += 1;
            return Added::Outside;
        };
        let value = sample.value - *self.base.get_or_insert(sample.value);
        let centre = self.spec.centre(column, row);
        let offset: [f64; 2] = std::array::from_fn(|k| (sample.position_m[k] - centre[k]) / self.spec.cell_m);
        let at = self.spec.index(column, row);
        self.moments[at].add(offset, value, sample);
        self.sum += value;
        self.sum_squares += value * value;
        self.sigmas_given &= sample.value_sigma.is_some();
        if !std::mem::replace(&mut self.is_fresh[at], true) {
            self.fresh.push(at as u32);
        }
        self.counts.inside += 1;
        self.counts.newest_ns = self.counts.newest_ns.max(sample.stamp_ns);
        Added::Inside
    }

    /// Makes the cells around new samples anew, and all of them where the samples have changed what noise and spread are thought to be.
    /// Says whether anything was new.
    pub fn refresh(&mut self) -> bool {
        if self.fresh.is_empty() {
            return false;
        }
        self.mark_due();
        self.update(false);
        true
    }

    /// Makes every cell anew, so that the map is that of its samples alone, however often it was made anew on the way.
    pub fn refresh_all(&mut self) {
        self.due.fill(true);
        self.update(true);
    }

    fn update(&mut self, all: bool) {
        self.update_residuals();
        let now = self.surroundings();
        let steady = |now: f64, last: f64| now <= last * STEADY && now >= last / STEADY;
        let all = all || !steady(now.noise, self.last.noise) || !steady(now.slope, self.last.slope);
        if all {
            self.last = now;
        }
        let base = self.base.unwrap_or(0.0);
        for at in 0..self.cells.len() {
            if all || self.due[at] {
                self.cells[at] = fit::cell(&self.spec, &self.scales, &self.moments, at, &self.last).map(|mut cell| {
                    cell.value += base;
                    cell
                });
            }
        }
        self.due.fill(false);
        for at in self.fresh.drain(..) {
            self.is_fresh[at as usize] = false;
        }
    }

    /// Every cell that a fresh one is within reach of.
    fn mark_due(&mut self) {
        let reach = self.scales.widest_cells();
        let (columns, rows) = (self.spec.columns, self.spec.rows);
        for &at in &self.fresh {
            let (column, row) = (at as usize % columns, at as usize / columns);
            for row in row.saturating_sub(reach)..(row + reach + 1).min(rows) {
                let first = row * columns + column.saturating_sub(reach);
                let last = row * columns + (column + reach + 1).min(columns);
                self.due[first..last].fill(true);
            }
        }
    }

    fn update_residuals(&mut self) {
        let slope = self.prior_slope();
        for at in 0..self.cells.len() {
            if self.due[at] && self.moments[at].count > 0 {
                self.residuals[at] = fit::residual(&self.spec, &self.scales, &self.moments, at, slope);
            }
        }
    }

    /// Standard deviation of all values, in their unit.
    fn spread(&self) -> f64 {
        let count = self.counts.inside as f64;
        if count < 2.0 {
            return 0.0;
        }
        let mean = self.sum / count;
        (self.sum_squares / count - mean * mean).max(0.0).sqrt()
    }

    /// Of the slopes, per cell.
    fn prior_slope(&self) -> f64 {
        self.spread() * self.spec.cell_m / self.options.reach_m
    }

    fn surroundings(&mut self) -> Surroundings {
        self.scratch.clear();
        self.scratch.extend(self.residuals.iter().copied().filter(|residual| residual.is_finite()));
        let middle = self.scratch.len() / 2;
        let median = (!self.scratch.is_empty()).then(|| *self.scratch.select_nth_unstable_by(middle, f64::total_cmp).1);
        let noise = match (median, self.sigmas_given) {
            (Some(median), true) => median.max(1.0),
            (Some(median), false) => median,
            (None, true) => 1.0,
            // too few samples to tell noise from structure: all of it could be noise
            (None, false) => self.spread() * self.spread(),
        };
        let least = self.options.least_sigma;
        let noise = if self.sigmas_given { noise } else { noise.max(least * least) };
        Surroundings { noise, slope: self.prior_slope() }
    }

    /// Where the cells are.
    #[must_use]
    pub fn spec(&self) -> &GridSpec {
        &self.spec
    }

    /// How the map is made.
    #[must_use]
    pub fn options(&self) -> &GridOptions {
        &self.options
    }

    /// Samples taken so far.
    #[must_use]
    pub fn counts(&self) -> GridCounts {
        self.counts
    }

    /// Every cell as of the last refresh, row by row from the lowest y, in a row from the lowest x.
    #[must_use]
    pub fn cells(&self) -> &[Option<GridCell>] {
        &self.cells
    }

    /// A cell as of the last refresh; `None` if nothing is known there, or there is no such cell.
    #[must_use]
    pub fn cell(&self, column: usize, row: usize) -> Option<&GridCell> {
        if column >= self.spec.columns || row >= self.spec.rows {
            return None;
        }
        self.cells[self.spec.index(column, row)].as_ref()
    }

    /// The cell in which this point lies.
    #[must_use]
    pub fn at(&self, position_m: [f64; 2]) -> Option<&GridCell> {
        let (column, row) = self.spec.cell_at(position_m)?;
        self.cell(column, row)
    }

    /// Noise of one value as of the last refresh, in the unit of the values; where the samples give a `sigma`, what they give has to be
    /// multiplied by (1: they are believed).
    #[must_use]
    pub fn noise(&self) -> f64 {
        self.last.noise.sqrt()
    }
}
