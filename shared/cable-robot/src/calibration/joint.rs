//! Everything at once: heights, x and y, points, the scale of the lengths and the zeros of the encoders by maximum
//! likelihood, with a loss that outliers do not pull.
//!
//! Measured length of cable i at point j: `k sqrt(|a_i - c_j|² + w_i) + o_i` with k near 1 and o_i near 0. The squared height w_i is the
//! unknown, not z_i: the model is smooth through zero, and an optimum below zero shows itself instead of sticking there.
//! The points enter two unknowns each and are eliminated (Schur complement), so a thousand of them cost a thousand small
//! solutions, not a large one.
//!
//! Lengths and heights in m, standard deviations in the unit of what they belong to, the scale without one. Data that leave something
//! undetermined are a [`CalibrationError`].

use nalgebra::{DMatrix, DVector};

use super::covariance::AnchorCovariance;
use super::error::{CalibrationError, check_sigma, invalid};
use super::heights::{self, Frame, check_lengths, closed_form};
use super::survey::{Range, check_anchors, check_ranges, free_index, to_gauge};
use crate::{CableVec, MAX_CABLES};

/// Bound of the iteration; it needs five to ten steps, with outliers up to fifty.
const MAX_ITERATIONS: usize = 300;

/// Converged when no unknown moves by more, m (the scale: by this share).
const STEP_M: f64 = 1e-12;

/// Least squared height that a measured height is compared with, m²: its square root has no derivative at zero.
const LEAST_SQUARED_HEIGHT_M2: f64 = 1e-6;

/// Huber's and Cauchy's constants for 95 % efficiency with normal errors, in standard deviations (Zhang, "Parameter
/// estimation techniques", 1997).
const HUBER: f64 = 1.345;
const CAUCHY: f64 = 2.3849;

/// A length with less weight than this is an outlier that says nothing about the scatter of the others.
const LEAST_WEIGHT: f64 = 0.1;

/// How much a length that does not fit counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Loss {
    /// By its square: best if all errors are normal.
    #[default]
    Squared,
    /// By its square up to 1.345 standard deviations, linearly beyond.
    Huber,
    /// Logarithmically beyond 2.385 standard deviations: a gross outlier counts almost nothing.
    Cauchy,
}

impl Loss {
    /// rho(r) and the weight rho'(r) / r, for half squares: rho = r²/2 near zero. r in standard deviations.
    fn at(self, r: f64) -> (f64, f64) {
        match self {
            Self::Squared => (0.5 * r * r, 1.0),
            Self::Huber if r.abs() <= HUBER => (0.5 * r * r, 1.0),
            Self::Huber => (HUBER * (r.abs() - 0.5 * HUBER), HUBER / r.abs()),
            Self::Cauchy => {
                let t = r / CAUCHY;
                (0.5 * CAUCHY * CAUCHY * libm::log1p(t * t), 1.0 / (1.0 + t * t))
            }
        }
    }
}

/// A height measured directly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectHeight {
    /// The anchor, counted from 0.
    pub anchor: usize,
    /// Its height above the plane of the points, m.
    pub m: f64,
    /// Standard deviation, m.
    pub sigma_m: f64,
    /// Measured with the line itself, released until it touches the floor: then it has the scale and the zero of that
    /// line. Otherwise by laser or tape.
    pub by_line: bool,
}

/// What [`calibrate_joint`] takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointInput<'a> {
    /// x and y of the anchors, m: fixed without ranges, a first guess with them.
    pub anchors_xy_m: &'a [[f64; 2]],
    /// Lengths, one set per point, m.
    pub lengths_m: &'a [CableVec],
    /// Standard deviation of a length, m.
    pub sigma_length_m: f64,
    /// Ranges between plumb lines; with any of them x and y are estimated too, anchor 1 at the origin and anchor 2 on the
    /// x axis.
    pub ranges: &'a [Range],
    /// Heights measured directly.
    pub heights: &'a [DirectHeight],
    /// Standard deviation of the scale about 1; None for a scale of exactly 1.
    pub sigma_scale: Option<f64>,
    /// Standard deviation of the encoder zeros about 0, m; None for zeros of exactly 0.
    pub sigma_offset_m: Option<f64>,
    /// The loss of the lengths. Ranges, heights and priors count by their squares.
    pub loss: Loss,
}

impl<'a> JointInput<'a> {
    /// Lengths alone: x and y fixed, no scale, no zeros, squared loss.
    pub fn new(anchors_xy_m: &'a [[f64; 2]], lengths_m: &'a [CableVec], sigma_length_m: f64) -> Self {
        Self {
            anchors_xy_m,
            lengths_m,
            sigma_length_m,
            ranges: &[],
            heights: &[],
            sigma_scale: None,
            sigma_offset_m: None,
            loss: Loss::Squared,
        }
    }
}

/// What comes out.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Anchors, m.
    pub anchors_m: Vec<[f64; 3]>,
    /// x and y of every point, m.
    pub points_xy_m: Vec<[f64; 2]>,
    /// Measured over true length.
    pub scale: f64,
    /// Its standard deviation; 0 if it is not estimated.
    pub scale_std: f64,
    /// Measured length at true length zero, by cable, m.
    pub offsets_m: CableVec,
    /// Their standard deviations, m; 0 if they are not estimated.
    pub offset_std_m: CableVec,
    /// Covariance of the anchors.
    pub covariance: AnchorCovariance,
    /// Measured less modelled length, one set per point, m.
    pub residuals_m: Vec<CableVec>,
    /// Sum over all measurements and priors of squared residuals in standard deviations, without the lengths that a robust
    /// loss has all but dropped.
    pub chi_squared: f64,
    /// As many measurements less the unknowns; a prior counts as a measurement. Below zero where outliers leave less than
    /// is needed.
    pub degrees_of_freedom: f64,
}

/// The unknowns besides the points: w (N), then free x and y (2N - 3 or none), scale (1 or none), offsets (N or none).
#[derive(Clone, Copy)]
struct Layout {
    n: usize,
    xy: bool,
    scale: bool,
    offsets: bool,
}

impl Layout {
    fn free_xy(&self) -> usize {
        if self.xy { 2 * self.n - 3 } else { 0 }
    }
    fn count(&self) -> usize {
        self.n + self.free_xy() + usize::from(self.scale) + if self.offsets { self.n } else { 0 }
    }
    fn xy(&self, anchor: usize, axis: usize) -> Option<usize> {
        if self.xy { free_index(anchor, axis).map(|k| self.n + k) } else { None }
    }
    fn scale(&self) -> Option<usize> {
        self.scale.then(|| self.n + self.free_xy())
    }
    fn offset(&self, cable: usize) -> Option<usize> {
        self.offsets.then(|| self.n + self.free_xy() + usize::from(self.scale) + cable)
    }
}

#[derive(Clone)]
struct State {
    w: Vec<f64>,
    xy: Vec<[f64; 2]>,
    scale: f64,
    offsets: Vec<f64>,
    points: Vec<[f64; 2]>,
}

impl State {
    /// Straight distance of anchor i from point j; NaN where the squared height makes it impossible.
    fn distance(&self, i: usize, j: usize) -> f64 {
        let (dx, dy) = (self.xy[i][0] - self.points[j][0], self.xy[i][1] - self.points[j][1]);
        (dx * dx + dy * dy + self.w[i]).sqrt()
    }

    fn stepped(&self, layout: &Layout, step: &Step) -> Self {
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

struct Step {
    shared: DVector<f64>,
    points: Vec<[f64; 2]>,
}

impl Step {
    /// The largest move of an unknown, squared heights as heights of 3 m would move.
    fn size(&self) -> f64 {
        self.points.iter().flatten().fold(self.shared.amax(), |m, v| m.max(v.abs()))
    }
}

/// The normal equations, points kept apart.
struct Normal {
    h: DMatrix<f64>,
    g: DVector<f64>,
    points: Vec<PointBlock>,
}

/// The shared unknowns alone, and the inverse (xx, xy, yy) of every point's own block.
struct Reduced {
    h: DMatrix<f64>,
    g: DVector<f64>,
    inverses: Vec<[f64; 3]>,
}

struct PointBlock {
    /// Columns of the coupling of every shared unknown with x and y of the point.
    coupling: DMatrix<f64>,
    xx: f64,
    xy: f64,
    yy: f64,
    g: [f64; 2],
}

struct Problem<'a> {
    input: JointInput<'a>,
    layout: Layout,
}

impl Problem<'_> {
    /// Half the sum of losses; NaN where the state is impossible.
    fn cost(&self, s: &State, loss: Loss) -> f64 {
        let mut cost = 0.0;
        for (j, point) in self.input.lengths_m.iter().enumerate() {
            for (i, l) in point.iter().enumerate() {
                let r = (s.scale * s.distance(i, j) + s.offsets[i] - l) / self.input.sigma_length_m;
                cost += loss.at(r).0;
            }
        }
        self.squares(s, |r, _| cost += 0.5 * r * r);
        cost
    }

    /// Calls back with the residual and the derivatives by shared unknowns of all that counts by its square.
    fn squares(&self, s: &State, mut each: impl FnMut(f64, &[(usize, f64)])) {
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

    fn linearise(&self, s: &State, loss: Loss) -> Normal {
        let count = self.layout.count();
        let (mut h, mut g) = (DMatrix::zeros(count, count), DVector::zeros(count));
        let sigma = self.input.sigma_length_m;
        let mut points = Vec::with_capacity(self.input.lengths_m.len());
        for (j, point) in self.input.lengths_m.iter().enumerate() {
            let mut block = PointBlock { coupling: DMatrix::zeros(count, 2), xx: 0.0, xy: 0.0, yy: 0.0, g: [0.0; 2] };
            for (i, l) in point.iter().enumerate() {
                // A point right at an anchor of height zero: any direction will do.
                let d = s.distance(i, j).max(1e-9);
                let r = (s.scale * d + s.offsets[i] - l) / sigma;
                let w = loss.at(r).1;
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
        self.squares(s, |r, row| {
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
    /// Schur complement of the points, with a share of the diagonal added; None where a point or the rest has no rank.
    fn reduce(&self, damping: f64) -> Option<Reduced> {
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

    fn step(&self, damping: f64) -> Option<Step> {
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

/// Estimates everything at once. Without `ranges` x and y stay as given; with them the frame becomes anchor 1 at the
/// origin and anchor 2 on the x axis.
///
/// Starts from the closed form, so it needs no guess; with a robust loss first by squares, then Huber's, then Cauchy's, so
/// that the minimum found is the one near the bulk of the data.
///
/// # Errors
/// `invalid_argument`; `degenerate_geometry` for anchors on one line; `rank_deficient` for fewer than three points (unless heights
/// are measured), points on one line, and whatever else leaves an unknown open; `no_real_height` where the optimum has a
/// negative squared height.
///
/// ```
/// use cable_robot::CableVec;
/// use cable_robot::calibration::{JointInput, calibrate_joint};
/// let anchors = [[0.0, 0.0], [8.0, 0.0], [4.0, 6.0]];
/// // Lines that read 1 % too long.
/// let lengths: Vec<_> = [[1.0, 1.0], [7.0, 1.0], [4.0, 5.0], [4.0, 3.0], [2.0, 2.0], [6.0, 2.0]]
///     .iter()
///     .map(|c: &[f64; 2]| {
///         CableVec::from_fn(3, |i| {
///             let (dx, dy) = (anchors[i][0] - c[0], anchors[i][1] - c[1]);
///             1.01 * (dx * dx + dy * dy + 9.0f64).sqrt()
///         })
///     })
///     .collect();
/// let input = JointInput { sigma_scale: Some(0.02), ..JointInput::new(&anchors, &lengths, 0.0005) };
/// let found = calibrate_joint(&input)?;
/// assert!((found.scale - 1.01).abs() < 1e-3);
/// assert!((found.anchors_m[0][2] - 3.0).abs() < 0.01);
/// # Ok::<(), cable_robot::calibration::CalibrationError>(())
/// ```
pub fn calibrate_joint(input: &JointInput) -> Result<Joint, CalibrationError> {
    check(input)?;
    let (n, m) = (input.anchors_xy_m.len(), input.lengths_m.len());
    let layout = Layout {
        n,
        xy: !input.ranges.is_empty(),
        scale: input.sigma_scale.is_some(),
        offsets: input.sigma_offset_m.is_some(),
    };
    let problem = Problem { input: *input, layout };
    let mut state = start(input, layout.xy)?;
    let losses: &[Loss] = match input.loss {
        Loss::Squared => &[Loss::Squared],
        Loss::Huber => &[Loss::Squared, Loss::Huber],
        Loss::Cauchy => &[Loss::Squared, Loss::Huber, Loss::Cauchy],
    };
    for loss in losses {
        state = descend(&problem, state, *loss)?;
    }
    let normal = problem.linearise(&state, input.loss);
    let inverse = normal.reduce(0.0).and_then(|r| inverse(&r.h)).ok_or_else(|| open(&state))?;
    // Data that leave a height open rather than contradict it.
    if (0..n).any(|i| heights::is_open(state.w[i], inverse[(i, i)].max(0.0).sqrt())) {
        return Err(open(&state));
    }
    if let Some((i, w)) = state.w.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).filter(|(_, w)| **w < 0.0) {
        return Err(CalibrationError::NoRealHeight { anchor: i + 1, squared_height_m2: *w });
    }
    let covariance = anchor_covariance(&layout, &state, &inverse);
    let std = |p: Option<usize>| p.map_or(0.0, |p| inverse[(p, p)].max(0.0).sqrt());
    let residuals_m: Vec<_> = (0..m)
        .map(|j| {
            let measured = &input.lengths_m[j];
            CableVec::from_fn(n, |i| measured[i] - state.scale * state.distance(i, j) - state.offsets[i])
        })
        .collect();
    let (mut chi_squared, mut equations) = (0.0, 0.0);
    for r in residuals_m.iter().flat_map(|r| r.iter()).map(|r| r / input.sigma_length_m) {
        if input.loss.at(r).1 >= LEAST_WEIGHT {
            chi_squared += r * r;
            equations += 1.0;
        }
    }
    problem.squares(&state, |r, _| {
        chi_squared += r * r;
        equations += 1.0;
    });
    Ok(Joint {
        anchors_m: state.xy.iter().zip(&state.w).map(|(a, w)| [a[0], a[1], w.sqrt()]).collect(),
        points_xy_m: state.points.clone(),
        scale: state.scale,
        scale_std: std(layout.scale()),
        offsets_m: CableVec::from_fn(n, |i| state.offsets[i]),
        offset_std_m: CableVec::from_fn(n, |i| std(layout.offset(i))),
        covariance,
        residuals_m,
        chi_squared,
        degrees_of_freedom: equations - (layout.count() + 2 * m) as f64,
    })
}

fn check(input: &JointInput) -> Result<(), CalibrationError> {
    check_anchors(input.anchors_xy_m)?;
    let n = input.anchors_xy_m.len();
    check_lengths(n, input.lengths_m)?;
    check_sigma("the standard deviation of the lengths", input.sigma_length_m)?;
    check_ranges(n, input.ranges)?;
    for h in input.heights {
        if h.anchor >= n {
            return invalid(format!("a height is given for anchor {}; there are {n}", h.anchor + 1));
        }
        if !(h.m.is_finite() && h.m > 0.0) {
            return invalid(format!("the height of anchor {} is {} m; give a height above 0", h.anchor + 1, h.m));
        }
        check_sigma(&format!("the standard deviation of the height of anchor {}", h.anchor + 1), h.sigma_m)?;
    }
    if let Some(sigma) = input.sigma_scale {
        check_sigma("the standard deviation of the scale", sigma)?;
    }
    if let Some(sigma) = input.sigma_offset_m {
        check_sigma("the standard deviation of the encoder zeros", sigma)?;
    }
    // Heights measured directly can stand in for points.
    if input.heights.is_empty() && input.lengths_m.len() < 3 {
        return Err(heights::too_few(input.lengths_m.len()));
    }
    Ok(())
}

/// Heights from the closed form where the points determine them, else from what was measured directly.
fn start(input: &JointInput, to_frame: bool) -> Result<State, CalibrationError> {
    let n = input.anchors_xy_m.len();
    let xy = if to_frame { to_gauge(input.anchors_xy_m) } else { input.anchors_xy_m.to_vec() };
    let mut w = match closed_form(&xy, input.lengths_m) {
        Ok(found) => {
            if input.heights.is_empty() {
                heights::check_spread(&xy, input.lengths_m, &found.points_xy_m, input.sigma_length_m)?;
            }
            let shortest = input.lengths_m.iter().flat_map(|p| p.iter()).fold(f64::INFINITY, |a: f64, l| a.min(*l));
            // Not below a tenth of the shortest line: outliers and zeros can throw the closed form out.
            found.squared_heights_m2.iter().map(|w| w.max(0.01 * shortest * shortest)).collect()
        }
        Err(error @ CalibrationError::RankDeficient(_)) if input.heights.is_empty() => return Err(error),
        Err(CalibrationError::RankDeficient(_)) => {
            let mean = input.heights.iter().map(|h| h.m).sum::<f64>() / input.heights.len() as f64;
            vec![mean * mean; n]
        }
        Err(error) => return Err(error),
    };
    for h in input.heights {
        w[h.anchor] = h.m * h.m;
    }
    let frame = Frame::new(&xy);
    let points = input.lengths_m.iter().map(|l| frame.point(l, &w)).collect();
    Ok(State { w, xy, scale: 1.0, offsets: vec![0.0; n], points })
}

/// Levenberg-Marquardt with the weights of the loss.
fn descend(problem: &Problem, start: State, loss: Loss) -> Result<State, CalibrationError> {
    let mut state = start;
    let mut cost = problem.cost(&state, loss);
    let mut damping = 1e-4;
    for _ in 0..MAX_ITERATIONS {
        let normal = problem.linearise(&state, loss);
        // More damping until the step helps or becomes too small to matter.
        let mut stuck = true;
        while damping < 1e12 {
            let Some(step) = normal.step(damping) else {
                damping = (damping * 10.0).max(1e-9);
                continue;
            };
            let size = step.size();
            let next = state.stepped(&problem.layout, &step);
            let next_cost = problem.cost(&next, loss);
            // Close to the end the cost drowns in its own rounding; a step of nearly no damping is then trusted.
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
            return Err(open(&state));
        }
    }
    Ok(state)
}

/// The refusal of data that leave an unknown open, with the likely reason.
fn open(state: &State) -> CalibrationError {
    CalibrationError::RankDeficient(if heights::is_flat(&state.points) {
        let [along, across] = heights::spread(&state.points);
        format!(
            "the points lie on one line or nearly so ({across:.3} m to its sides, {along:.3} m along it, root mean square), \
             which leaves the anchors undetermined; add points to both sides of that line"
        )
    } else {
        "the measurements leave an unknown open; add points, ranges between anchors or directly measured heights, or do \
         not estimate scale and zeros"
            .to_owned()
    })
}

/// Inverse by Cholesky after scaling the diagonal to one; None where the matrix is singular to rounding.
fn inverse(h: &DMatrix<f64>) -> Option<DMatrix<f64>> {
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
    // The diagonal is the loss of digits by correlation: beyond this nothing is left of sixteen.
    if inverse.diagonal().iter().any(|v| !(*v < 1e13)) {
        return None;
    }
    Some(DMatrix::from_fn(n, n, |p, q| inverse[(p, q)] / (root[p] * root[q])))
}

fn anchor_covariance(layout: &Layout, state: &State, inverse: &DMatrix<f64>) -> AnchorCovariance {
    let n = layout.n;
    // Which unknown a coordinate is, and its derivative by that unknown.
    let of = |k: usize| match (k / 3, k % 3) {
        (i, 2) => Some((i, 0.5 / state.w[i].sqrt())),
        (i, axis) => layout.xy(i, axis).map(|p| (p, 1.0)),
    };
    AnchorCovariance::new(DMatrix::from_fn(3 * n, 3 * n, |a, b| match (of(a), of(b)) {
        (Some((p, dp)), Some((q, dq))) => inverse[(p, q)] * dp * dq,
        _ => 0.0,
    }))
}
