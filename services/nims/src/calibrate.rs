//! `nims calibrate`: a file of measurements in, anchors with their deviations out, or a refusal in plain words.

mod places;

use crate::cli::{Calibrate, CalibrationMethod};
use crate::failure::{Answer, Failure};
use cable_robot::CableVec;
use cable_robot::calibration::{
    self, AnchorCovariance, Calibration, DirectHeight, Holdout, Loss, Measurements, Method, Range, Side,
};
use serde::Deserialize;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Standard deviation of a range where none is stated, m: a laser of ±1.5 mm, and a plumb line that is never quite still.
const DEFAULT_SIGMA_RANGE_M: f64 = 0.003;

/// Standard deviation of a directly measured height where none is stated, m: the floor below the pulley is not quite the
/// reference plane.
const DEFAULT_SIGMA_HEIGHT_M: f64 = 0.01;

/// Worst standard deviation of an anchor up to which a calibration is called good, m: the node is then about as well placed as
/// its lines are measured.
const GOOD_STD_M: f64 = 0.02;

/// The same for usable: moves are safe, maps are blurred.
const USABLE_STD_M: f64 = 0.08;

/// The measurements file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// Side of the line from anchor 1 to 2 on which anchor 3 stands, and any other anchor that has no side of its own:
    /// 1 left (default), -1 right.
    side: Option<i64>,
    sigma_length_m: Option<f64>,
    sigma_range_m: Option<f64>,
    sigma_gps_m: Option<f64>,
    sigma_scale: Option<f64>,
    sigma_offset_m: Option<f64>,
    /// What the robot reckoned the lengths with, if they are its own.
    counts_per_m: Option<Vec<f64>>,
    loss: Option<LossName>,
    refuse_above_std_m: Option<f64>,
    #[serde(default)]
    range: Vec<RangeEntry>,
    #[serde(default)]
    point: Vec<PointEntry>,
    #[serde(default)]
    height: Vec<HeightEntry>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LossName {
    Squared,
    Huber,
    Cauchy,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RangeEntry {
    from: usize,
    to: usize,
    m: f64,
    sigma_m: Option<f64>,
    /// Of the anchor with the higher number.
    side: Option<i64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PointEntry {
    lengths_m: Vec<f64>,
    gps_m: Option<[f64; 3]>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct HeightEntry {
    anchor: usize,
    m: f64,
    sigma_m: Option<f64>,
    by: Option<HeightBy>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum HeightBy {
    Line,
    Tape,
    Laser,
}

impl File {
    fn measurements(&self, method: Method) -> Result<Measurements, String> {
        let named = self.range.iter().flat_map(|r| [r.from, r.to]).chain(self.height.iter().map(|h| h.anchor));
        let cables = named.chain(self.point.iter().map(|p| p.lengths_m.len())).max().unwrap_or(0);
        if cables == 0 {
            return Err("it holds no measurements; give [[range]], [[point]] and [[height]] entries".to_owned());
        }
        let index = |what: &str, anchor: usize| {
            anchor.checked_sub(1).ok_or_else(|| format!("{what} names anchor 0; anchors count from 1"))
        };
        let mut measured = Measurements::new(cables);
        if cables > cable_robot::MAX_CABLES {
            return Err(format!("it names {cables} anchors; a robot has at most {}", cable_robot::MAX_CABLES));
        }
        let side = self.side.map(Side::from_sign).transpose().map_err(|e| e.to_string())?;
        measured.sides = vec![side; cables];
        for (k, r) in self.range.iter().enumerate() {
            let what = format!("[[range]] number {}", k + 1);
            let (from, to) = (index(&what, r.from)?, index(&what, r.to)?);
            if let Some(sign) = r.side {
                measured.sides[from.max(to)] = Some(Side::from_sign(sign).map_err(|e| format!("{what}: {e}"))?);
            }
            let sigma_m = r.sigma_m.or(self.sigma_range_m).unwrap_or(DEFAULT_SIGMA_RANGE_M);
            measured.ranges.push(Range { from, to, m: r.m, sigma_m });
        }
        for (k, p) in self.point.iter().enumerate() {
            if method == Method::Gps && p.gps_m.is_none() {
                continue;
            }
            measured
                .lengths_m
                .push(CableVec::from_slice(&p.lengths_m).map_err(|e| format!("[[point]] number {}: {e}", k + 1))?);
            measured.gps_m.extend(p.gps_m);
        }
        for (k, h) in self.height.iter().enumerate() {
            measured.heights.push(DirectHeight {
                anchor: index(&format!("[[height]] number {}", k + 1), h.anchor)?,
                m: h.m,
                sigma_m: h.sigma_m.unwrap_or(DEFAULT_SIGMA_HEIGHT_M),
                by_line: h.by.unwrap_or(HeightBy::Line) == HeightBy::Line,
            });
        }
        if let Some(counts) = &self.counts_per_m
            && (counts.len() != cables || counts.iter().any(|counts| !counts.is_finite() || *counts == 0.0))
        {
            return Err(format!(
                "counts_per_m is {counts:?}; accepted: one value for each of the {cables} lines, as in the box file; no key where the lengths are not the robot's own"
            ));
        }
        let set = |key: &mut f64, value: Option<f64>| *key = value.unwrap_or(*key);
        set(&mut measured.sigma_length_m, self.sigma_length_m);
        set(&mut measured.sigma_gps_m, self.sigma_gps_m);
        set(&mut measured.refuse_above_std_m, self.refuse_above_std_m);
        measured.sigma_scale = self.sigma_scale;
        measured.sigma_offset_m = self.sigma_offset_m;
        measured.loss = match self.loss {
            Some(LossName::Squared) => Loss::Squared,
            Some(LossName::Cauchy) => Loss::Cauchy,
            // A field team's data hold an outlier sooner or later, and without one this costs 5 %.
            Some(LossName::Huber) | None => Loss::Huber,
        };
        Ok(measured)
    }
}

/// Calibrates; prints JSON on stdout, and words on stderr unless only JSON is wanted.
///
/// # Errors
/// A file that cannot be used, measurements that determine nothing, or a result that cannot be written.
pub fn calibrate(asked: &Calibrate, json_only: bool) -> Answer<Value> {
    if let Some(out) = asked.out.as_deref().filter(|out| out.exists()) {
        let out = out.display();
        return Err(Failure::BadInput(format!("{out} is there already; name a new file, or move that one away")));
    }
    let path = asked.measurements.as_path();
    let file: File = service::toml_file::load(path).map_err(Failure::bad)?;
    let method = match asked.method {
        CalibrationMethod::Survey => Method::Survey,
        CalibrationMethod::Joint => Method::Joint,
        CalibrationMethod::Gps => Method::Gps,
    };
    let refuse = |why: String| Failure::bad(format!("{}: {why}", path.display()));
    let measured = file.measurements(method).map_err(refuse)?;
    if let Some(count) = asked.plan {
        let (value, words) = places::places(&measured, method, count.into(), asked.height)
            .map_err(|refusal| Failure::bad(format!("{}: {refusal}", path.display())))?;
        if !json_only {
            eprint!("{words}");
        }
        return Ok(value);
    }
    let found = calibration::calibrate(&measured, method).map_err(|e| refuse(e.to_string()))?;
    let holdout = calibration::hold_out(&measured, method).map_err(|e| refuse(e.to_string()))?;
    let verdict = verdict(&found, &measured);
    let mut value = answer(&found, holdout.as_ref(), &verdict);
    value["counts_per_m"] = json!(file.counts_per_m);
    if !json_only {
        eprint!("{}", words(&found, holdout.as_ref(), &verdict, file.counts_per_m.as_deref()));
    }
    if let Some(out) = &asked.out {
        write(out, path, &value, &found.covariance)?;
    }
    Ok(value)
}

fn name(method: Method) -> &'static str {
    match method {
        Method::Survey => "survey",
        Method::Joint => "joint",
        Method::Gps => "gps",
    }
}

fn answer(found: &Calibration, holdout: Option<&Holdout>, verdict: &str) -> Value {
    let outliers: Vec<_> = found
        .outliers
        .iter()
        .map(|o| json!({ "cable": o.cable + 1, "point": o.point + 1, "residual_m": o.residual_m }))
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
        "noise_ratio": found.noise_ratio,
        "widened_by": found.widened_by,
        "outliers": outliers,
        "verdict": verdict,
    })
}

/// Good, and go on; or what to do about it.
fn verdict(found: &Calibration, measured: &Measurements) -> String {
    let (anchor, axis, std) = found.covariance.worst();
    let worst = format!(
        "the least certain coordinate is {} of anchor {}, ±{:.3} m (one standard deviation)",
        ["x", "y", "z"][axis],
        anchor + 1,
        std
    );
    let mut text = if std <= GOOD_STD_M {
        format!("good: {worst}")
    } else if std <= USABLE_STD_M {
        format!("usable: {worst}; points near the corners below the anchors would help most (nims calibrate --plan)")
    } else {
        format!(
            "poor: {worst}; add points near the corners below the anchors before a mission (nims calibrate --plan says where)"
        )
    };
    if found.widened_by > 1.0 {
        let _ = write!(
            text,
            "; the measurements scatter {:.1} times as much as stated, and the deviations are widened by that; {}",
            found.widened_by,
            match found.method {
                Method::Joint => "look for a moved plumb line, an uneven floor or a slipped line",
                Method::Survey => "look for outliers, a scale or a zero with the joint method",
                Method::Gps => "check the known positions",
            }
        );
    }
    let far = |a: &&calibration::Outlier, b: &&calibration::Outlier| a.residual_m.abs().total_cmp(&b.residual_m.abs());
    if let Some(o) = found.outliers.iter().max_by(far) {
        let _ = write!(
            text,
            "; point {} does not fit the others (most of all line {}, by {:.3} m): measure it again",
            o.point + 1,
            o.cable + 1,
            o.residual_m
        );
    }
    if measured.lengths_m.is_empty() {
        text.push_str("; no points were measured, so nothing checks the heights");
    }
    text
}

fn words(found: &Calibration, holdout: Option<&Holdout>, verdict: &str, counts_per_m: Option<&[f64]>) -> String {
    let mut text = String::new();
    for (i, (a, s)) in found.anchors_m.iter().zip(found.covariance.std_m()).enumerate() {
        let _ = writeln!(
            text,
            "anchor {}: x {:9.4} ±{:.4}  y {:9.4} ±{:.4}  z {:9.4} ±{:.4} m",
            i + 1,
            a[0],
            s[0],
            a[1],
            s[1],
            a[2],
            s[2]
        );
    }
    if found.scale_std > 0.0 {
        let _ = writeln!(text, "lengths read {:.5} ±{:.5} times the true ones", found.scale, found.scale_std);
        if let Some(counts) = counts_per_m {
            let counts: Vec<f64> = counts.iter().map(|counts| counts * found.scale).collect();
            let _ = writeln!(
                text,
                "so there are {counts:.1?} counts in a metre; a robot file that names this calibration says so to the robot"
            );
        }
    }
    for (i, (o, s)) in found.offsets_m.iter().zip(found.offset_std_m.iter()).enumerate().filter(|(_, (_, s))| **s > 0.0)
    {
        let _ = writeln!(text, "line {} reads {o:.4} ±{s:.4} m at length zero", i + 1);
    }
    if !found.residuals_m.is_empty() {
        let _ = writeln!(text, "residuals {:.4} m root mean square (not an accuracy)", found.rms_residual_m());
    }
    match holdout {
        Some(h) => {
            let _ = writeln!(
                text,
                "points left out are predicted to {:.4} m in length and {:.4} m in position ({} calibrations)",
                h.rms_m, h.position_rms_m, h.folds
            );
        }
        None => text.push_str("too few points to leave any out for a check\n"),
    }
    let _ = writeln!(text, "{verdict}");
    text
}

/// The calibration as a file of its own, with the measurements it comes from.
fn write(out: &Path, measurements: &Path, value: &Value, covariance: &AnchorCovariance) -> Answer {
    let cannot = |why: String| Failure::NotNow(format!("{} cannot be written: {why}", out.display()));
    let raw: toml::Table = service::toml_file::load(measurements).map_err(Failure::bad)?;
    let mut table = toml::Table::new();
    table.insert("date".to_owned(), toml::Value::String(runlog::utc(bus::clock::unix_ns())));
    for (key, value) in value.as_object().into_iter().flatten() {
        // TOML has no null: what is not known is not there.
        if !value.is_null() {
            table.insert(key.clone(), toml::Value::try_from(value).map_err(|e| cannot(e.to_string()))?);
        }
    }
    let rows: Vec<Vec<f64>> = covariance.matrix().row_iter().map(|row| row.iter().copied().collect()).collect();
    table.insert("covariance_m2".to_owned(), toml::Value::try_from(rows).map_err(|e| cannot(e.to_string()))?);
    table.insert("measurements".to_owned(), toml::Value::Table(raw));
    let body = toml::to_string(&table).map_err(|e| cannot(e.to_string()))?;
    let head =
        "# A calibration. covariance_m2 is that of x1, y1, z1, x2, .. in m²; what the gauge fixes has rows of zeros.\n";
    // Never over a file that appeared meanwhile.
    let mut file = std::fs::File::create_new(out).map_err(|e| cannot(e.to_string()))?;
    file.write_all(format!("{head}{body}").as_bytes()).and_then(|()| file.sync_all()).map_err(|e| cannot(e.to_string()))
}

/// Now in UTC, as RFC 3339 to the second.
#[cfg(test)]
mod tests {
    use super::*;

    fn calibrated(text: &str, method: CalibrationMethod) -> Answer<Value> {
        let folder = tempfile::tempdir().unwrap();
        let measurements = folder.path().join("site.toml");
        std::fs::write(&measurements, text).unwrap();
        calibrate(&Calibrate { measurements, method, out: None, plan: None, height: None }, true)
    }

    const RANGES: &str = "[[range]]\nfrom = 1\nto = 3\nm = 10.0\n[[range]]\nfrom = 1\nto = 2\nm = 8.0\n\
        [[range]]\nfrom = 2\nto = 3\nm = 6.0\n";

    /// Lengths from (0, 0, 3), (8, 0, 3), (8, 6, 3).
    fn point(x: f64, y: f64) -> String {
        let length = |a: f64, b: f64| ((a - x).powi(2) + (b - y).powi(2) + 9.0).sqrt();
        format!("[[point]]\nlengths_m = [{}, {}, {}]\n", length(0.0, 0.0), length(8.0, 0.0), length(8.0, 6.0))
    }

    fn example() -> String {
        format!("{RANGES}{}{}{}{}", point(1.0, 0.5), point(7.5, 0.5), point(7.5, 5.0), point(5.0, 2.0))
    }

    #[test]
    fn a_file_becomes_anchors_with_deviations() {
        for method in [CalibrationMethod::Survey, CalibrationMethod::Joint] {
            let found = calibrated(&example(), method).unwrap();
            for (i, expected) in [[0.0, 0.0, 3.0], [8.0, 0.0, 3.0], [8.0, 6.0, 3.0]].iter().enumerate() {
                for k in 0..3 {
                    assert!((found["anchors_m"][i][k].as_f64().unwrap() - expected[k]).abs() < 1e-6, "{found}");
                }
                assert!(found["anchor_std_m"][i][2].as_f64().unwrap() > 0.001);
            }
            assert!(found["rms_residual_m"].as_f64().unwrap() < 1e-6);
            assert_eq!(found["points_m"].as_array().unwrap().len(), 4);
            assert!(found["holdout_rms_m"].is_number() || found["holdout_rms_m"].is_null());
        }
    }

    #[test]
    fn what_cannot_be_used_is_refused_in_one_sentence_that_names_the_file() {
        let line = format!("{RANGES}{}{}{}", point(1.0, 1.0), point(2.0, 1.0), point(5.0, 1.0));
        let two = format!("{RANGES}{}{}", point(1.0, 1.0), point(2.0, 3.0));
        let cases = [
            (line, "line"),
            (two, "at least three"),
            (String::new(), "no measurements"),
            (example().replace("m = 8.0", "m = 80.0"), "no triangle"),
            (example().replace("from = 2", "from = 0"), "count from 1"),
            (example().replace("from = 2", "from = 3"), "two different anchors"),
            (format!("side = 2\n{}", example()), "side is 2"),
            (format!("sigma_length_m = nan\n{}", example()), "standard deviation"),
            (format!("sigma = 1.0\n{}", example()), "unknown field `sigma`"),
            (format!("{}[[point]]\nlengths_m = [5.0, 5.0]\n", example()), "2 lengths for 3 cables"),
            (format!("{}[[point]]\nlengths_m = [5.0, 5.0, -1.0]\n", example()), "is -1"),
            (format!("{}[[height]]\nanchor = 2\nm = 0.0\n", example()), "height of anchor 2"),
        ];
        for (text, expected) in cases {
            let failure = calibrated(&text, CalibrationMethod::Survey).unwrap_err();
            assert_eq!(failure.exit_code(), 2);
            let sentence = failure.to_string();
            assert!(sentence.contains(expected) && sentence.contains("site.toml"), "{sentence}");
            assert_eq!(sentence.lines().count(), 1);
        }
        let failure = calibrated(&example(), CalibrationMethod::Gps).unwrap_err().to_string();
        assert!(failure.contains("known positions"), "{failure}");
    }

    #[test]
    fn the_calibration_file_holds_all_of_it_and_is_never_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let (measurements, out) = (folder.path().join("site.toml"), folder.path().join("calibration.toml"));
        std::fs::write(&measurements, example()).unwrap();
        let method = CalibrationMethod::Survey;
        let asked = Calibrate { measurements, method, out: Some(out.clone()), plan: None, height: None };
        calibrate(&asked, true).unwrap();
        let written: toml::Table = toml::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
        assert_eq!(written["method"].as_str(), Some("survey"));
        assert_eq!(written["covariance_m2"].as_array().unwrap().len(), 9);
        assert_eq!(written["measurements"]["point"].as_array().unwrap().len(), 4);
        assert!(written["date"].as_str().unwrap().ends_with("UTC"));
        let before = std::fs::read(&out).unwrap();
        assert_eq!(calibrate(&asked, true).unwrap_err().exit_code(), 2);
        assert_eq!(std::fs::read(&out).unwrap(), before);
    }
}
