//! The result of a calibration as text.

use super::honest;
use calibration::{self, Calibration, Holdout, Measurements, Method, UnmeasuredRadius};

/// Greatest standard deviation of an anchor coordinate in a good calibration, m: the position of the node is then about
/// as accurate as its cable lengths.
const GOOD_STD_M: f64 = 0.02;

/// Greatest standard deviation of an anchor coordinate in a usable calibration, m: moves are safe, maps are blurred.
const USABLE_STD_M: f64 = 0.08;

/// What the measurements leave open about the pulleys.
pub struct Questions<'a> {
    /// What a radius that was not measured would change; the covariance includes it.
    pub open: Option<&'a UnmeasuredRadius>,
    /// Whether a radius that was measured once may be a diameter. No covariance includes a mistake.
    pub slip: Option<String>,
}

/// Returns the verdict and, if necessary, what to do. `numbers`: indices of the points that were used, from 0.
pub fn verdict(found: &Calibration, measured: &Measurements, questions: &Questions<'_>, numbers: &[usize]) -> String {
    let (anchor, axis, std) = found.covariance.worst();
    let worst = say!(
        "the least certain coordinate is {} of anchor {}, ±{:.3} m (one standard deviation)",
        ["x", "y", "z"][axis],
        anchor + 1,
        std
    );
    let open = questions.open.and_then(|open| honest::open_question(measured, open));
    let mut text = if let Some(question) = open.as_ref().filter(|_| measured.pulley_radius_m.is_empty()) {
        say!("poor: {question}; {worst}")
    } else if let Some(question) = open.as_ref().filter(|_| std > GOOD_STD_M) {
        if std <= USABLE_STD_M { say!("usable: {worst}; {question}") } else { say!("poor: {worst}; {question}") }
    } else if let Some(slip) = questions.slip.as_ref().filter(|_| std <= USABLE_STD_M) {
        say!("usable: {worst}; {slip}")
    } else if std <= GOOD_STD_M {
        say!("good: {worst}")
    } else if std <= USABLE_STD_M {
        say!("usable: {worst}; points near the corners below the anchors would help most (nims calibrate --plan)")
    } else {
        say!(
            "poor: {worst}; add points near the corners below the anchors before a mission (nims calibrate --plan shows where)"
        )
    };
    if found.widened_by > 1.0 {
        text = say!(
            "{text}; the measurements scatter {:.1} times as much as stated, so the deviations are scaled by that factor; {}",
            found.widened_by,
            match found.method {
                Method::Joint | Method::Survey => {
                    say!("check for a moved plumb line, an uneven floor, a slipped cable or a wrong pulley_radius_m")
                }
                Method::Gps => say!("check the known positions"),
            }
        );
    }
    let far = |a: &&calibration::Outlier, b: &&calibration::Outlier| a.residual_m.abs().total_cmp(&b.residual_m.abs());
    if let Some(o) = found.outliers.iter().max_by(far) {
        text = say!(
            "{text}; point {} does not fit the others (largest residual: cable {}, {:.3} m); measure it again",
            numbers.get(o.point).unwrap_or(&o.point) + 1,
            o.cable + 1,
            o.residual_m
        );
    }
    if measured.lengths_m.is_empty() {
        text = say!("{text}; no points were measured, so nothing checks the heights");
    }
    text
}

/// Returns the whole result as text lines, the verdict last.
pub fn words(found: &Calibration, holdout: Option<&Holdout>, verdict: &str, counts_per_m: Option<&[f64]>) -> String {
    let mut lines: Vec<String> = Vec::new();
    for (i, (a, s)) in found.anchors_m.iter().zip(found.covariance.std_m()).enumerate() {
        lines.push(say!(
            "anchor {}: x {:9.4} ±{:.4}  y {:9.4} ±{:.4}  z {:9.4} ±{:.4} m",
            i + 1,
            a[0],
            s[0],
            a[1],
            s[1],
            a[2],
            s[2]
        ));
    }
    if found.scale_std > 0.0 {
        lines.push(say!("the measured lengths are {:.5} ±{:.5} times the true ones", found.scale, found.scale_std));
        if let Some(counts) = counts_per_m {
            let counts: Vec<f64> = counts.iter().map(|counts| counts * found.scale).collect();
            lines.push(say!(
                "this corresponds to {counts:.1?} counts per metre; a robot whose robot file names this calibration uses them"
            ));
        }
    }
    if let Some(radius_m) = found.pulley_radius_m.iter().copied().reduce(f64::max).filter(|r| *r > 0.0) {
        let (mm, std) = (1000.0 * radius_m, 1000.0 * found.pulley_radius_std_m);
        lines.push(if std > 0.0 {
            say!("pulleys: radius {mm:.1} ±{std:.1} mm, estimated")
        } else {
            say!("pulleys: radius {mm:.1} mm, as stated")
        });
    }
    for (i, (o, s)) in found.offsets_m.iter().zip(found.offset_std_m.iter()).enumerate().filter(|(_, (_, s))| **s > 0.0)
    {
        lines.push(say!("cable {} reads {o:.4} ±{s:.4} m at length zero", i + 1));
    }
    if !found.residuals_m.is_empty() {
        lines.push(say!("residuals: {:.4} m root mean square (not an accuracy)", found.rms_residual_m()));
    }
    lines.push(match holdout {
        Some(h) => say!(
            "cross-validation: left-out points are predicted to {:.4} m in length and {:.4} m in position ({} calibrations)",
            h.rms_m,
            h.position_rms_m,
            h.folds
        ),
        None => say!("too few points for a cross-validation"),
    });
    lines.push(verdict.to_owned());
    lines.join("\n") + "\n"
}
