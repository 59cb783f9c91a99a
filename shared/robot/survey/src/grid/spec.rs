//! Where the cells are, how the map is made, and what it is made from.

use crate::SurveyError;

/// Where the cells of a grid are: squares, `columns` along x and `rows` along y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridSpec {
    /// The corner with the lowest x and y, m.
    pub origin_m: [f64; 2],
    /// Side of a cell, m.
    pub cell_m: f64,
    /// Cells along x.
    pub columns: usize,
    /// Cells along y.
    pub rows: usize,
}

impl GridSpec {
    /// The smallest grid that covers a rectangle, from its low corner on.
    ///
    /// # Errors
    /// A rectangle or a cell that is none, or more cells than there may be.
    pub fn covering(low_m: [f64; 2], high_m: [f64; 2], cell_m: f64) -> Result<Self, SurveyError> {
        positive("cell_m", cell_m)?;
        let mut counts = [0; 2];
        for k in 0..2 {
            if !low_m[k].is_finite() {
                return Err(value("origin_m", low_m[k], "a finite number"));
            }
            let side_m = high_m[k] - low_m[k];
            if !(side_m.is_finite() && side_m >= 0.0) {
                return Err(value("side_m", side_m, "0 or above and finite"));
            }
            // a side of a whole number of cells keeps it in spite of rounding; a saturating cast is refused below
            counts[k] = ((side_m / cell_m - 1e-9).ceil() as usize).max(1);
        }
        let spec = Self { origin_m: low_m, cell_m, columns: counts[0], rows: counts[1] };
        spec.check()?;
        Ok(spec)
    }

    pub(super) fn check(&self) -> Result<(), SurveyError> {
        positive("cell_m", self.cell_m)?;
        if let Some(bad) = self.origin_m.iter().find(|value| !value.is_finite()) {
            return Err(value("origin_m", *bad, "a finite number"));
        }
        match self.columns.checked_mul(self.rows) {
            Some(1..=MOST_CELLS) => Ok(()),
            _ => Err(SurveyError::Cells { columns: self.columns, rows: self.rows, most: MOST_CELLS }),
        }
    }

    /// Number of cells.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.columns * self.rows
    }

    /// Where a cell stands in lists of all cells.
    #[must_use]
    pub fn index(&self, column: usize, row: usize) -> usize {
        row * self.columns + column
    }

    /// Its centre, m.
    #[must_use]
    pub fn centre(&self, column: usize, row: usize) -> [f64; 2] {
        let along = |origin: f64, i: usize| origin + (i as f64 + 0.5) * self.cell_m;
        [along(self.origin_m[0], column), along(self.origin_m[1], row)]
    }

    /// Column and row of the cell in which a point lies.
    #[must_use]
    pub fn cell_at(&self, position_m: [f64; 2]) -> Option<(usize, usize)> {
        let along = |k: usize, count: usize| {
            let cells = ((position_m[k] - self.origin_m[k]) / self.cell_m).floor();
            (cells >= 0.0 && cells < count as f64).then_some(cells as usize)
        };
        Some((along(0, self.columns)?, along(1, self.rows)?))
    }

    /// The corner with the highest x and y, m.
    #[must_use]
    pub fn end_m(&self) -> [f64; 2] {
        let side = |count: usize| count as f64 * self.cell_m;
        [self.origin_m[0] + side(self.columns), self.origin_m[1] + side(self.rows)]
    }
}

/// How a map is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridOptions {
    /// Diameter of what the sensor sees at once, m: nothing finer is looked for. 0: a point.
    pub footprint_m: f64,
    /// How far a sample speaks for its surroundings, m: at least half the distance of neighbouring tracks, if the ground between them is to
    /// be in the map.
    pub reach_m: f64,
    /// For samples that do not say how uncertain they are: their noise is not believed to be less than this, in the unit of the values.
    /// Half of what the sensor counts in is a good choice.
    pub least_sigma: f64,
}

impl GridOptions {
    /// For cells of this size: a sample speaks for four cells around.
    #[must_use]
    pub fn for_cell(cell_m: f64) -> Self {
        Self { footprint_m: 0.0, reach_m: 4.0 * cell_m, least_sigma: 0.0 }
    }

    pub(super) fn check(&self) -> Result<(), SurveyError> {
        positive("reach_m", self.reach_m)?;
        for (key, given) in [("footprint_m", self.footprint_m), ("least_sigma", self.least_sigma)] {
            if !(given.is_finite() && given >= 0.0) {
                return Err(value(key, given, "0 or above and finite"));
            }
        }
        Ok(())
    }
}

impl Default for GridOptions {
    /// For cells of 0.1 m.
    fn default() -> Self {
        Self::for_cell(0.1)
    }
}

/// One value and where it was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridSample {
    /// x and y, m.
    pub position_m: [f64; 2],
    /// Their covariance: xx, xy, yy, m².
    pub position_covariance_m2: [f64; 3],
    /// What was measured, in whatever unit.
    pub value: f64,
    /// Its standard deviation in the same unit, above 0; `None`: not known, then it is estimated from the scatter of all.
    pub value_sigma: Option<f64>,
    /// When it was true, ns.
    pub stamp_ns: u64,
}

impl GridSample {
    /// A value at a place that is known exactly.
    #[must_use]
    pub fn at(position_m: [f64; 2], value: f64) -> Self {
        Self { position_m, position_covariance_m2: [0.0; 3], value, value_sigma: None, stamp_ns: 0 }
    }

    pub(super) fn is_usable(&self) -> bool {
        let [xx, xy, yy] = self.position_covariance_m2;
        self.position_m.iter().chain([&self.value, &xx, &xy, &yy]).all(|number| number.is_finite())
            && xx >= 0.0
            && yy >= 0.0
            // its square and what it divides have to be numbers too
            && self.value_sigma.is_none_or(|sigma| (1e-100..1e100).contains(&sigma))
            && self.value.abs() < 1e100
    }
}

fn positive(key: &'static str, given: f64) -> Result<(), SurveyError> {
    if given.is_finite() && given > 0.0 { Ok(()) } else { Err(value(key, given, "above 0 and finite")) }
}

fn value(key: &'static str, value: f64, accepted: &'static str) -> SurveyError {
    SurveyError::Value { key, value, accepted }
}

/// Cells of one map at most.
pub const MOST_CELLS: usize = 4_000_000;
