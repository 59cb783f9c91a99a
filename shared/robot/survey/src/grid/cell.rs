//! A cell of a grid.

/// Largest number of samples of one cell that count relative to its neighbours.
pub const FULL_CELL: f64 = 25.0;

/// Estimate of one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridCell {
    /// Value of the field at the centre of the cell, in the unit of the samples.
    pub value: f64,
    /// Standard deviation of the value, in the unit of the samples.
    pub sigma: f64,
    /// Slope along x and y, per metre.
    pub gradient_per_m: [f64; 2],
    /// Scatter of the surrounding samples beyond their noise, in the unit of the values: structure
    /// finer than the circle.
    pub structure: f64,
    /// Selected radius, m.
    pub radius_m: f64,
    /// Number of samples in the cell itself.
    pub samples: u32,
}

impl GridCell {
    /// Magnitude of the slope, per metre.
    #[must_use]
    pub fn slope_per_m(&self) -> f64 {
        let [x, y] = self.gradient_per_m;
        (x * x + y * y).sqrt()
    }
}
