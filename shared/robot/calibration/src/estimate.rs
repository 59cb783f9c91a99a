//! From measurements to anchors with covariance, or an error. Lengths and ranges in m with standard deviations in m;
//! anchors, cables and points count from 0 here, and from 1 in error messages. [`calibrate`] has a complete example.

use nalgebra::{DMatrix, DVector};

use super::Undetermined;
use super::covariance::AnchorCovariance;
use super::error::{CalibrationError, check_sigma, invalid, undetermined};
use super::heights::{self, Frame, check_lengths, closed_form, closed_form_with_sensitivity};
use super::joint::{DirectHeight, JointInput, Loss, calibrate_joint};
use super::measurements::{Calibration, Measurements, Method, Outlier};
use super::model::{self, Layout};
use super::refine::{Scatter, refine};
use super::straight::{self, Geometry};
use super::survey::survey_network;
use super::{gps, joint};
use cable_robot::{CableVec, MAX_CABLES};

/// Standard deviations are widened if the probability of the observed scatter is below one in a hundred
/// (one-sided normal quantile).
const IMPLAUSIBLE_QUANTILE: f64 = 2.326;

/// A length whose residual exceeds this many standard deviations is reported as an outlier: one in 16,000 for a
/// normal distribution.
const OUTLIER_SIGMAS: f64 = 4.0;

/// Step of the difference quotient with respect to anchor coordinates, m: its error is its square, relative to metres.
const STEP_M: f64 = 1e-4;

/// Calibrates the anchors from measurements.
///
/// # Errors
/// `invalid_argument`, `degenerate_geometry`, `ambiguous`, `no_real_height`, for the GPS method `unreachable`; and
/// `rank_deficient` if the measurements do not determine the anchors: too few points, points on a line, and points that
/// predict a standard deviation above `refuse_above_std_m`.
///
/// ```
/// use cable_robot::CableVec;
/// use calibration::Measurements;
/// use calibration::Method;
/// use calibration::Range;
/// use calibration::calibrate;
/// let anchors = [[0.0, 0.0, 3.0], [10.0, 0.0, 3.2], [5.0, 8.0, 2.9f64]];
/// let range = |i: usize, j: usize| {
///     let (dx, dy) = (anchors[i][0] - anchors[j][0], anchors[i][1] - anchors[j][1]);
///     Range { from: i, to: j, m: dx.hypot(dy), sigma_m: 0.002 }
/// };
/// let lengths = |[x, y]: [f64; 2]| {
///     CableVec::from_fn(3, |i| (anchors[i][0] - x).hypot(anchors[i][1] - y).hypot(anchors[i][2]))
/// };
/// let measured = Measurements {
///     ranges: vec![range(0, 1), range(0, 2), range(1, 2)],
///     lengths_m: [[1.0, 0.5], [9.0, 0.5], [5.0, 7.0], [5.0, 3.0], [2.0, 2.0]].map(lengths).to_vec(),
///     ..Measurements::new(3)
/// };
/// let found = calibrate(&measured, Method::Joint)?;
/// assert!((found.anchors_m[2][2] - 2.9).abs() < 1e-6 && found.rms_residual_m() < 1e-6);
/// # Ok::<(), calibration::CalibrationError>(())
/// ```
pub fn calibrate(measured: &Measurements, method: Method) -> Result<Calibration, CalibrationError> {
    let n = measured.cable_count;
    if !(3..=MAX_CABLES).contains(&n) {
        return invalid(format!("{n} cables cannot be calibrated; a robot has 3 to {MAX_CABLES}"));
    }
    check_lengths(n, &measured.lengths_m)?;
    check_sigma("the standard deviation of the lengths", measured.sigma_length_m)?;
    check_sigma("the standard deviation above which an answer is refused", measured.refuse_above_std_m)?;
    for h in &measured.heights {
        if h.anchor >= n {
            return invalid(format!("a height is given for anchor {}; there are {n}", h.anchor + 1));
        }
        if !(h.m.is_finite() && h.m > 0.0) {
            return invalid(format!("the height of anchor {} is {} m; give a height above 0", h.anchor + 1, h.m));
        }
        check_sigma(&format!("the standard deviation of the height of anchor {}", h.anchor + 1), h.sigma_m)?;
    }
    // Radii of another number than cables must not count as eyes.
    if !measured.pulley_radius_m.is_empty() {
        straight::check_radii(n, &measured.pulley_radius_m)?;
    }
    let (mut found, mut fit) =
        if model::has_pulleys(measured) { with_pulleys(measured, method)? } else { by_method(measured, method)? };
    for (what, sigma) in [
        ("the pulley radius", measured.sigma_pulley_radius_m),
        ("the scale of a cable", measured.sigma_cable_scale),
        ("an attachment", measured.sigma_attachment_m),
        ("the floor", measured.sigma_floor_m),
    ] {
        if let Some(sigma) = sigma {
            check_sigma(&format!("the standard deviation of {what}"), sigma)?;
        }
    }
    if method == Method::Joint && Layout::new(measured, method).is_extended() {
        let (refined, scatter) = refine(measured, found)?;
        fit = Fit { scatter, robust: measured.loss != Loss::Squared };
        found = refined;
    }
    assess_fit(measured, &mut found, fit);
    let (anchor, axis, std) = found.covariance.worst();
    if !(std <= measured.refuse_above_std_m) {
        return undetermined(refusal(measured, &found, anchor, axis, std));
    }
    Ok(found)
}

fn by_method(measured: &Measurements, method: Method) -> Result<(Calibration, Fit), CalibrationError> {
    match method {
        Method::Survey => by_survey(measured),
        Method::Joint => by_joint(measured),
        Method::Gps => by_gps(measured),
    }
}

/// Estimates with the lengths and heights that cables over eyes would have.
fn with_pulleys(measured: &Measurements, method: Method) -> Result<(Calibration, Fit), CalibrationError> {
    let radii_m = &measured.pulley_radius_m;
    let estimate = |lengths_m: &[CableVec], heights: &[DirectHeight]| {
        let (lengths_m, heights) = (lengths_m.to_vec(), heights.to_vec());
        by_method(&Measurements { lengths_m, heights, ..measured.clone() }, method)
    };
    let geometry = |(found, _): &(Calibration, Fit)| Geometry {
        anchors_m: found.anchors_m.clone(),
        points_m: found.points_m.clone(),
        scale: found.scale,
    };
    let (mut found, fit) = straight::settle(&measured.lengths_m, &measured.heights, radii_m, estimate, geometry)?;
    found.pulley_radius_m.clone_from(radii_m);
    Ok((found, fit))
}

fn refusal(measured: &Measurements, found: &Calibration, anchor: usize, axis: usize, std: f64) -> Undetermined {
    let limit_m = measured.refuse_above_std_m;
    let xy: Vec<_> = found.points_m.iter().map(|p| [p[0], p[1]]).collect();
    if found.method != Method::Gps && axis == 2 && heights::is_flat(&xy) {
        return heights::nearly_on_a_line(&xy, anchor, std, Some(limit_m));
    }
    Undetermined::Uncertain { axis: ['x', 'y', 'z'][axis], anchor: anchor + 1, std_m: std, limit_m }
}

/// Agreement of the data with the model.
struct Fit {
    scatter: Scatter,
    robust: bool,
}

/// Compares the scatter with the stated one, widens the covariance if chance does not explain it, reports outliers.
fn assess_fit(measured: &Measurements, found: &mut Calibration, fit: Fit) {
    let Scatter { chi_squared, degrees_of_freedom: dof } = fit.scatter;
    if dof >= 1.0 {
        let ratio = (chi_squared / dof).sqrt();
        found.noise_ratio = Some(ratio);
        // Wilson and Hilferty: the cube root of chi-squared over its degrees of freedom is nearly normal.
        let spread = 2.0 / (9.0 * dof);
        let normal = (libm::cbrt(chi_squared / dof) - (1.0 - spread)) / spread.sqrt();
        if normal > IMPLAUSIBLE_QUANTILE && ratio > 1.0 {
            found.widened_by = ratio;
            found.covariance = found.covariance.widened(ratio);
            found.lengths = found.lengths.as_ref().map(|lengths| lengths.widened(ratio));
            found.scale_std *= ratio;
            found.offset_std_m = found.offset_std_m.map(|s| s * ratio);
            found.pulley_radius_std_m *= ratio;
        }
    }
    let bound = OUTLIER_SIGMAS * measured.sigma_length_m * if fit.robust { found.widened_by } else { 1.0 };
    for (point, residuals) in found.residuals_m.iter().enumerate() {
        for (cable, r) in residuals.iter().enumerate().filter(|(_, r)| r.abs() > bound) {
            found.outliers.push(Outlier { cable, point, residual_m: *r });
        }
    }
}

fn without_scale(method: Method, anchors_m: Vec<[f64; 3]>, covariance: AnchorCovariance) -> Calibration {
    let n = anchors_m.len();
    Calibration {
        method,
        anchors_m,
        covariance,
        lengths: None,
        points_m: Vec::new(),
        residuals_m: Vec::new(),
        scale: 1.0,
        scale_std: 0.0,
        offsets_m: CableVec::zeros(n),
        offset_std_m: CableVec::zeros(n),
        pulley_radius_m: Vec::new(),
        pulley_radius_std_m: 0.0,
        noise_ratio: None,
        widened_by: 1.0,
        outliers: Vec::new(),
    }
}

fn by_survey(measured: &Measurements) -> Result<(Calibration, Fit), CalibrationError> {
    let n = measured.cable_count;
    let survey = survey_network(n, &measured.ranges, &measured.sides)?;
    let xy = survey.anchors_xy_m;
    let all_direct = (0..n).all(|i| measured.heights.iter().any(|h| h.anchor == i));
    // Unknowns x1, y1, z1, ..; heights come from the points, or start from zero if all were measured directly.
    let mut value = DVector::zeros(3 * n);
    let mut covariance = DMatrix::zeros(3 * n, 3 * n);
    for i in 0..n {
        value[3 * i] = xy[i][0];
        value[3 * i + 1] = xy[i][1];
        for j in 0..n {
            for (k, l) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                covariance[(3 * i + k, 3 * j + l)] = survey.covariance[(2 * i + k, 2 * j + l)];
            }
        }
    }
    match closed_form_with_sensitivity(&xy, &measured.lengths_m) {
        Ok(found) => {
            if !all_direct {
                heights::check_spread(&xy, &measured.lengths_m, &found.points_xy_m, measured.sigma_length_m)?;
            }
            let heights = found.heights_m()?;
            add_height_covariance(measured, &xy, &survey.covariance, &found, &heights, &mut covariance)?;
            for i in 0..n {
                value[3 * i + 2] = heights[i];
            }
            for h in &measured.heights {
                update(&mut value, &mut covariance, h);
            }
        }
        Err(CalibrationError::RankDeficient(_)) if all_direct => {
            for i in 0..n {
                let (mut sum, mut weight) = (0.0, 0.0);
                for h in measured.heights.iter().filter(|h| h.anchor == i) {
                    sum += h.m / (h.sigma_m * h.sigma_m);
                    weight += 1.0 / (h.sigma_m * h.sigma_m);
                }
                value[3 * i + 2] = sum / weight;
                covariance[(3 * i + 2, 3 * i + 2)] = 1.0 / weight;
            }
        }
        Err(CalibrationError::RankDeficient(why)) if !measured.heights.is_empty() => {
            return undetermined(Undetermined::WithoutHeights(Box::new(why)));
        }
        Err(error) => return Err(error),
    }
    let anchors_m: Vec<[f64; 3]> = (0..n).map(|i| [value[3 * i], value[3 * i + 1], value[3 * i + 2]]).collect();
    let xy: Vec<_> = anchors_m.iter().map(|a| [a[0], a[1]]).collect();
    let w: Vec<_> = anchors_m.iter().map(|a| a[2] * a[2]).collect();
    let frame = Frame::new(&xy);
    let points: Vec<_> =
        measured.lengths_m.iter().map(|l| heights::point_in_plane(&anchors_m, l, frame.point(l, &w))).collect();
    let mut found = without_scale(Method::Survey, anchors_m, AnchorCovariance::new(covariance));
    found.residuals_m = residuals(&xy, &w, &points, &measured.lengths_m);
    found.points_m = points.iter().map(|c| [c[0], c[1], 0.0]).collect();
    // The agreement of the data has to be judged with the model, not with this estimate, whose residuals also contain
    // the errors of its x and y.
    let scatter = joint_fit(measured, &xy).map_or(Scatter { chi_squared: 0.0, degrees_of_freedom: 0.0 }, |best| {
        Scatter { chi_squared: best.chi_squared, degrees_of_freedom: best.degrees_of_freedom }
    });
    Ok((found, Fit { scatter, robust: false }))
}

/// Maximum likelihood fit of the same unknowns, without scale and zeros.
fn joint_fit(measured: &Measurements, xy: &[[f64; 2]]) -> Result<joint::Joint, CalibrationError> {
    calibrate_joint(&JointInput {
        ranges: &measured.ranges,
        heights: &measured.heights,
        ..JointInput::new(xy, &measured.lengths_m, measured.sigma_length_m)
    })
}

/// Adds the height rows: noise of the lengths, and noise of the survey through the closed form.
fn add_height_covariance(
    measured: &Measurements,
    xy: &[[f64; 2]],
    survey: &DMatrix<f64>,
    found: &heights::ClosedForm,
    heights: &CableVec,
    covariance: &mut DMatrix<f64>,
) -> Result<(), CalibrationError> {
    let n = xy.len();
    // dw/d(x, y) by central differences.
    let mut by_xy = DMatrix::zeros(n, 2 * n);
    for k in 0..2 * n {
        if survey[(k, k)] == 0.0 {
            continue;
        }
        let shifted = |by: f64| {
            let mut moved = xy.to_vec();
            moved[k / 2][k % 2] += by;
            closed_form(&moved, &measured.lengths_m)
        };
        let (up, down) = (shifted(STEP_M)?, shifted(-STEP_M)?);
        for i in 0..n {
            by_xy[(i, k)] = (up.squared_heights_m2[i] - down.squared_heights_m2[i]) / (2.0 * STEP_M);
        }
    }
    let cross = &by_xy * survey;
    let from_survey = &cross * by_xy.transpose();
    // dz = dw / 2z; a height of zero has an infinite standard deviation and is rejected because of it.
    let gain = |i: usize| 0.5 / heights[i];
    for i in 0..n {
        for j in 0..n {
            let w = from_survey[(i, j)] + found.covariance(i, j, measured.sigma_length_m);
            covariance[(3 * i + 2, 3 * j + 2)] = gain(i) * gain(j) * w;
            for k in 0..2 {
                let c = gain(i) * cross[(i, 2 * j + k)];
                covariance[(3 * i + 2, 3 * j + k)] = c;
                covariance[(3 * j + k, 3 * i + 2)] = c;
            }
        }
    }
    Ok(())
}

/// Updates the estimate with a directly measured height (Kalman update).
fn update(value: &mut DVector<f64>, covariance: &mut DMatrix<f64>, height: &DirectHeight) {
    let k = 3 * height.anchor + 2;
    let total = covariance[(k, k)] + height.sigma_m * height.sigma_m;
    let surprise = height.m - value[k];
    let column = covariance.column(k).into_owned();
    *value += &column * (surprise / total);
    *covariance -= &column * column.transpose() / total;
}

fn residuals(xy: &[[f64; 2]], w: &[f64], points: &[[f64; 2]], lengths: &[CableVec]) -> Vec<CableVec> {
    lengths
        .iter()
        .zip(points)
        .map(|(l, c)| {
            CableVec::from_fn(xy.len(), |i| {
                let (dx, dy) = (xy[i][0] - c[0], xy[i][1] - c[1]);
                l[i] - (dx * dx + dy * dy + w[i]).max(0.0).sqrt()
            })
        })
        .collect()
}

fn by_joint(measured: &Measurements) -> Result<(Calibration, Fit), CalibrationError> {
    let survey = survey_network(measured.cable_count, &measured.ranges, &measured.sides)?;
    let joint: joint::Joint = calibrate_joint(&JointInput {
        anchors_xy_m: &survey.anchors_xy_m,
        lengths_m: &measured.lengths_m,
        sigma_length_m: measured.sigma_length_m,
        ranges: &measured.ranges,
        heights: &measured.heights,
        sigma_scale: measured.sigma_scale,
        sigma_offset_m: measured.sigma_offset_m,
        loss: measured.loss,
    })?;
    let mut found = without_scale(Method::Joint, joint.anchors_m, joint.covariance);
    found.points_m = joint.points_xy_m.iter().map(|c| [c[0], c[1], 0.0]).collect();
    found.residuals_m = joint.residuals_m;
    found.scale = joint.scale;
    found.scale_std = joint.scale_std;
    found.offsets_m = joint.offsets_m;
    found.offset_std_m = joint.offset_std_m;
    let scatter = Scatter { chi_squared: joint.chi_squared, degrees_of_freedom: joint.degrees_of_freedom };
    Ok((found, Fit { scatter, robust: measured.loss != Loss::Squared }))
}

fn by_gps(measured: &Measurements) -> Result<(Calibration, Fit), CalibrationError> {
    let (n, m) = (measured.cable_count, measured.lengths_m.len());
    if measured.gps_m.len() != m {
        return invalid(format!(
            "{} of {m} points have a known position; the GPS method needs it for every point",
            measured.gps_m.len()
        ));
    }
    if !(measured.sigma_gps_m.is_finite() && measured.sigma_gps_m >= 0.0) {
        return invalid(format!(
            "the standard deviation of GPS positions is {} m; give 0 or more",
            measured.sigma_gps_m
        ));
    }
    let mut anchors = Vec::with_capacity(n);
    for i in 0..n {
        let lengths: Vec<_> = measured.lengths_m.iter().map(|l| l[i]).collect();
        anchors.push(gps::gps_anchor_least_squares(&measured.gps_m, &lengths).map_err(|error| match error {
            CalibrationError::Unreachable(why) => CalibrationError::Unreachable(format!("anchor {}: {why}", i + 1)),
            other => other,
        })?);
    }
    let (length, place) = (measured.sigma_length_m.powi(2), measured.sigma_gps_m.powi(2));
    let mut covariance = DMatrix::zeros(3 * n, 3 * n);
    for (i, a) in anchors.iter().enumerate() {
        for (k, b) in anchors.iter().enumerate() {
            for j in 0..m {
                // An error of a point's position moves every anchor by its component along the
                // direction to that anchor.
                let shared = place * a.directions[j].dot(&b.directions[j]) + if i == k { length } else { 0.0 };
                let block = a.by_length[j] * b.by_length[j].transpose() * shared;
                let mut view = covariance.fixed_view_mut::<3, 3>(3 * i, 3 * k);
                view += block;
            }
        }
    }
    let variance = length + place;
    let chi_squared = anchors.iter().flat_map(|a| &a.residuals_m).map(|r| r * r / variance).sum();
    let anchors_m = anchors.iter().map(|a| a.anchor_m.into()).collect();
    let mut found = without_scale(Method::Gps, anchors_m, AnchorCovariance::new(covariance));
    found.points_m = measured.gps_m.clone();
    found.residuals_m = (0..m).map(|j| CableVec::from_fn(n, |i| anchors[i].residuals_m[j])).collect();
    let scatter = Scatter { chi_squared, degrees_of_freedom: (n * m.saturating_sub(3)) as f64 };
    Ok((found, Fit { scatter, robust: false }))
}
