//! Heights of the anchors from lengths to points of the reference plane: (3)-(5) in closed form, for
//! any number of cables.
//!
//! With `w_i = z_i²` the squared lengths are `L_ij² = |a_i - c_j|² + w_i`. The linear least-squares estimate of a
//! point c_j for given heights is `alpha_j + e`, where alpha_j depends only on the lengths, and the shift e is common
//! to all points and linear in w. The remaining part of (4) is the square of `beta_j - 2 alpha_j.e - v`, a regression
//! with three unknowns (e, v), and a part that w satisfies exactly. The minimum of (4) therefore needs no search, and
//! it is the global one.
//!
//! The cost is even in every z_i, so lengths do not distinguish anchors above the plane from anchors below it: all are
//! assumed to be above.
//!
//! N anchors as [x, y], lengths as M sets of N, all in m; squared heights in m², the cost in m⁴. Lengths that do not
//! determine the heights are a [`CalibrationError`].

use nalgebra::{Matrix3, Vector3};

use super::Undetermined;
use super::error::{CalibrationError, invalid, undetermined};
use super::survey::{check_anchors, flatness};
use cable_robot::{CableVec, MAX_CABLES};

/// Points are on one line if their spread across it is below this share of the spread along it. With exact lengths
/// rounding leaves 1e-13; a point 10 µm beside a line of 10 m adds no measurable information.
const COLLINEAR_SHARE: f64 = 1e-6;

/// A negative squared height counts as zero up to this share of the squared longest length: rounding.
const ROUNDING_SHARE: f64 = 1e-12;

/// Bound of the refinement of a point, which needs about five steps.
const MAX_POINT_ITERATIONS: usize = 30;

/// Smallest ratio of the variance of the points across their line to the variance caused by noise. At four, a quarter
/// of it is noise, and the heights have an error of a quarter of the tilt.
const LEAST_SIGNAL: f64 = 4.0;

/// Best accuracy of a length from an encoder, m: a step of the encoder, and the winding of the cable on its drum.
const BEST_SIGMA_M: f64 = 1e-3;

/// The global minimum of (4)-(5) without checks: squared heights may be negative.
#[derive(Debug, Clone, PartialEq)]
pub struct ClosedForm {
    /// w_i = z_i² of every anchor, m².
    pub squared_heights_m2: CableVec,
    /// x and y of every point, m.
    pub points_xy_m: Vec<[f64; 2]>,
    /// The value of (4), m⁴.
    pub cost_m4: f64,
    /// dw_i / dL_kj, m: for every anchor i, a row of cables k per point j.
    sensitivity: Option<Vec<Vec<CableVec>>>,
}

impl ClosedForm {
    /// The heights, m.
    ///
    /// # Errors
    /// `no_real_height` if a squared height is negative.
    pub fn heights_m(&self) -> Result<CableVec, CalibrationError> {
        let lowest = self.squared_heights_m2.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
        match lowest {
            Some((i, w)) if *w < 0.0 => Err(CalibrationError::NoRealHeight { anchor: i + 1, squared_height_m2: *w }),
            _ => Ok(self.squared_heights_m2.map(f64::sqrt)),
        }
    }

    /// dw_i/dL_kj in m, indexed by anchor i, point j, cable k.
    pub(super) fn sensitivity(&self) -> &[Vec<CableVec>] {
        self.sensitivity.as_deref().unwrap_or(&[])
    }

    /// Covariance of two squared heights for independent errors of the lengths with this standard deviation, m⁴.
    pub(super) fn covariance(&self, i: usize, j: usize, sigma_length_m: f64) -> f64 {
        let s = self.sensitivity();
        let product: f64 =
            s[i].iter().flat_map(|r| r.iter()).zip(s[j].iter().flat_map(|r| r.iter())).map(|(a, b)| a * b).sum();
        product * sigma_length_m * sigma_length_m
    }
}

/// Heights of the anchors, above the plane of the points.
#[derive(Debug, Clone, PartialEq)]
pub struct Heights {
    /// Height of every anchor, m.
    pub heights_m: CableVec,
    /// x and y of every point, m.
    pub points_xy_m: Vec<[f64; 2]>,
    /// The value of (4), m⁴.
    pub cost_m4: f64,
}

/// Converts lengths by cable to lengths by point: `rows[i][j]` is cable i at point j, m.
///
/// # Errors
/// `invalid_argument` for rows of different lengths or more than [`MAX_CABLES`] of them.
pub fn points_from_rows(rows: &[impl AsRef<[f64]>]) -> Result<Vec<CableVec>, CalibrationError> {
    if rows.len() > MAX_CABLES {
        return invalid(format!("lengths of {} cables are given; a robot has at most {MAX_CABLES}", rows.len()));
    }
    let points = rows.first().map_or(0, |r| r.as_ref().len());
    if let Some(i) = rows.iter().position(|r| r.as_ref().len() != points) {
        return invalid(format!(
            "cable {} has {} lengths and cable 1 has {points}; give one per point",
            i + 1,
            rows[i].as_ref().len()
        ));
    }
    Ok((0..points).map(|j| CableVec::from_fn(rows.len(), |i| rows[i].as_ref()[j])).collect())
}

/// Checks lengths: one per anchor and point, finite, above zero.
pub(super) fn check_lengths(anchors: usize, lengths: &[CableVec]) -> Result<(), CalibrationError> {
    for (j, point) in lengths.iter().enumerate() {
        if point.len() != anchors {
            return invalid(format!(
                "point {} has {} lengths for {anchors} cables; give one per cable",
                j + 1,
                point.len()
            ));
        }
        if let Some(i) = point.iter().position(|l| !(0.0..=cable_robot::kinematics::LONGEST_M).contains(l)) {
            return invalid(format!(
                "the length of cable {} at point {} is {}; give a finite length in metres",
                i + 1,
                j + 1,
                point[i]
            ));
        }
    }
    Ok(())
}

pub(super) fn too_few(points: usize) -> CalibrationError {
    CalibrationError::RankDeficient(Undetermined::FewPoints { points })
}

/// Computes the minimum of (4) with the data for checks; [`calibrate_heights`] also checks it.
///
/// `anchors_xy_m` in any frame, `lengths_m` one set per point.
///
/// # Errors
/// `invalid_argument`, `degenerate_geometry` for anchors on one line, `rank_deficient` for fewer than three points and
/// points on one line.
pub fn closed_form(anchors_xy_m: &[[f64; 2]], lengths_m: &[CableVec]) -> Result<ClosedForm, CalibrationError> {
    solve(anchors_xy_m, lengths_m, false)
}

/// Like [`closed_form`], with the derivatives of the squared heights with respect to every length.
pub(super) fn closed_form_with_sensitivity(
    anchors_xy_m: &[[f64; 2]],
    lengths_m: &[CableVec],
) -> Result<ClosedForm, CalibrationError> {
    solve(anchors_xy_m, lengths_m, true)
}

fn solve(anchors: &[[f64; 2]], lengths: &[CableVec], with_sensitivity: bool) -> Result<ClosedForm, CalibrationError> {
    check_anchors(anchors)?;
    check_lengths(anchors.len(), lengths)?;
    let (n, m) = (anchors.len(), lengths.len());
    if m < 3 {
        return Err(too_few(m));
    }
    let frame = Frame::new(anchors);
    // alpha_j and beta_j, with the mean of the anchors as origin.
    let mut alpha = Vec::with_capacity(m);
    let mut beta = Vec::with_capacity(m);
    let mut mean_ell = [0.0; MAX_CABLES];
    for point in lengths {
        let ell = frame.ell(point);
        let a = frame.alpha(&ell);
        alpha.push(a);
        beta.push(ell.iter().sum::<f64>() / n as f64 - a[0] * a[0] - a[1] * a[1]);
        for (sum, e) in mean_ell.iter_mut().zip(ell.iter()) {
            *sum += e;
        }
    }
    mean_ell.iter_mut().for_each(|sum| *sum /= m as f64);
    if !(flatness(&alpha) > COLLINEAR_SHARE) {
        return undetermined(Undetermined::OnALine);
    }
    let regression = regress(&alpha, &beta);
    let (e, v) = (regression.e, regression.v);
    // w = (v - |e|²) 1 + 2 A e + Q mean(ell); with the origin at the mean of the anchors 2 abar.e is zero.
    let level = v - e[0] * e[0] - e[1] * e[1];
    let off = frame.off_plane(&mean_ell);
    let longest = || lengths.iter().flat_map(|p| p.iter()).fold(0.0, |a: f64, l| a.max(*l));
    let squared_heights_m2 = CableVec::from_fn(n, |i| {
        let w = level + 2.0 * (frame.xy[i][0] * e[0] + frame.xy[i][1] * e[1]) + off[i];
        if w < 0.0 && w > -ROUNDING_SHARE * longest().powi(2) { 0.0 } else { w }
    });
    let mut cost_m4 = 0.0;
    for (j, point) in lengths.iter().enumerate() {
        let a = alpha[j];
        let r = beta[j] - 2.0 * (a[0] * e[0] + a[1] * e[1]) - v;
        cost_m4 += n as f64 * r * r;
        if n > 3 {
            // Q ell - Q mean(ell), with the contribution of this point.
            let mean = beta[j] + a[0] * a[0] + a[1] * a[1];
            for i in 0..n {
                let ([x, y], length) = (frame.xy[i], point[i]);
                let across = length * length - x * x - y * y - mean + 2.0 * (x * a[0] + y * a[1]) - off[i];
                cost_m4 += across * across;
            }
        }
    }
    let points_xy_m = alpha.iter().map(|a| [a[0] + e[0] + frame.mean[0], a[1] + e[1] + frame.mean[1]]).collect();
    let sensitivity = with_sensitivity.then(|| frame.sensitivity(lengths, &alpha, &regression));
    Ok(ClosedForm { squared_heights_m2, points_xy_m, cost_m4, sensitivity })
}

/// The anchors relative to their mean, and the pseudo-inverse K of their matrix.
pub(super) struct Frame {
    n: usize,
    mean: [f64; 2],
    xy: [[f64; 2]; MAX_CABLES],
    k: [[f64; 2]; MAX_CABLES],
}

impl Frame {
    /// Builds the frame of checked anchors: at most [`MAX_CABLES`].
    pub(super) fn new(anchors: &[[f64; 2]]) -> Self {
        let n = anchors.len();
        let mean = anchors.iter().fold([0.0; 2], |m, a| [m[0] + a[0] / n as f64, m[1] + a[1] / n as f64]);
        let mut xy = [[0.0; 2]; MAX_CABLES];
        let (mut xx, mut xy_, mut yy) = (0.0, 0.0, 0.0);
        for (seen, a) in xy.iter_mut().zip(anchors) {
            let [x, y] = [a[0] - mean[0], a[1] - mean[1]];
            *seen = [x, y];
            xx += x * x;
            xy_ += x * y;
            yy += y * y;
        }
        let det = xx * yy - xy_ * xy_;
        let k = xy.map(|[x, y]| [(yy * x - xy_ * y) / det, (xx * y - xy_ * x) / det]);
        Self { n, mean, xy, k }
    }

    /// ell = L² - |a|².
    fn ell(&self, lengths: &CableVec) -> CableVec {
        CableVec::from_fn(self.n, |i| {
            let [x, y] = self.xy[i];
            lengths[i] * lengths[i] - x * x - y * y
        })
    }

    /// -K ell / 2.
    fn alpha(&self, ell: &[f64]) -> [f64; 2] {
        let sum = self.k.iter().zip(ell).fold([0.0; 2], |s, (k, e)| [s[0] + k[0] * e, s[1] + k[1] * e]);
        [-0.5 * sum[0], -0.5 * sum[1]]
    }

    /// Q ell: the part that neither the mean nor a tilt of the anchors explains; zero for three cables.
    fn off_plane(&self, ell: &[f64]) -> [f64; MAX_CABLES] {
        let n = self.n;
        let mut result = [0.0; MAX_CABLES];
        if n == 3 {
            return result;
        }
        let mean = ell[..n].iter().sum::<f64>() / n as f64;
        let tilt = self.alpha(&ell[..n]);
        for i in 0..n {
            result[i] = ell[i] - mean + 2.0 * (self.xy[i][0] * tilt[0] + self.xy[i][1] * tilt[1]);
        }
        result
    }

    /// The linear estimate of a point for given squared heights: `alpha + K w / 2`, m.
    pub(super) fn point(&self, lengths: &CableVec, squared_heights: &[f64]) -> [f64; 2] {
        let ell = self.ell(lengths);
        let shifted = ell.zip_map(squared_heights, |e, w| e - w);
        let c = self.alpha(&shifted);
        [c[0] + self.mean[0], c[1] + self.mean[1]]
    }

    /// dw_i/dL_kj, from a linearisation of the regression about its solution.
    fn sensitivity(&self, lengths: &[CableVec], alpha: &[[f64; 2]], fit: &Regression) -> Vec<Vec<CableVec>> {
        let (n, m) = (self.n, lengths.len() as f64);
        let unit: Vec<[f64; MAX_CABLES]> = (0..n)
            .map(|k| {
                let mut one = [0.0; MAX_CABLES];
                one[k] = 1.0;
                self.off_plane(&one)
            })
            .collect();
        (0..n)
            .map(|i| {
                let [x, y] = self.xy[i];
                let by_unknown = Vector3::new(2.0 * (x - fit.e[0]), 2.0 * (y - fit.e[1]), 1.0);
                let weight = fit.inverse * by_unknown;
                lengths
                    .iter()
                    .zip(alpha)
                    .map(|(point, a)| {
                        let by_residual = weight.dot(&Vector3::new(2.0 * a[0], 2.0 * a[1], 1.0));
                        let c = [a[0] + fit.e[0], a[1] + fit.e[1]];
                        CableVec::from_fn(n, |k| {
                            let residual_by_ell = 1.0 / n as f64 + c[0] * self.k[k][0] + c[1] * self.k[k][1];
                            2.0 * point[k] * (by_residual * residual_by_ell + unit[k][i] / m)
                        })
                    })
                    .collect()
            })
            .collect()
    }
}

struct Regression {
    e: [f64; 2],
    v: f64,
    /// (XᵀX)⁻¹ of rows [2 alpha, 1].
    inverse: Matrix3<f64>,
}

/// Least squares of beta on [2 alpha, 1], centred so that the intercept does not degrade the condition number.
fn regress(alpha: &[[f64; 2]], beta: &[f64]) -> Regression {
    let m = alpha.len() as f64;
    let mean = alpha.iter().fold([0.0; 2], |s, a| [s[0] + a[0] / m, s[1] + a[1] / m]);
    let mean_beta = beta.iter().sum::<f64>() / m;
    let (mut xx, mut xy, mut yy, mut bx, mut by) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (a, b) in alpha.iter().zip(beta) {
        let (x, y, b) = (2.0 * (a[0] - mean[0]), 2.0 * (a[1] - mean[1]), b - mean_beta);
        xx += x * x;
        xy += x * y;
        yy += y * y;
        bx += x * b;
        by += y * b;
    }
    let det = xx * yy - xy * xy;
    let e = [(yy * bx - xy * by) / det, (xx * by - xy * bx) / det];
    let v = mean_beta - 2.0 * (mean[0] * e[0] + mean[1] * e[1]);
    // The inverse of [[S, 0], [0, m]] in the centred frame, transformed back: intercept v = v' - 2 mean.e.
    let (ixx, ixy, iyy) = (yy / det, -xy / det, xx / det);
    let t = [2.0 * mean[0], 2.0 * mean[1]];
    let (ev_x, ev_y) = (-(ixx * t[0] + ixy * t[1]), -(ixy * t[0] + iyy * t[1]));
    let vv = 1.0 / m - (ev_x * t[0] + ev_y * t[1]);
    Regression { e, v, inverse: Matrix3::new(ixx, ixy, ev_x, ixy, iyy, ev_y, ev_x, ev_y, vv) }
}

/// Computes heights by (4)-(5): the global minimum, checked. `anchors_xy_m` in any frame, `lengths_m`
/// one set per point.
///
/// The scatter of the lengths is estimated from the residuals, with a lower bound of a millimetre. A result whose
/// predicted standard deviation exceeds the height itself is rejected.
///
/// # Errors
/// `invalid_argument`; `degenerate_geometry` for anchors on one line; `rank_deficient` for fewer than three points,
/// points on one line or nearly so; `no_real_height` if the optimum has a negative squared height.
///
/// ```
/// use cable_robot::CableVec;
/// use calibration::calibrate_heights;
/// let anchors = [[0.0, 0.0], [8.0, 0.0], [4.0, 6.0]];
/// let lengths: Vec<_> = [[1.0, 1.0], [7.0, 1.0], [4.0, 5.0]]
///     .iter()
///     .map(|c: &[f64; 2]| {
///         CableVec::from_fn(3, |i| {
///             let (dx, dy) = (anchors[i][0] - c[0], anchors[i][1] - c[1]);
///             (dx * dx + dy * dy + 9.0f64).sqrt()
///         })
///     })
///     .collect();
/// let found = calibrate_heights(&anchors, &lengths)?;
/// assert!(found.heights_m.iter().all(|z| (z - 3.0).abs() < 1e-12));
/// # Ok::<(), calibration::CalibrationError>(())
/// ```
pub fn calibrate_heights(anchors_xy_m: &[[f64; 2]], lengths_m: &[CableVec]) -> Result<Heights, CalibrationError> {
    let found = closed_form_with_sensitivity(anchors_xy_m, lengths_m)?;
    let sigma = scatter(anchors_xy_m, lengths_m, &found).max(BEST_SIGMA_M);
    check_spread(anchors_xy_m, lengths_m, &found.points_xy_m, sigma)?;
    for i in 0..anchors_xy_m.len() {
        let w = found.squared_heights_m2[i].abs();
        let std = found.covariance(i, i, sigma).max(0.0).sqrt();
        if is_undetermined(found.squared_heights_m2[i], std) && is_flat(&found.points_xy_m) {
            return undetermined(nearly_on_a_line(&found.points_xy_m, i, std / (2.0 * w.sqrt()), None));
        }
    }
    let heights_m = found.heights_m()?;
    Ok(Heights { heights_m, points_xy_m: found.points_xy_m, cost_m4: found.cost_m4 })
}

/// Root mean square scatter of the lengths about the model, m, with the remaining degrees of freedom; 0 without any.
fn scatter(anchors: &[[f64; 2]], lengths: &[CableVec], found: &ClosedForm) -> f64 {
    let (n, m) = (anchors.len(), lengths.len());
    let unknowns = 2 * m + n;
    if n * m <= unknowns {
        return 0.0;
    }
    let mut sum = 0.0;
    for (point, c) in lengths.iter().zip(&found.points_xy_m) {
        for i in 0..n {
            let (dx, dy) = (anchors[i][0] - c[0], anchors[i][1] - c[1]);
            let e = point[i] - (dx * dx + dy * dy + found.squared_heights_m2[i]).max(0.0).sqrt();
            sum += e * e;
        }
    }
    (sum / (n * m - unknowns) as f64).sqrt()
}

/// Root mean square spread of points along and across their best-fitting line, m.
pub(super) fn spread(points: &[[f64; 2]]) -> [f64; 2] {
    let m = points.len().max(1) as f64;
    let mean = points.iter().fold([0.0; 2], |s, a| [s[0] + a[0] / m, s[1] + a[1] / m]);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for a in points {
        let (x, y) = (a[0] - mean[0], a[1] - mean[1]);
        xx += x * x / m;
        xy += x * y / m;
        yy += y * y / m;
    }
    let (half, part) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let root = (part * part + xy * xy).sqrt();
    [(half + root).max(0.0).sqrt(), (half - root).max(0.0).sqrt()]
}

/// True for a squared height that data of this accuracy do not determine: its standard deviation exceeds the height
/// itself, or it is negative without being significantly so.
pub(super) fn is_undetermined(squared_height: f64, std: f64) -> bool {
    // std(z) = std(w) / 2z > z; three standard deviations below zero are significant.
    let bound = if squared_height >= 0.0 { 2.0 * squared_height } else { -squared_height / 3.0 };
    !(std <= bound)
}

/// Rejects points that lie on a line within the accuracy of the lengths. The regression assumes that its
/// regressors, the positions of the points, are exact; if noise causes their distance from the line, its standard
/// deviations are meaningless.
pub(super) fn check_spread(
    anchors: &[[f64; 2]],
    lengths: &[CableVec],
    points: &[[f64; 2]],
    sigma_length_m: f64,
) -> Result<(), CalibrationError> {
    let frame = Frame::new(anchors);
    let normal = normal_direction(points);
    let mut variance = 0.0;
    for point in lengths {
        for (k, l) in frame.k.iter().zip(point.iter()) {
            let gain = (k[0] * normal[0] + k[1] * normal[1]) * l * sigma_length_m;
            variance += gain * gain / lengths.len() as f64;
        }
    }
    let spread = spread(points)[1];
    if spread * spread > LEAST_SIGNAL * variance {
        return Ok(());
    }
    undetermined(Undetermined::OnALineInNoise { across_m: spread, noise_m: variance.sqrt() })
}

/// Unit vector across the best-fitting line of the points.
fn normal_direction(points: &[[f64; 2]]) -> [f64; 2] {
    let m = points.len().max(1) as f64;
    let mean = points.iter().fold([0.0; 2], |s, a| [s[0] + a[0] / m, s[1] + a[1] / m]);
    let (mut difference, mut product) = (0.0, 0.0);
    for a in points {
        let (x, y) = (a[0] - mean[0], a[1] - mean[1]);
        difference += x * x - y * y;
        product += 2.0 * x * y;
    }
    let angle = 0.5 * libm::atan2(product, difference);
    [-libm::sin(angle), libm::cos(angle)]
}

/// True for points along a line rather than spread over the area. Selects the wording of an error, not the result.
pub(super) fn is_flat(points: &[[f64; 2]]) -> bool {
    let [along, across] = spread(points);
    across < 0.15 * along
}

pub(super) fn nearly_on_a_line(points: &[[f64; 2]], anchor: usize, std_m: f64, limit_m: Option<f64>) -> Undetermined {
    let [along_m, across_m] = spread(points);
    Undetermined::NearALine { across_m, along_m, anchor: anchor + 1, std_m, limit_m }
}

/// Computes the point of the plane that fits these lengths best: Gauss-Newton in two unknowns from the linear estimate.
pub(super) fn point_in_plane(anchors: &[[f64; 3]], lengths: &CableVec, start: [f64; 2]) -> [f64; 2] {
    let mut c = start;
    for _ in 0..MAX_POINT_ITERATIONS {
        let (mut xx, mut xy, mut yy, mut gx, mut gy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (a, l) in anchors.iter().zip(lengths.iter()) {
            let (dx, dy) = (c[0] - a[0], c[1] - a[1]);
            let d = (dx * dx + dy * dy + a[2] * a[2]).sqrt().max(1e-12);
            let (ux, uy) = (dx / d, dy / d);
            xx += ux * ux;
            xy += ux * uy;
            yy += uy * uy;
            gx += ux * (d - l);
            gy += uy * (d - l);
        }
        let det = xx * yy - xy * xy;
        if !(det > 0.0) {
            return start;
        }
        let step = [(yy * gx - xy * gy) / det, (xx * gy - xy * gx) / det];
        c = [c[0] - step[0], c[1] - step[1]];
        if step[0].abs().max(step[1].abs()) < 1e-12 {
            return c;
        }
    }
    // Not converged: the linear estimate is close.
    if c.iter().all(|v| v.is_finite()) { c } else { start }
}
