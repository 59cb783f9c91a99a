//! Plans where to hold the node for a calibration and predicts the accuracy of the anchors.

use cable_robot::Vector3;
use cable_robot::pulley::Pulley;
use calibration::placement::{corners, predict};
use calibration::{CalibrationError, Measurements, Method, calibrate, survey_network};
use command::{Answer, Failure};
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Distance of the places from the middle, as a share of the distance of the corner; nearer to a corner a cable hangs
/// slack.
const REACH: f64 = 0.9;

/// Plans `count` places for the node, the cable lengths to expect there, and the resulting standard deviations of the
/// anchors. `height_m` replaces heights that the measurements do not determine.
///
/// # Errors
/// Ranges that determine no anchor, undetermined heights, or places that determine no calibration.
pub fn places(measured: &Measurements, method: Method, count: usize, height_m: Option<f64>) -> Answer<(Value, String)> {
    let anchors = anchors(measured, method, height_m)?;
    let points = spots(&anchors, count);
    let expected = predict(&anchors, &points, measured, method).map_err(Failure::bad)?;
    let mut words = String::new();
    let mut rows = Vec::new();
    for (k, at) in points.iter().enumerate() {
        let near = k % anchors.len() + 1;
        let lengths = lengths(&anchors, &measured.pulley_radius_m, at);
        let read: Vec<String> = lengths.iter().map(|length| format!("{length:.2}")).collect();
        let _ = writeln!(
            words,
            "point {}: on the floor near the corner of anchor {near}, at x {:.2}, y {:.2} m; the cables read about {} m there",
            k + 1,
            at[0],
            at[1],
            read.join(", ")
        );
        rows.push(json!({ "near_anchor": near, "position_m": [at[0], at[1], 0.0], "lengths_m": lengths }));
    }
    for (i, std) in expected.std_m().iter().enumerate() {
        let _ = writeln!(words, "anchor {}: x ±{:.4}, y ±{:.4}, z ±{:.4} m expected", i + 1, std[0], std[1], std[2]);
    }
    words.push_str("a step away from these places is fine; the points need to be near the corners\n");
    Ok((json!({ "points": rows, "expected_anchor_std_m": expected.std_m() }), words))
}

/// Returns the first `count` places, x and y in m. A greater `count` does not move the first ones.
#[must_use]
pub fn spots(anchors: &[[f64; 3]], count: usize) -> Vec<[f64; 2]> {
    let flat: Vec<[f64; 2]> = anchors.iter().map(|a| [a[0], a[1]]).collect();
    corners(&flat, count, REACH)
}

/// Returns the cable lengths with the node on the floor at x and y, m; `radii_m` of the pulleys, empty for eyes.
#[must_use]
pub fn lengths(anchors: &[[f64; 3]], radii_m: &[f64], at: &[f64; 2]) -> Vec<f64> {
    let length = |(i, anchor): (usize, &[f64; 3])| {
        let radius_m = radii_m.get(i).copied().unwrap_or(0.0);
        if radius_m == 0.0 {
            return ((anchor[0] - at[0]).powi(2) + (anchor[1] - at[1]).powi(2) + anchor[2].powi(2)).sqrt();
        }
        let pulley = Pulley::new(Vector3::from(*anchor), radius_m);
        pulley.length_m(&Vector3::new(at[0], at[1], 0.0))
    };
    anchors.iter().enumerate().map(length).collect()
}

/// Estimates the anchors: from the points where they determine it, otherwise from the ranges with measured or
/// approximate heights.
fn anchors(measured: &Measurements, method: Method, height_m: Option<f64>) -> Answer<Vec<[f64; 3]>> {
    match calibrate(measured, method) {
        Ok(found) => return Ok(found.anchors_m),
        Err(CalibrationError::RankDeficient(_)) => {}
        Err(error) => return Err(Failure::bad(error)),
    }
    let survey = survey_network(measured.cable_count, &measured.ranges, &measured.sides).map_err(Failure::bad)?;
    let height_of = |anchor: usize| measured.heights.iter().find(|h| h.anchor == anchor).map(|h| h.m).or(height_m);
    let placed = survey.anchors_xy_m.iter().enumerate();
    placed.map(|(i, [x, y])| height_of(i).map(|z| [*x, *y, z])).collect::<Option<_>>().ok_or_else(|| {
        Failure::bad(
            "the measurements do not determine the height of the pulleys yet; give an approximate height, e.g. --height 3".to_owned(),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::CableVec;
    use calibration::Range;

    fn ranges() -> Measurements {
        let mut measured = Measurements::new(3);
        for (from, to, m) in [(0, 1, 9.8), (0, 2, 9.1), (1, 2, 9.4)] {
            measured.ranges.push(Range { from, to, m, sigma_m: 0.003 });
        }
        measured
    }

    #[test]
    fn predicted_accuracy_matches_points_at_the_planned_places() {
        let (value, words) = places(&ranges(), Method::Survey, 9, Some(3.1)).unwrap();
        assert!(words.lines().count() == 13 && words.contains("point 9"), "{words}");
        // Points measured at the planned places give the predicted standard deviations.
        let mut measured = ranges();
        for point in value["points"].as_array().unwrap() {
            let lengths: Vec<f64> = serde_json::from_value(point["lengths_m"].clone()).unwrap();
            measured.lengths_m.push(CableVec::from_slice(&lengths).unwrap());
        }
        let found = calibrate(&measured, Method::Survey).unwrap();
        let promised: Vec<[f64; 3]> = serde_json::from_value(value["expected_anchor_std_m"].clone()).unwrap();
        for (is, said) in found.covariance.std_m().iter().flatten().zip(promised.iter().flatten()) {
            assert!((is - said).abs() < 1e-9, "{is} {said}");
        }
        assert!(found.anchors_m.iter().all(|anchor| (anchor[2] - 3.1).abs() < 1e-6));
        // More points reduce the standard deviations, and the file itself now determines the heights.
        let (more, _) = places(&measured, Method::Survey, 36, None).unwrap();
        let worst = |value: &Value| value["expected_anchor_std_m"][0][2].as_f64().unwrap();
        assert!(worst(&more) < 0.6 * worst(&value), "{} {}", worst(&more), worst(&value));
    }

    #[test]
    fn undetermined_heights_require_an_argument() {
        let refusal = places(&ranges(), Method::Survey, 9, None).unwrap_err();
        assert!(refusal.to_string().contains("--height"), "{refusal}");
        assert_eq!(refusal.exit_code(), 2);
    }
}
