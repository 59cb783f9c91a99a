//! A calibration from measurements: the judgement, its figures and its file.

mod file;
mod honest;
pub mod places;
mod tape;
mod text;

pub use file::{HeightBy, HeightEntry, MeasurementsFile, PointDecision, PointEntry, RangeEntry, Setup};
pub use tape::{TapeEntry, scales as tape_scales};

use calibration::{
    self, AnchorCovariance, Calibration, CalibrationError, Holdout, LengthCovariance, Measurements, Method,
    UnmeasuredRadius,
};
use serde_json::{Value, json};

/// Result of a calibration.
pub struct CalibrationResult {
    /// The result as JSON.
    pub value: Value,
    /// The result as text; the last line is the verdict.
    pub words: String,
    /// Covariance of the anchors.
    pub covariance: AnchorCovariance,
    /// Covariance of what the lengths of the robot depend on, if the measurements state enough for it.
    pub lengths: Option<LengthCovariance>,
}

/// Calibrates, cross-validates by leaving points out, and gives a verdict.
///
/// # Errors
/// One clause without the file name: what cannot be used, why the measurements do not determine the anchors, or which
/// pattern of the residuals speaks against the model.
pub fn judge(file: &MeasurementsFile, method: Method) -> Result<CalibrationResult, String> {
    let measured = file.measurements(method)?;
    let numbers = file.used(method);
    let found = calibration::calibrate(&measured, method).map_err(|e| e.to_string())?;
    if let Some(why) = honest::refusal(&measured, &found, &numbers) {
        return Err(why);
    }
    let holdout = calibration::hold_out(&measured, method).map_err(|e| e.to_string())?;
    let open = calibration::unmeasured_radius(&measured, &found);
    let found = widened(found, open.as_ref());
    let slip = if file.pulley_turn_m.is_some() { None } else { honest::slip_question(&measured, &found) };
    let verdict = text::verdict(&found, &measured, &text::Questions { open: open.as_ref(), slip }, &numbers);
    let mut value = answer(&found, &numbers, holdout.as_ref(), &verdict);
    value["counts_per_m"] = json!(file.counts_per_m);
    value["pulley"] = json!(file.pulley);
    let scales = tape::scales(&file.tape, file.counts_per_m.as_deref(), measured.cable_count)?;
    value["cable_scale"] = json!(tape::factors(&scales));
    let words = tape::words(&scales) + &text::words(&found, holdout.as_ref(), &verdict, file.counts_per_m.as_deref());
    // Only the robot's own lengths have the scales of its encoders.
    let counted = file.counts_per_m.is_some();
    let lengths = found.lengths.map(|lengths| if counted { lengths } else { lengths.without_scales() });
    Ok(CalibrationResult { value, words, covariance: found.covariance, lengths })
}

/// Calibrates, as uncertain as wheels that were not measured make the result.
///
/// # Errors
/// Why the measurements do not determine the anchors.
pub fn honest_calibration(measured: &Measurements, method: Method) -> Result<Calibration, CalibrationError> {
    let found = calibration::calibrate(measured, method)?;
    let open = calibration::unmeasured_radius(measured, &found);
    Ok(widened(found, open.as_ref()))
}

fn widened(found: Calibration, open: Option<&UnmeasuredRadius>) -> Calibration {
    match open {
        Some(open) => found.widened_to(open),
        None => found,
    }
}

fn name(method: Method) -> &'static str {
    match method {
        Method::Survey => "survey",
        Method::Joint => "joint",
        Method::Gps => "gps",
    }
}

fn answer(found: &Calibration, numbers: &[usize], holdout: Option<&Holdout>, verdict: &str) -> Value {
    let outliers: Vec<_> = found
        .outliers
        .iter()
        .map(|o| json!({ "cable": o.cable + 1, "point": numbers.get(o.point).unwrap_or(&o.point) + 1, "residual_m": o.residual_m }))
        .collect();
    json!({
        "method": name(found.method),
        "anchors_m": found.anchors_m,
        "anchor_std_m": found.covariance.std_m(),
        "points_m": found.points_m,
        "rms_residual_m": (!found.residuals_m.is_empty()).then(|| found.rms_residual_m()),
        "holdout_rms_m": holdout.map(|h| h.rms_m),
        "holdout_position_rms_m": holdout.map(|h| h.position_rms_m),
        "scale": found.scale,
        "scale_std": found.scale_std,
        "offsets_m": found.offsets_m.to_vec(),
        "offset_std_m": found.offset_std_m.to_vec(),
        "pulley_radius_m": (!found.pulley_radius_m.is_empty()).then_some(&found.pulley_radius_m),
        "pulley_radius_std_m": (found.pulley_radius_std_m > 0.0).then_some(found.pulley_radius_std_m),
        "noise_ratio": found.noise_ratio,
        "widened_by": found.widened_by,
        "outliers": outliers,
        "verdict": verdict,
    })
}

/// The text of a calibration file, with the measurements that it was computed from. `date`: when, UTC.
///
/// # Errors
/// A value that TOML cannot hold.
pub fn file_text(result: &CalibrationResult, measurements: toml::Table, date: String) -> Result<String, String> {
    let mut table = toml::Table::new();
    table.insert("date".to_owned(), toml::Value::String(date));
    for (key, value) in result.value.as_object().into_iter().flatten() {
        // TOML has no null: unknown values are omitted.
        if !value.is_null() {
            table.insert(key.clone(), toml::Value::try_from(value).map_err(|e| e.to_string())?);
        }
    }
    let matrices = [
        ("covariance_m2", Some(result.covariance.rows())),
        ("length_covariance", result.lengths.as_ref().map(LengthCovariance::rows)),
    ];
    for (key, rows) in matrices.into_iter().filter_map(|(key, rows)| Some((key, rows?))) {
        table.insert(key.to_owned(), toml::Value::try_from(rows).map_err(|e| e.to_string())?);
    }
    table.insert("measurements".to_owned(), toml::Value::Table(measurements));
    let body = toml::to_string(&table).map_err(|e| e.to_string())?;
    let head = "# A calibration. covariance_m2 is that of x1, y1, z1, x2, .. in m²; coordinates fixed by the choice of frame have rows of zeros.\n\
        # length_covariance is that of what the lengths depend on: per cable x, y, z of the anchor less those of its tie (m), scale, radius (m).\n";
    Ok(format!("{head}{body}"))
}
