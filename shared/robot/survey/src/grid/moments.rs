//! Sums over the samples of a cell, sufficient for every weighted fit of a plane in which the cell has a single weight.

use super::cell::FULL_CELL;
use super::spec::GridSample;

/// Sums over samples at (x, y) in cells from the centre, with value v and weight q = 1/sigma².
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Moments {
    /// Number of samples.
    pub count: u32,
    /// q times 1, x, y, xx, xy, yy.
    pub design: [f64; 6],
    /// qv times 1, x, y.
    pub values: [f64; 3],
    /// qvv.
    pub square: f64,
    /// q times the covariance of the position, m².
    pub places_m2: [f64; 3],
}

impl Moments {
    pub fn add(&mut self, [x, y]: [f64; 2], value: f64, sample: &GridSample) {
        let q = sample.value_sigma.map_or(1.0, |sigma| 1.0 / (sigma * sigma));
        self.count = self.count.saturating_add(1);
        add(&mut self.design, q, &[1.0, x, y, x * x, x * y, y * y]);
        add(&mut self.values, q * value, &[1.0, x, y]);
        self.square += q * value * value;
        add(&mut self.places_m2, q, &sample.position_covariance_m2);
    }

    /// Mean position of the samples, cells from the centre.
    pub fn mean(&self) -> [f64; 2] {
        [self.design[1] / self.design[0], self.design[2] / self.design[0]]
    }

    /// Share of the samples that counts relative to neighbours, 0 to 1.
    pub fn share(&self) -> f64 {
        (FULL_CELL / f64::from(self.count)).min(1.0)
    }

    /// The sums relative to a point that lies (x, y) cells before the centre.
    pub fn shifted(&self, [x, y]: [f64; 2]) -> ([f64; 6], [f64; 3]) {
        let [n, sx, sy, sxx, sxy, syy] = self.design;
        let [v, vx, vy] = self.values;
        let design = [
            n,
            sx + x * n,
            sy + y * n,
            sxx + 2.0 * x * sx + x * x * n,
            sxy + x * sy + y * sx + x * y * n,
            syy + 2.0 * y * sy + y * y * n,
        ];
        (design, [v, vx + x * v, vy + y * v])
    }
}

/// Adds a multiple of a list to another.
pub(super) fn add<const N: usize>(into: &mut [f64; N], by: f64, what: &[f64; N]) {
    for (sum, one) in into.iter_mut().zip(what) {
        *sum += by * one;
    }
}
