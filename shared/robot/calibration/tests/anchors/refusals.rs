//! Insufficient data are refused with a plain reason.

use calibration::heights::closed_form;
use calibration::{
    CalibrationError, JointInput, Measurements, Method, Undetermined, calibrate, calibrate_heights, calibrate_joint,
    placement,
};

use super::stand_in::*;

#[test]
fn a_sideways_shift_of_points_on_a_line_changes_no_length() {
    // The reason why two points are not enough for four cables, and a line never is.
    let (anchors, direction) = (four(), [0.6, 0.8]);
    let along = |t: f64| [2.0 + direction[0] * t, 1.0 + direction[1] * t];
    let e = [-0.3 * direction[1], 0.3 * direction[0]];
    let other: Vec<[f64; 3]> = anchors
        .iter()
        .map(|a| {
            let c = along(0.0);
            let w = a[2] * a[2] + 2.0 * (a[0] * e[0] + a[1] * e[1])
                - 2.0 * (c[0] * e[0] + c[1] * e[1])
                - (e[0] * e[0] + e[1] * e[1]);
            [a[0], a[1], w.sqrt()]
        })
        .collect();
    assert!((other[0][2] - anchors[0][2]).abs() > 0.05);
    for t in [0.0, 1.0, 2.5, 7.0] {
        let c = along(t);
        let (a, b) = (lengths_to(&anchors, c), lengths_to(&other, [c[0] + e[0], c[1] + e[1]]));
        assert!(a.iter().zip(b.iter()).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}

#[test]
fn insufficient_points_are_refused_for_every_number_of_cables() {
    for n in 3..=8 {
        let anchors: Vec<[f64; 3]> = (0..n)
            .map(|i| {
                let t = std::f64::consts::TAU * i as f64 / n as f64;
                [6.0 * t.cos(), 6.0 * t.sin(), 3.0 + 0.1 * i as f64]
            })
            .collect();
        let xy = flat(&anchors);
        let line = |t: f64| [1.0 + 0.6 * t, -0.5 + 0.8 * t];
        for m in 1..=12 {
            let mut random = Random((n * 100 + m) as u64);
            let exact: Vec<_> = (0..m).map(|j| lengths_to(&anchors, line(j as f64 / 3.0 - 2.0))).collect();
            let noisy: Vec<_> = exact.iter().map(|l| l.map(|v| v + random.normal(0.005))).collect();
            for lengths in [&exact, &noisy] {
                let why = expect_undetermined(calibrate_heights(&xy, lengths));
                assert!(if m < 3 { why == Undetermined::FewPoints { points: m } } else { why.is_line() }, "{why}");
                expect_error(calibrate_joint(&JointInput::new(&xy, lengths, 0.005)), "rank_deficient");
                let scaled = JointInput { sigma_scale: Some(0.01), ..JointInput::new(&xy, lengths, 0.005) };
                expect_error(calibrate_joint(&scaled), "rank_deficient");
            }
        }
        // Two arbitrary points.
        let two: Vec<_> = [[0.0, 1.0], [2.0, -1.0]].iter().map(|c| lengths_to(&anchors, *c)).collect();
        expect_error(calibrate_heights(&xy, &two), "rank_deficient");
    }
}

#[test]
fn nearly_collinear_points_are_refused_by_their_predicted_deviation() {
    let anchors = four();
    let strip = |half_width: f64| -> Vec<[f64; 2]> {
        (0..10).map(|j| [1.0 + 0.8 * j as f64, 4.0 + if j % 2 == 0 { half_width } else { -half_width }]).collect()
    };
    for method in [Method::Survey, Method::Joint] {
        let measure = |half_width: f64| Noise::plain(0.01, 0.003).measure(&mut Random(3), &anchors, &strip(half_width));
        let why = expect_undetermined(calibrate(&measure(0.02), method));
        assert!(why.is_line(), "{why}");
        let found = calibrate(&measure(3.0), method).unwrap();
        assert!(found.covariance.worst().2 < 0.05);
        // The required width of the strip depends on the standard deviation, not on a fixed angle:
        // better lengths need less.
        let mut better = measure(0.08);
        expect_error(calibrate(&Measurements { refuse_above_std_m: 0.2, ..better.clone() }, method), "rank_deficient");
        better = Noise::plain(0.0005, 0.0005).measure(&mut Random(3), &anchors, &strip(0.08));
        assert!(calibrate(&Measurements { refuse_above_std_m: 0.2, ..better }, method).is_ok());
    }
}

#[test]
fn negative_squared_heights_are_an_error_and_not_clipped() {
    let mut anchors = three();
    anchors[1][2] = 0.4;
    let points = placement::corners(&flat(&anchors), 6, 0.9);
    // The length of cable 2 is measured 30 cm short: its anchor would have to be at an imaginary height.
    let lengths: Vec<_> =
        points.iter().map(|c| lengths_to(&anchors, *c).zip_map(&[0.0, -0.3, 0.0], |l, o| l + o)).collect();
    let error = expect_error(calibrate_heights(&flat(&anchors), &lengths), "no_real_height");
    assert!(matches!(error, CalibrationError::NoRealHeight { anchor: 2, .. }), "{error}");
    let xy = flat(&anchors);
    expect_error(calibrate_joint(&JointInput::new(&xy, &lengths, 0.01)), "no_real_height");
    // The regression itself still reports its result.
    assert!(closed_form(&xy, &lengths).unwrap().squared_heights_m2[1] < 0.0);
}
