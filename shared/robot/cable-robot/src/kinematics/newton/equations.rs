//! What a step of the iteration needs, for any number of cables.

use nalgebra::Vector3;
use wide::f64x2;

/// The equations of a step from a position.
pub(super) trait Equations {
    /// Solution of H d = g, m.
    fn step(&self) -> Vector3<f64>;
    /// Solution with the gradient at the end of a step, m, and the sum of the squared differences there, m².
    fn correction(&self, step: &Vector3<f64>) -> (Vector3<f64>, f64);
    /// Sum of the squared differences after a step so small that it needs no correction, m².
    fn cost_after(&self, step: &Vector3<f64>) -> f64;
    /// Lower bound of λ.
    fn least_eigenvalue(&self) -> f64;
    /// Bound of Σ |e| / t.
    fn curved(&self) -> f64;
    /// K, 1/m.
    fn change_per_m(&self) -> f64;
}

/// Sum of the two lanes.
#[inline(always)]
pub(super) fn sum(lanes: f64x2) -> f64 {
    let [a, b] = lanes.to_array();
    a + b
}
