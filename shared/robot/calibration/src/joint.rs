//! Maximum likelihood estimate of heights, x and y, points, the scale of the lengths and the zeros of the encoders
//! together, with a robust loss for outliers.
//!
//! The measured length of cable i at point j is `k sqrt(|a_i - c_j|² + w_i) + o_i` with k near 1 and o_i near 0. The
//! unknown is the squared height w_i, not z_i: the model is smooth through zero, and an optimum below zero is visible
//! instead of stopping at zero. Each point adds two unknowns, which are eliminated (Schur complement), so a thousand
//! points cost a thousand small solutions, not a large one.
//!
//! Lengths and heights in m, standard deviations in the unit of their quantity, the scale dimensionless. Data that do
//! not determine all unknowns are a [`CalibrationError`].

mod descent;
mod input;

use nalgebra::DMatrix;

use super::covariance::AnchorCovariance;
use super::error::{CalibrationError, check_sigma, invalid};
use super::heights::{self, Frame, check_lengths, closed_form};
use super::survey::{check_anchors, check_ranges, to_gauge};
use cable_robot::CableVec;
pub use input::{DirectHeight, JointInput, Loss};

use descent::{Layout, Problem, State, descend, inverse, undetermined_state};

/// A length with a lower weight is an outlier that does not count for the scatter of the others.
const LEAST_WEIGHT: f64 = 0.1;

/// Result of [`calibrate_joint`].
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Anchors, m.
    pub anchors_m: Vec<[f64; 3]>,
    /// x and y of every point, m.
    pub points_xy_m: Vec<[f64; 2]>,
    /// Measured divided by true length.
    pub scale: f64,
    /// Standard deviation of the scale; 0 if it is not estimated.
    pub scale_std: f64,
    /// Measured length at true length zero, by cable, m.
    pub offsets_m: CableVec,
    /// Standard deviations of the offsets, m; 0 if they are not estimated.
    pub offset_std_m: CableVec,
    /// Covariance of the anchors.
    pub covariance: AnchorCovariance,
    /// Measured minus modelled length, one set per point, m.
    pub residuals_m: Vec<CableVec>,
    /// Sum over all measurements and priors of squared residuals in standard deviations, without the lengths that a
    /// robust loss has practically excluded.
    pub chi_squared: f64,
    /// Number of these measurements (a prior counts as one) minus the number of unknowns. Negative if outliers leave
    /// fewer measurements than needed.
    pub degrees_of_freedom: f64,
}

/// Estimates all unknowns together. Without `ranges` x and y stay as given; otherwise the frame has anchor 1 at the
/// origin and anchor 2 on the x axis.
///
/// Starts from the closed form, so it needs no guess. With a robust loss, it first minimises the squared loss, then
/// Huber's, then Cauchy's, so that the result is the minimum near most of the data.
///
/// # Errors
/// `invalid_argument`; `degenerate_geometry` for anchors on one line; `rank_deficient` for fewer than three points
/// (unless heights are measured), points on one line, and other data that do not determine an unknown; `no_real_height`
/// if the optimum has a negative squared height.
///
/// ```
/// use cable_robot::CableVec;
/// use calibration::JointInput;
/// use calibration::calibrate_joint;
/// let anchors = [[0.0, 0.0], [8.0, 0.0], [4.0, 6.0]];
/// // Lengths that are measured 1 % too long.
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
/// # Ok::<(), calibration::CalibrationError>(())
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
    let inverse = normal.reduce(0.0).and_then(|r| inverse(&r.h)).ok_or_else(|| undetermined_state(&state))?;
    // Distinguish a height that the data do not determine from one that they contradict.
    if (0..n).any(|i| heights::is_undetermined(state.w[i], inverse[(i, i)].max(0.0).sqrt())) {
        return Err(undetermined_state(&state));
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
        if input.loss.evaluate(r).1 >= LEAST_WEIGHT {
            chi_squared += r * r;
            equations += 1.0;
        }
    }
    problem.for_each_squared_term(&state, |r, _| {
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
    // Directly measured heights can replace points.
    if input.heights.is_empty() && input.lengths_m.len() < 3 {
        return Err(heights::too_few(input.lengths_m.len()));
    }
    Ok(())
}

/// Starting heights: from the closed form if the points determine them, otherwise from the direct measurements.
fn start(input: &JointInput, to_frame: bool) -> Result<State, CalibrationError> {
    let n = input.anchors_xy_m.len();
    let xy = if to_frame { to_gauge(input.anchors_xy_m) } else { input.anchors_xy_m.to_vec() };
    let mut w = match closed_form(&xy, input.lengths_m) {
        Ok(found) => {
            if input.heights.is_empty() {
                heights::check_spread(&xy, input.lengths_m, &found.points_xy_m, input.sigma_length_m)?;
            }
            let shortest = input.lengths_m.iter().flat_map(|p| p.iter()).fold(f64::INFINITY, |a: f64, l| a.min(*l));
            // Not below a tenth of the shortest length: outliers and zeros can distort the closed form.
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

fn anchor_covariance(layout: &Layout, state: &State, inverse: &DMatrix<f64>) -> AnchorCovariance {
    let n = layout.n;
    // Index of the unknown of a coordinate, and the derivative of the coordinate with respect to it.
    let of = |k: usize| match (k / 3, k % 3) {
        (i, 2) => Some((i, 0.5 / state.w[i].sqrt())),
        (i, axis) => layout.xy(i, axis).map(|p| (p, 1.0)),
    };
    AnchorCovariance::new(DMatrix::from_fn(3 * n, 3 * n, |a, b| match (of(a), of(b)) {
        (Some((p, dp)), Some((q, dq))) => inverse[(p, q)] * dp * dq,
        _ => 0.0,
    }))
}
