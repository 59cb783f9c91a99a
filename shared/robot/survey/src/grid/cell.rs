//! A cell of a grid.

/// Samples of one cell that count against its neighbours' at most.
pub const FULL_CELL: f64 = 25.0;

/// What the map says about one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridCell {
    /// The field at the cell's centre, in the unit of the values.
    pub value: f64,
    /// Its standard deviation, in the unit of the values.
    pub sigma: f64,
    /// Slope along x and y, per metre.
    pub gradient_per_m: [f64; 2],
    /// How far the samples around scatter beyond their noise: structure that is finer than the circle, in the unit of the values.
    pub structure: f64,
    /// Radius of the circle that was chosen, m.
    pub radius_m: f64,
    /// Samples in the cell itself.
    pub samples: u32,
}

impl GridCell {
    /// Size of the slope, per metre.
    #[must_use]
    pub fn slope_per_m(&self) -> f64 {
        let [x, y] = self.gradient_per_m;
        (x * x + y * y).sqrt()
    }
}
