//! The recursion of the gain with a state weight, its steps doubled.

use cable_robot::linalg::SymmetricInverse;
use nalgebra::Matrix3;

/// M after as many steps as the horizon; None if a matrix has no inverse. The step is M → ((Q + M)⁻¹ + S)⁻¹, and the
/// first M is S⁻¹. The steps are doubled, so their number hardly costs.
pub(super) fn after_horizon(s: &Matrix3<f64>, state_weight: &Matrix3<f64>, horizon: u32) -> Option<Matrix3<f64>> {
    let mut steps = Steps::NONE;
    let mut doubled = Steps::single(s, state_weight)?;
    let mut left = horizon - 1;
    while left > 0 {
        if left % 2 == 1 {
            steps = doubled.after(&steps)?;
        }
        left /= 2;
        if left > 0 {
            doubled = doubled.after(&doubled)?;
        }
    }
    // S⁻¹ (I + G S⁻¹)⁻¹ = (S + G)⁻¹: S itself needs no inverse.
    let inner = inverse_spd(&(s + steps.g))?;
    Some(symmetric(&(steps.h + product(&steps.a.transpose(), &product(&inner, &steps.a)))))
}

/// Several steps in one: M → H + Aᵀ M (I + G M)⁻¹ A, with symmetric G and H (the structured doubling algorithm of
/// E. K.-W. Chu, H.-Y. Fan and W.-W. Lin, Linear Algebra and its Applications 396, 2005).
struct Steps {
    a: Matrix3<f64>,
    g: Matrix3<f64>,
    h: Matrix3<f64>,
}

impl Steps {
    const NONE: Steps = {
        let zero = Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        Steps { a: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), g: zero, h: zero }
    };

    /// One step: the state weight is added, then comes the input.
    fn single(s: &Matrix3<f64>, state_weight: &Matrix3<f64>) -> Option<Self> {
        let weighted = Self { h: *state_weight, ..Self::NONE };
        Self { g: *s, ..Self::NONE }.after(&weighted)
    }

    /// These steps after those before.
    fn after(&self, before: &Self) -> Option<Self> {
        let w = inverse(&(Matrix3::identity() + product(&self.g, &before.h)))?;
        let w_a = product(&w, &self.a);
        let before_w = product(&before.a, &w);
        Some(Self {
            a: product(&before.a, &w_a),
            g: symmetric(&(before.g + product(&product(&before_w, &self.g), &before.a.transpose()))),
            h: symmetric(&(self.h + product(&self.a.transpose(), &product(&before.h, &w_a)))),
        })
    }
}

fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| a[(i, 0)] * b[(0, j)] + a[(i, 1)] * b[(1, j)] + a[(i, 2)] * b[(2, j)])
}

fn symmetric(m: &Matrix3<f64>) -> Matrix3<f64> {
    (m + m.transpose()) * 0.5
}

/// Inverse by cofactors.
fn inverse(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let [a, b, c] = [m.column(0).into_owned(), m.column(1).into_owned(), m.column(2).into_owned()];
    let rows = [b.cross(&c), c.cross(&a), a.cross(&b)];
    let determinant = a.dot(&rows[0]);
    let scale = 1.0 / determinant;
    scale.is_finite().then(|| Matrix3::from_columns(&rows.map(|row| row * scale)).transpose())
}

/// Inverse of a symmetric positive definite matrix, exactly symmetric. The matrix is scaled to unit size first, because
/// Ts² makes its entries small.
pub(super) fn inverse_spd(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let scale = m.trace();
    if !(scale.is_finite() && scale > 0.0) {
        return None;
    }
    let unit = m / scale;
    // The determinant of a matrix with trace 1 is at most 1/27; this bound is a condition number of about 1e12.
    let inverse = SymmetricInverse::of(&unit)?.matrix();
    let largest = inverse.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    (largest < 1e13).then(|| inverse * (1.0 / scale))
}
