//! Calibration of the anchors from measurements.

use super::args::{Args, invalid_value};
use super::error::{OperationResult, SolveError};
use cable_robot::CableVec;
use calibration::{self, JointInput, Loss, Range, Side};
use serde_json::{Value, json};

/// Anchors in the plane from three ranges, (1)-(2).
pub fn survey_anchors(args: &Args) -> OperationResult {
    let ranges = args.exactly::<3>("ranges_m")?;
    let anchors = calibration::survey_anchors(ranges, args.side()?.unwrap_or(Side::Left))?;
    Ok(json!({ "anchors_xy_m": anchors }))
}

/// The fourth anchor from two ranges and a side, or from three ranges.
pub fn fourth_anchor(args: &Args) -> OperationResult {
    let rows = args.rows::<2>("anchors_xy_m")?;
    let given = rows.len();
    let anchors: [[f64; 2]; 3] = rows
        .try_into()
        .map_err(|_| invalid_value("anchors_xy_m", &format!("{given} points"), "three points [x, y]"))?;
    let ranges = args.numbers("ranges_m")?;
    let side = args.side()?;
    if ranges.len() == 2 && side.is_none() {
        return Err(SolveError::invalid(
            "side is missing; with two ranges it is 1 (left of the line 1 to 2) or -1 (right)",
        ));
    }
    Ok(json!({ "anchor_xy_m": calibration::fourth_anchor(&anchors, &ranges, side)? }))
}

/// Converts one row per cable to one set of lengths per point.
fn lengths(args: &Args, cables: usize) -> Result<Vec<CableVec>, SolveError> {
    let rows = args.matrix("lengths_m")?;
    if rows.len() != cables {
        return Err(invalid_value(
            "lengths_m",
            &format!("{} rows for {cables} anchors", rows.len()),
            "one row per cable",
        ));
    }
    Ok(calibration::points_from_rows(&rows)?)
}

/// Heights of the anchors, (4)-(5): the global minimum.
pub fn calibrate_heights(args: &Args) -> OperationResult {
    let anchors = args.rows::<2>("anchors_xy_m")?;
    let radii_m = args.radii(anchors.len())?;
    let found = calibration::calibrate_heights_with_pulleys(&anchors, &lengths(args, anchors.len())?, &radii_m)?;
    Ok(json!({ "heights_m": found.heights_m.to_vec(), "points_xy_m": found.points_xy_m, "cost_m4": found.cost_m4 }))
}

/// All unknowns at once by maximum likelihood.
pub fn calibrate_joint(args: &Args) -> OperationResult {
    let anchors = args.rows::<2>("anchors_xy_m")?;
    let lengths = lengths(args, anchors.len())?;
    let sigma_length_m = args.positive("sigma_length_m")?;
    let ranges = ranges(args, anchors.len())?;
    let sigma = |flag: &str, key: &str| if args.flag(flag)? { args.positive(key).map(Some) } else { Ok(None) };
    let loss = match args.get("loss").map(|_| args.text("loss")).transpose()? {
        None | Some("squared") => Loss::Squared,
        Some("huber") => Loss::Huber,
        Some("cauchy") => Loss::Cauchy,
        Some(other) => return Err(invalid_value("loss", &format!("{other:?}"), "squared, huber or cauchy")),
    };
    let input = JointInput {
        ranges: &ranges,
        sigma_scale: sigma("fit_scale", "sigma_scale")?,
        sigma_offset_m: sigma("fit_offsets", "sigma_offset_m")?,
        loss,
        ..JointInput::new(&anchors, &lengths, sigma_length_m)
    };
    let found = calibration::calibrate_joint_with_pulleys(&input, &args.radii(anchors.len())?)?;
    let heights: Vec<f64> = found.anchors_m.iter().map(|a| a[2]).collect();
    let xy: Vec<[f64; 2]> = found.anchors_m.iter().map(|a| [a[0], a[1]]).collect();
    Ok(json!({
        "heights_m": heights,
        "anchors_xy_m": xy,
        "points_xy_m": found.points_xy_m,
        "scale": found.scale,
        "offsets_m": found.offsets_m.to_vec(),
        "anchor_std_m": found.covariance.std_m(),
    }))
}

/// Returns the ranges between the anchors in `range_pairs`. Anchors count from 1, or from 0 if a pair contains 0.
fn ranges(args: &Args, anchors: usize) -> Result<Vec<Range>, SolveError> {
    if args.get("ranges_m").is_none() {
        return Ok(Vec::new());
    }
    let (m, sigma_m) = (args.numbers("ranges_m")?, args.positive("sigma_range_m")?);
    let pairs = match args.get("range_pairs") {
        // D1 = P1P3, D2 = P1P2, D3 = P2P3 of (1)-(2).
        None if m.len() == 3 && anchors == 3 => vec![[1.0, 3.0], [1.0, 2.0], [2.0, 3.0]],
        _ => args.rows::<2>("range_pairs")?,
    };
    if pairs.len() != m.len() {
        return Err(invalid_value(
            "range_pairs",
            &format!("{} pairs for {} ranges", pairs.len(), m.len()),
            "one pair per range",
        ));
    }
    let first = if pairs.iter().flatten().any(|i| *i == 0.0) { 0.0 } else { 1.0 };
    let index = |i: f64| {
        let index = i - first;
        if index >= 0.0 && index < anchors as f64 && index.fract() == 0.0 {
            return Ok(index as usize);
        }
        Err(invalid_value("range_pairs", &format!("an anchor {i}"), &format!("anchors 1 to {anchors}")))
    };
    pairs
        .iter()
        .zip(m)
        .map(|([from, to], m)| {
            if from == to {
                return Err(invalid_value("range_pairs", &format!("[{from}, {to}]"), "two different anchors per pair"));
            }
            Ok(Range { from: index(*from)?, to: index(*to)?, m, sigma_m })
        })
        .collect()
}

/// The paper's baseline: an anchor from three known points.
pub fn gps_anchor(args: &Args) -> OperationResult {
    let rows = args.rows::<3>("points_m")?;
    let given = rows.len();
    let points: [[f64; 3]; 3] =
        rows.try_into().map_err(|_| invalid_value("points_m", &format!("{given} points"), "three points [x, y, z]"))?;
    let anchor = calibration::gps_anchor(&points, &args.exactly::<3>("lengths_m")?)?;
    Ok::<Value, SolveError>(json!({ "anchor_m": anchor }))
}
