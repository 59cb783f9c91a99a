//! The unknowns of the joint estimate, its normal equations with eliminated points, and the minimisation.

use nalgebra::{DMatrix, DVector};

use super::input::{JointInput, LEAST_SQUARED_HEIGHT_M2, Loss};
use crate::heights;
use crate::survey::free_index;
use crate::{CalibrationError, Undetermined};
use cable_robot::MAX_CABLES;

/// Bound of the iteration, which needs five to ten steps, with outliers up to fifty.
const MAX_ITERATIONS: usize = 300;

/// Convergence limit for the change of every unknown, m (of the scale: relative).
const STEP_M: f64 = 1e-12;

/// The shared unknowns (all except the points): w (N), then free x and y (2N - 3 or none), scale (1 or none),
/// offsets (N or none).
#[derive(Clone, Copy)]
pub(super) struct Layout {
    pub(super) n: usize,
    pub(super) xy: bool,
    pub(super) scale: bool,
    pub(super) offsets: bool,
}

impl Layout {
    pub(super) fn free_xy(&self) -> usize {
        if self.xy { 2 * self.n - 3 } else { 0 }
    }
    pub(super) fn count(&self) -> usize {
        self.n + self.free_xy() + usize::from(self.scale) + if self.offsets { self.n } else { 0 }
    }
    pub(super) fn xy(&self, anchor: usize, axis: usize) -> Option<usize> {
        if self.xy { free_index(anchor, axis).map(|k| self.n + k) } else { None }
    }
    pub(super) fn scale(&self) -> Option<usize> {
        self.scale.then(|| self.n + self.free_xy())
    }
    pub(super) fn offset(&self, cable: usize) -> Option<usize> {
        self.offsets.then(|| self.n + self.free_xy() + usize::from(self.scale) + cable)
    }
}

#[derive(Clone)]
pub(super) struct State {
    pub(super) w: Vec<f64>,
    pub(super) xy: Vec<[f64; 2]>,
    pub(super) scale: f64,
    pub(super) offsets: Vec<f64>,
    pub(super) points: Vec<[f64; 2]>,
}

impl State {
    /// Distance of anchor i from point j; NaN if the squared height makes it impossible.
    pub(super) fn distance(&self, i: usize, j: usize) -> f64 {
        let (dx, dy) = (self.xy[i][0] - self.points[j][0], self.xy[i][1] - self.points[j][1]);
        (dx * dx + dy * dy + self.w[i]).sqrt()
    }

    pub(super) fn stepped(&self, layout: &Layout, step: &Step) -> Self {
        let mut next = self.clone();
        for i in 0..layout.n {
            next.w[i] += step.shared[i];
            for k in 0..2 {
                if let Some(p) = layout.xy(i, k) {
                    next.xy[i][k] += step.shared[p];
                }
            }
            if let Some(p) = layout.offset(i) {
                next.offsets[i] += step.shared[p];
            }
        }
        if let Some(p) = layout.scale() {
            next.scale += step.shared[p];
        }
        for (c, s) in next.points.iter_mut().zip(&step.points) {
            c[0] += s[0];
            c[1] += s[1];
        }
        next
    }
}

pub(super) struct Step {
    pub(super) shared: DVector<f64>,
    pub(super) points: Vec<[f64; 2]>,
}

impl Step {
    /// The largest change of an unknown; squared heights count as the change of a height of 3 m.
    pub(super) fn size(&self) -> f64 {
        self.points.iter().flatten().fold(self.shared.amax(), |m, v| m.max(v.abs()))
    }
}

/// The normal equations, with the points in separate blocks.
pub(super) struct Normal {
    pub(super) h: DMatrix<f64>,
    pub(super) g: DVector<f64>,
    pub(super) points: Vec<PointBlock>,
}

/// The normal equations of the shared unknowns, and the inverse (xx, xy, yy) of every point's block.
pub(super) struct Reduced {
    pub(super) h: DMatrix<f64>,
    pub(super) g: DVector<f64>,
    pub(super) inverses: Vec<[f64; 3]>,
}

pub(super) struct PointBlock {
    /// Columns of the coupling of every shared unknown with x and y of the point.
    pub(super) coupling: DMatrix<f64>,
    pub(super) xx: f64,
    pub(super) xy: f64,
    pub(super) yy: f64,
    pub(super) g: [f64; 2],
}

pub(super) struct Problem<'a> {
    pub(super) input: JointInput<'a>,
    pub(super) layout: Layout,
}

impl Problem<'_> {
    /// Half the sum of losses; NaN if the state is impossible.
    pub(super) fn cost(&self, s: &State, loss: Loss) -> f64 {
        let mut cost = 0.0;
        for (j, point) in self.input.lengths_m.iter().enumerate() {
            for (i, l) in point.iter().enumerate() {
                let r = (s.scale * s.distance(i, j) + s.offsets[i] - l) / self.input.sigma_length_m;
                cost += loss.evaluate(r).0;
            }
        }
        self.for_each_squared_term(s, |r, _| cost += 0.5 * r * r);
        cost
    }

    /// Calls back with the residual and the derivatives with respect to shared unknowns of all terms
    /// with a squared loss.
    pub(super) fn for_each_squared_term(&self, s: &State, mut each: impl FnMut(f64, &[(usize, f64)])) {
        let layout = &self.layout;
        for r in self.input.ranges {
            let (a, b) = (s.xy[r.from], s.xy[r.to]);
            let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
            let d = (dx * dx + dy * dy).sqrt();
            let u = [dx / d / r.sigma_m, dy / d / r.sigma_m];
            let mut row = [(0, 0.0); 4];
            let mut len = 0;
            for (i, k, v) in [(r.from, 0, u[0]), (r.from, 1, u[1]), (r.to, 0, -u[0]), (r.to, 1, -u[1])] {
                if let Some(p) = layout.xy(i, k) {
                    row[len] = (p, v);
                    len += 1;
                }
            }
            each((d - r.m) / r.sigma_m, &row[..len]);
        }
        for h in self.input.heights {
            let z = s.w[h.anchor].max(LEAST_SQUARED_HEIGHT_M2).sqrt();
            let (scale, offset) = if h.by_line { (s.scale, s.offsets[h.anchor]) } else { (1.0, 0.0) };
            let mut row = [(h.anchor, scale * 0.5 / z / h.sigma_m); 3];
            let mut len = 1;
            if h.by_line {
                for (p, v) in [(layout.scale(), z / h.sigma_m), (layout.offset(h.anchor), 1.0 / h.sigma_m)] {
                    if let Some(p) = p {
                        row[len] = (p, v);
                        len += 1;
                    }
                }
            }
            each((scale * z + offset - h.m) / h.sigma_m, &row[..len]);
        }
        if let (Some(p), Some(sigma)) = (layout.scale(), self.input.sigma_scale) {
            each((s.scale - 1.0) / sigma, &[(p, 1.0 / sigma)]);
        }
        if let Some(sigma) = self.input.sigma_offset_m {
            for i in 0..layout.n {
                if let Some(p) = layout.offset(i) {
                    each(s.offsets[i] / sigma, &[(p, 1.0 / sigma)]);
                }
            }
        }
    }

    pub(super) fn linearise(&self, s: &State, loss: Loss) -> Normal {
        let count = self.layout.count();
        let (mut h, mut g) = (DMatrix::zeros(count, count), DVector::zeros(count));
        let sigma = self.input.sigma_length_m;
        let mut points = Vec::with_capacity(self.input.lengths_m.len());
        for (j, point) in self.input.lengths_m.iter().enumerate() {
            let mut block = PointBlock { coupling: DMatrix::zeros(count, 2), xx: 0.0, xy: 0.0, yy: 0.0, g: [0.0; 2] };
            for (i, l) in point.iter().enumerate() {
                // For a point exactly at an anchor of height zero, any direction is valid.
                let d = s.distance(i, j).max(1e-9);
                let r = (s.scale * d + s.offsets[i] - l) / sigma;
                let w = loss.evaluate(r).1;
                let gain = s.scale / (d * sigma);
                let (ux, uy) = (gain * (s.xy[i][0] - s.points[j][0]), gain * (s.xy[i][1] - s.points[j][1]));
                let mut row = [(i, 0.5 * gain); 5];
                let mut len = 1;
                for (p, v) in [
                    (self.layout.xy(i, 0), ux),
                    (self.layout.xy(i, 1), uy),
                    (self.layout.scale(), d / sigma),
                    (self.layout.offset(i), 1.0 / sigma),
                ] {
                    if let Some(p) = p {
                        row[len] = (p, v);
                        len += 1;
                    }
                }
                for (p, v) in &row[..len] {
                    g[*p] += w * v * r;
                    for (q, u) in &row[..len] {
                        h[(*p, *q)] += w * v * u;
                    }
                    block.coupling[(*p, 0)] -= w * v * ux;
                    block.coupling[(*p, 1)] -= w * v * uy;
                }
                block.xx += w * ux * ux;
                block.xy += w * ux * uy;
                block.yy += w * uy * uy;
                block.g[0] -= w * ux * r;
                block.g[1] -= w * uy * r;
            }
            points.push(block);
        }
        self.for_each_squared_term(s, |r, row| {
            for (p, v) in row {
                g[*p] += v * r;
                for (q, u) in row {
                    h[(*p, *q)] += v * u;
                }
            }
        });
        Normal { h, g, points }
    }
}

impl Normal {
    /// Schur complement of the points, with a share of the diagonal added; None if a block or the rest
    /// is rank-deficient.
    pub(super) fn reduce(&self, damping: f64) -> Option<Reduced> {
        let (mut h, mut g) = (self.h.clone(), self.g.clone());
        for k in 0..h.nrows() {
            h[(k, k)] *= 1.0 + damping;
        }
        let mut inverses = Vec::with_capacity(self.points.len());
        for b in &self.points {
            let (xx, yy) = (b.xx * (1.0 + damping), b.yy * (1.0 + damping));
            let det = xx * yy - b.xy * b.xy;
            if !(det > 1e-14 * xx * yy) {
                return None;
            }
            let inverse = [yy / det, -b.xy / det, xx / det];
            for p in 0..h.nrows() {
                let (cx, cy) = (b.coupling[(p, 0)], b.coupling[(p, 1)]);
                if cx == 0.0 && cy == 0.0 {
                    continue;
                }
                let (tx, ty) = (cx * inverse[0] + cy * inverse[1], cx * inverse[1] + cy * inverse[2]);
                g[p] -= tx * b.g[0] + ty * b.g[1];
                for q in 0..h.nrows() {
                    h[(p, q)] -= tx * b.coupling[(q, 0)] + ty * b.coupling[(q, 1)];
                }
            }
            inverses.push(inverse);
        }
        Some(Reduced { h, g, inverses })
    }

    pub(super) fn step(&self, damping: f64) -> Option<Step> {
        let Reduced { h, g, inverses } = self.reduce(damping)?;
        let shared = -h.cholesky()?.solve(&g);
        let points = self
            .points
            .iter()
            .zip(inverses)
            .map(|(b, inverse)| {
                let pull = b.coupling.tr_mul(&shared);
                let (gx, gy) = (-b.g[0] - pull[0], -b.g[1] - pull[1]);
                [inverse[0] * gx + inverse[1] * gy, inverse[1] * gx + inverse[2] * gy]
            })
            .collect();
        Some(Step { shared, points })
    }
}

/// Levenberg-Marquardt with the weights of the loss.
pub(super) fn descend(problem: &Problem, start: State, loss: Loss) -> Result<State, CalibrationError> {
    let mut state = start;
    let mut cost = problem.cost(&state, loss);
    let mut damping = 1e-4;
    for _ in 0..MAX_ITERATIONS {
        let normal = problem.linearise(&state, loss);
        // Increase the damping until the step reduces the cost or becomes negligible.
        let mut stuck = true;
        while damping < 1e12 {
            let Some(step) = normal.step(damping) else {
                damping = (damping * 10.0).max(1e-9);
                continue;
            };
            let size = step.size();
            let next = state.stepped(&problem.layout, &step);
            let next_cost = problem.cost(&next, loss);
            // Near the minimum, rounding hides the decrease of the cost: accept nearly undamped steps.
            let rounding = damping < 1e-8 && size < 1e-6;
            if next_cost <= cost || (rounding && next_cost.is_finite()) {
                (state, cost) = (next, next_cost);
                damping = (damping * 0.1).max(1e-15);
                stuck = false;
                if size < STEP_M {
                    return Ok(state);
                }
                break;
            }
            if size < STEP_M {
                return Ok(state);
            }
            damping = (damping * 10.0).max(1e-9);
        }
        if stuck {
            return Err(undetermined_state(&state));
        }
    }
    Ok(state)
}

/// Inverse by Cholesky after scaling the diagonal to one; None if the matrix is singular up to rounding.
pub(super) fn inverse(h: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = h.nrows();
    let mut root = [0.0; 4 * MAX_CABLES];
    for k in 0..n {
        // Also false for NaN.
        if !(h[(k, k)] > 0.0) {
            return None;
        }
        root[k] = h[(k, k)].sqrt();
    }
    let scaled = DMatrix::from_fn(n, n, |p, q| h[(p, q)] / (root[p] * root[q]));
    let inverse = scaled.cholesky()?.inverse();
    // The diagonal is the loss of precision by correlation: beyond this, none of sixteen digits remain.
    if inverse.diagonal().iter().any(|v| !(*v < 1e13)) {
        return None;
    }
    Some(DMatrix::from_fn(n, n, |p, q| inverse[(p, q)] / (root[p] * root[q])))
}

/// Error for data that do not determine an unknown, with the likely reason.
pub(super) fn undetermined_state(state: &State) -> CalibrationError {
    CalibrationError::RankDeficient(if heights::is_flat(&state.points) {
        let [along_m, across_m] = heights::spread(&state.points);
        Undetermined::OpenNearALine { across_m, along_m }
    } else {
        Undetermined::Open
    })
}
