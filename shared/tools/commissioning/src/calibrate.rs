//! `nims calibrate`: computes the anchors and their standard deviations from a measurements file, or explains why it
//! cannot.

pub use site_calibration::calibrate::{
    CalibrationResult, HeightBy, HeightEntry, MeasurementsFile, PointDecision, PointEntry, RangeEntry, Setup,
    TapeEntry, file_text, honest_calibration, judge, places, tape_scales,
};

use crate::config_kind::measurements;
use calibration::Method;
use clap::ValueEnum;
use command::values::above_zero;
use command::{Answer, Failure, Output};
use config::FileKind;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// `nims calibrate`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Measurements file; configs/measurements holds commented examples.
    pub measurements: PathBuf,
    /// Calibration method; default: joint for pulleys (pulley = "swivel"), otherwise survey.
    #[arg(long, value_enum)]
    pub method: Option<CalibrationMethod>,
    /// Write the calibration, its covariance and the measurements to this new file.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Print where to hold the node for COUNT points, and the expected accuracy of the anchors, instead of calibrating.
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u8).range(3..), conflicts_with = "out")]
    pub plan: Option<u8>,
    /// With --plan: approximate height of the pulleys, m; needed while the measurements do not determine it.
    #[arg(long, value_name = "M", value_parser = above_zero, requires = "plan")]
    pub height: Option<f64>,
}

/// Calibration methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CalibrationMethod {
    /// x and y from ranges between plumb lines, heights from cable lengths at points of the reference plane.
    Survey,
    /// All unknowns at once by maximum likelihood; optionally scale and zero offsets of the lengths, and outliers.
    Joint,
    /// Each anchor from points with known positions.
    Gps,
}

/// Runs `nims calibrate`.
///
/// # Errors
/// The file cannot be used, the measurements do not determine the anchors, or the result cannot be written.
pub fn run(args: &Args) -> Answer<Output> {
    if let Some(out) = args.out.as_deref().filter(|out| out.exists()) {
        let out = out.display();
        return Err(Failure::BadInput(format!("{out} already exists; name a new file or move this one")));
    }
    let path = args.measurements.as_path();
    let file: MeasurementsFile = measurements(FileKind::Measurements, path)?;
    let method = match args.method {
        None => file.usual_method(),
        Some(CalibrationMethod::Survey) => Method::Survey,
        Some(CalibrationMethod::Joint) => Method::Joint,
        Some(CalibrationMethod::Gps) => Method::Gps,
    };
    let refuse = |why: String| Failure::bad(format!("{}: {why}", path.display()));
    if let Some(count) = args.plan {
        let measured = file.measurements(method).map_err(refuse)?;
        let (value, words) = places::places(&measured, method, count.into(), args.height)
            .map_err(|refusal| Failure::bad(format!("{}: {refusal}", path.display())))?;
        return Ok(Output::new(value, words.trim_end()));
    }
    let result = judge(&file, method).map_err(refuse)?;
    if let Some(out) = &args.out {
        write(out, path, &result)?;
    }
    Ok(Output::new(result.value, result.words.trim_end()))
}

/// Writes the calibration and the measurements that it was computed from to a new file.
fn write(out: &Path, measurements: &Path, result: &CalibrationResult) -> Answer {
    let cannot = |why: String| Failure::NotNow(format!("{} cannot be written: {why}", out.display()));
    let raw: toml::Table = config::toml_file::load(measurements).map_err(Failure::bad)?;
    let text = file_text(result, raw, runlog::utc(bus::clock::unix_ns())).map_err(cannot)?;
    // create_new never overwrites a file that was created in the meantime.
    let mut file = std::fs::File::create_new(out).map_err(|e| cannot(e.to_string()))?;
    file.write_all(text.as_bytes()).and_then(|()| file.sync_all()).map_err(|e| cannot(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    fn calibrated(text: &str, method: CalibrationMethod) -> Answer<Value> {
        let folder = tempfile::tempdir().unwrap();
        let measurements = folder.path().join("site.toml");
        std::fs::write(&measurements, text).unwrap();
        run(&Args { measurements, method: Some(method), out: None, plan: None, height: None })
            .map(|output| output.value)
    }

    const RANGES: &str = "[[range]]\nfrom = 1\nto = 3\nm = 10.0\n[[range]]\nfrom = 1\nto = 2\nm = 8.0\n\
        [[range]]\nfrom = 2\nto = 3\nm = 6.0\n";

    /// Lengths from anchors at (0, 0, 3), (8, 0, 3), (8, 6, 3).
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
                for (k, coordinate) in expected.iter().enumerate() {
                    assert!((found["anchors_m"][i][k].as_f64().unwrap() - coordinate).abs() < 1e-6, "{found}");
                }
                assert!(found["anchor_std_m"][i][2].as_f64().unwrap() > 0.001);
            }
            assert!(found["rms_residual_m"].as_f64().unwrap() < 1e-6);
            assert_eq!(found["points_m"].as_array().unwrap().len(), 4);
            assert!(found["holdout_rms_m"].is_number() || found["holdout_rms_m"].is_null());
        }
    }

    #[test]
    fn unusable_measurements_are_rejected_with_the_file_name() {
        let line = format!("{RANGES}{}{}{}", point(1.0, 1.0), point(2.0, 1.0), point(5.0, 1.0));
        let two = format!("{RANGES}{}{}", point(1.0, 1.0), point(2.0, 3.0));
        let cases = [
            (line, "line"),
            (two, ""),
            (String::new(), ""),
            (example().replace("m = 8.0", "m = 80.0"), "80"),
            (example().replace("from = 2", "from = 0"), "1"),
            (example().replace("from = 2", "from = 3"), "3"),
            (format!("side = 2\n{}", example()), "side"),
            (format!("sigma_length_m = nan\n{}", example()), "NaN"),
            (format!("sigma = 1.0\n{}", example()), "`sigma`"),
            (format!("{}[[point]]\nlengths_m = [5.0, 5.0]\n", example()), "3"),
            (format!("{}[[point]]\nlengths_m = [5.0, 5.0, -1.0]\n", example()), "-1"),
            (format!("{}[[height]]\nanchor = 2\nm = 0.0\n", example()), "2"),
        ];
        let mut given = Vec::new();
        for (number, (text, expected)) in (1..).zip(cases) {
            let failure = calibrated(&text, CalibrationMethod::Survey).unwrap_err();
            assert_eq!(failure.exit_code(), 2);
            let sentence = failure.to_string();
            assert!(sentence.contains(expected) && sentence.contains("site.toml"), "{sentence}");
            assert_eq!(sentence.lines().count(), 1);
            given.push((format!("case {number}"), after_folder(&sentence)));
        }
        let failure = calibrated(&example(), CalibrationMethod::Gps).unwrap_err();
        assert_eq!(failure.exit_code(), 2);
        given.push(("without positions".to_owned(), after_folder(&failure.to_string())));
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/calibrate.txt");
        sentences::compare_with(&file, given);
    }

    /// The sentence from the name of the file on: its folder differs between runs.
    fn after_folder(sentence: &str) -> String {
        sentence.find("site.toml").map_or_else(|| sentence.to_owned(), |start| sentence[start..].to_owned())
    }

    #[test]
    fn the_calibration_file_is_complete_and_never_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let (measurements, out) = (folder.path().join("site.toml"), folder.path().join("calibration.toml"));
        std::fs::write(&measurements, example()).unwrap();
        let method = CalibrationMethod::Survey;
        let args = Args { measurements, method: Some(method), out: Some(out.clone()), plan: None, height: None };
        run(&args).unwrap();
        let written: toml::Table = toml::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
        assert_eq!(written["method"].as_str(), Some("survey"));
        assert_eq!(written["covariance_m2"].as_array().unwrap().len(), 9);
        assert_eq!(written["measurements"]["point"].as_array().unwrap().len(), 4);
        assert!(written["date"].as_str().unwrap().ends_with("UTC"));
        let before = std::fs::read(&out).unwrap();
        assert_eq!(run(&args).unwrap_err().exit_code(), 2);
        assert_eq!(std::fs::read(&out).unwrap(), before);
    }
}
