//! Grid, options and samples of a map.

use crate::SurveyError;

/// Grid of a map: square cells, `columns` along x and `rows` along y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridSpec {
    /// The corner with the lowest x and y, m.
    pub origin_m: [f64; 2],
    /// Side of a cell, m.
    pub cell_m: f64,
    /// Number of cells along x.
    pub columns: usize,
    /// Number of cells along y.
    pub rows: usize,
}

impl GridSpec {
    /// Builds the smallest grid that covers a rectangle, starting at its low corner.
    ///
    /// # Errors
    /// An invalid rectangle or cell size, or too many cells.
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
            // rounding does not add a cell to a side of a whole number of cells; a saturating cast is rejected below
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

    /// Column and row of every cell, in the order of lists of all cells.
    pub fn places(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let columns = self.columns;
        (0..self.rows).flat_map(move |row| (0..columns).map(move |column| (column, row)))
    }

    /// Index of a cell in lists of all cells.
    #[must_use]
    pub fn index(&self, column: usize, row: usize) -> usize {
        row * self.columns + column
    }

    /// Centre of a cell, m.
    #[must_use]
    pub fn centre(&self, column: usize, row: usize) -> [f64; 2] {
        let along = |origin: f64, i: usize| origin + (i as f64 + 0.5) * self.cell_m;
        [along(self.origin_m[0], column), along(self.origin_m[1], row)]
    }

    /// Column and row of the cell that contains a point.
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

/// Options of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridOptions {
    /// Diameter of the sensor's footprint, m; the map resolves nothing finer. 0 is a point.
    pub footprint_m: f64,
    /// Distance up to which a sample contributes, m: at least half the distance of neighbouring tracks, so that the
    /// ground between them is in the map.
    pub reach_m: f64,
    /// Lower bound of the estimated noise of samples without a standard deviation, in the unit of the values. Half the
    /// resolution of the sensor is a good choice.
    pub least_sigma: f64,
}

impl GridOptions {
    /// Options for cells of this size: a sample contributes up to a distance of four cells.
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
    /// Options for cells of 0.1 m.
    fn default() -> Self {
        Self::for_cell(0.1)
    }
}

/// A measured value and its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridSample {
    /// x and y, m.
    pub position_m: [f64; 2],
    /// Covariance of the position: xx, xy, yy, m².
    pub position_covariance_m2: [f64; 3],
    /// Measured value, in any unit.
    pub value: f64,
    /// Standard deviation of the value in the same unit, above 0; `None` if unknown, then it is estimated from the
    /// scatter of all samples.
    pub value_sigma: Option<f64>,
    /// Time of the measurement, ns.
    pub stamp_ns: u64,
}

impl GridSample {
    /// A value at an exactly known position.
    #[must_use]
    pub fn at(position_m: [f64; 2], value: f64) -> Self {
        Self { position_m, position_covariance_m2: [0.0; 3], value, value_sigma: None, stamp_ns: 0 }
    }

    pub(super) fn is_usable(&self) -> bool {
        let [xx, xy, yy] = self.position_covariance_m2;
        self.position_m.iter().chain([&self.value, &xx, &xy, &yy]).all(|number| number.is_finite())
            && xx >= 0.0
            && yy >= 0.0
            // its square and quotients with it have to be finite too
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

/// Largest number of cells of a map.
pub const MOST_CELLS: usize = 4_000_000;
