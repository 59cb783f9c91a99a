//! Detects the point that does not fit the others.

use crate::calibrate::MeasurementsFile;
use cable_robot::{Anchors, kinematics};
use calibration::{
    JointInput, Measurements, Method, calibrate, calibrate_joint, calibrate_joint_with_pulleys, survey_network,
};

/// Significance of a misfit, as the number of standard deviations of a normal variate with the same probability.
const SIGNIFICANCE_SIGMAS: f64 = 4.0;

/// Difference in chi-squared below which two candidates for the wrong point cannot be distinguished: six is odds of
/// twenty to one.
const MIN_GAIN: f64 = 6.0;

/// Height of the intersection above or below the floor that is worth reporting, m.
const NOTEWORTHY_M: f64 = 0.02;

/// A point that does not fit the others.
#[derive(Debug, Clone, PartialEq)]
pub struct DoubtfulPoint {
    /// Number in the file, from 1.
    pub point: usize,
    /// Its deviation from the others, one clause.
    pub description: String,
}

/// Finds the point that fits worst, if it does not fit and has no decision yet; of several equal candidates, the
/// newest. Points that were kept despite their misfit are excluded, so that no other point is blamed for them.
pub fn find(file: &MeasurementsFile) -> Option<DoubtfulPoint> {
    let kept = |index: &usize| file.doubt.iter().any(|doubt| doubt.point == index + 1);
    let used = file.used(file.usual_method());
    let open: Vec<usize> = used.iter().copied().filter(|index| !kept(index)).collect();
    let mut measured = file.measurements(file.usual_method()).ok()?;
    // With the scale that a tape has given.
    let rows = used.iter().zip(std::mem::take(&mut measured.lengths_m));
    measured.lengths_m = rows.filter(|(index, _)| !kept(index)).map(|(_, lengths_m)| lengths_m).collect();
    // Each point adds `cable_count` lengths and two unknowns, x and y.
    let limit = quantile(measured.cable_count.checked_sub(2)?);
    let all = best_fit(&measured);
    // Fewer than three remaining points determine nothing.
    if open.len() < 4 || all.is_some_and(|(all, _)| all <= limit) {
        return None;
    }
    // If the fit of all points fails, any point whose removal makes a fit possible may be the cause.
    let gain = |rest: &Measurements| best_fit(rest).map(|(rest, _)| all.map_or(f64::MAX, |(all, _)| all - rest));
    let without = |index: usize| {
        let mut rest = measured.clone();
        rest.lengths_m.remove(index);
        rest
    };
    let gains: Vec<(usize, f64)> = (0..open.len()).filter_map(|index| Some((index, gain(&without(index))?))).collect();
    let best = gains.iter().map(|(_, gain)| *gain).fold(0.0, f64::max);
    let (index, most) = *gains.iter().rfind(|(_, gain)| *gain >= best - MIN_GAIN)?;
    if most <= limit {
        return None;
    }
    let rest = without(index);
    let mut description = describe_misfit(&rest, &measured.lengths_m[index]);
    let height = (0..measured.heights.len()).find(|height| {
        let mut rest = measured.clone();
        rest.heights.remove(*height);
        gain(&rest).is_some_and(|gain| gain >= best - MIN_GAIN)
    });
    if let Some(height) = height {
        let pulley = measured.heights[height].anchor + 1;
        description = say!("{description} (unless the height of pulley {pulley} is wrong)");
    } else if best_fit(&rest).is_some_and(|(rest, left)| left > 0.0 && rest > quantile(left as usize)) {
        description =
            say!("{description} (and the others do not fit each other either: a distance or a height may be wrong)");
    }
    Some(DoubtfulPoint { point: open[index] + 1, description })
}

/// Returns the sum of squared residuals of the best fit in units of variance, and its degrees of freedom; `None` if the
/// fit fails.
fn best_fit(measured: &Measurements) -> Option<(f64, f64)> {
    let survey = survey_network(measured.cable_count, &measured.ranges, &measured.sides).ok()?;
    let input = JointInput {
        ranges: &measured.ranges,
        heights: &measured.heights,
        sigma_scale: measured.sigma_scale,
        sigma_offset_m: measured.sigma_offset_m,
        ..JointInput::new(&survey.anchors_xy_m, &measured.lengths_m, measured.sigma_length_m)
    };
    let best = if measured.pulley_radius_m.is_empty() {
        calibrate_joint(&input)
    } else {
        calibrate_joint_with_pulleys(&input, &measured.pulley_radius_m)
    };
    best.ok().map(|best| (best.chi_squared, best.degrees_of_freedom))
}

/// Returns the quantile of chi-squared that is exceeded with the probability of [`SIGNIFICANCE_SIGMAS`]
/// (approximation of Wilson and Hilferty).
fn quantile(degrees_of_freedom: usize) -> f64 {
    let k = degrees_of_freedom as f64;
    let spread = 2.0 / (9.0 * k);
    k * (1.0 - spread + SIGNIFICANCE_SIGMAS * spread.sqrt()).powi(3)
}

/// Describes where the cables of a point meet according to the calibration without it.
fn describe_misfit(rest: &Measurements, lengths_m: &[f64]) -> String {
    let vague = || say!("its cables do not meet in one place");
    let Ok(found) = calibrate(rest, Method::Survey) else { return say!("the other points contradict each other") };
    let anchors = Anchors::new(&found.anchors_m);
    let with_pulleys = |anchors: Anchors| match found.pulley_radius_m.as_slice() {
        [] => Ok(anchors),
        radii_m => anchors.with_pulleys(radii_m),
    };
    let Ok(anchors) = anchors.and_then(with_pulleys) else { return vague() };
    match kinematics::forward_kinematics(&anchors, lengths_m, None) {
        Ok(at) if at.position.z.abs() > NOTEWORTHY_M.max(at.residual_rms_m) => {
            if at.position.z > 0.0 {
                say!("according to them, its cables meet {:.2} m above the floor", at.position.z)
            } else {
                say!("according to them, its cables meet {:.2} m below the floor", -at.position.z)
            }
        }
        Ok(at) if at.residual_rms_m > 0.5 * NOTEWORTHY_M => {
            say!("its cables miss each other by {:.3} m", at.residual_rms_m)
        }
        Ok(at) => say!("according to them, its cables meet {:.3} m off the floor", at.position.z.abs()),
        Err(_) => vague(),
    }
}
