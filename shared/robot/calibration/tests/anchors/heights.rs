//! Further properties of a calibration: directly measured heights, outliers, excluded points, predicted accuracy.

use calibration::{DirectHeight, Loss, Measurements, Method, Undetermined, calibrate, hold_out, placement};

use super::stand_in::*;

#[test]
fn directly_measured_heights_are_used() {
    let anchors = three();
    let mut random = Random(11);
    let points = placement::corners(&flat(&anchors), 4, 0.9);
    let mut measured = Noise::plain(0.02, 0.003).measure(&mut random, &anchors, &points);
    let before = calibrate(&measured, Method::Survey).unwrap().covariance.std_m()[1][2];
    measured.heights = vec![DirectHeight { anchor: 1, m: anchors[1][2], sigma_m: 0.003, by_line: true }];
    for method in [Method::Survey, Method::Joint] {
        let found = calibrate(&measured, method).unwrap();
        assert!(found.covariance.std_m()[1][2] < 0.003 && before > 0.006, "{before}");
        assert!((found.anchors_m[1][2] - anchors[1][2]).abs() < 0.009);
    }
    // Both methods weight the same information.
    let (survey, joint) = (calibrate(&measured, Method::Survey).unwrap(), calibrate(&measured, Method::Joint).unwrap());
    for i in 0..3 {
        assert!((survey.covariance.std_m()[i][2] / joint.covariance.std_m()[i][2] - 1.0).abs() < 0.15);
    }
    // All heights are measured: no points are needed.
    measured.heights =
        (0..3).map(|anchor| DirectHeight { anchor, m: anchors[anchor][2], sigma_m: 0.003, by_line: false }).collect();
    measured.lengths_m.clear();
    for method in [Method::Survey, Method::Joint] {
        let found = calibrate(&measured, method).unwrap();
        for i in 0..3 {
            assert!((found.anchors_m[i][2] - anchors[i][2]).abs() < 1e-9);
            assert!((found.covariance.std_m()[i][2] - 0.003).abs() < 1e-9);
        }
        assert!(hold_out(&measured, method).unwrap().is_none());
    }
    // Points on a line, and one height that determines the tilt: only the joint method can use it.
    let line: Vec<[f64; 2]> = (0..6).map(|j| [2.0 + j as f64, 3.0]).collect();
    measured.heights.truncate(1);
    measured.lengths_m = line.iter().map(|c| lengths_to(&anchors, *c)).collect();
    let why = expect_undetermined(calibrate(&measured, Method::Survey));
    assert!(matches!(&why, Undetermined::WithoutHeights(_)) && why.is_line(), "{why}");
    let found = calibrate(&Measurements { sigma_length_m: 0.002, ..measured }, Method::Joint).unwrap();
    assert!((found.anchors_m[2][2] - anchors[2][2]).abs() < 0.05, "{:?}", found.anchors_m);
}

#[test]
fn scatter_beyond_the_stated_one_widens_the_deviations_and_names_the_outlier() {
    let anchors = four();
    let points = placement::corners(&flat(&anchors), 12, 0.9);
    let (mut alarms, mut alarms_beside_an_outlier, mut ratios) = (0, 0, 0.0);
    for trial in 0..100 {
        let honest = Noise::plain(0.01, 0.003).measure(&mut Random(trial), &anchors, &points);
        let found = calibrate(&honest, Method::Survey).unwrap();
        alarms += i32::from(found.widened_by > 1.0);
        ratios += found.noise_ratio.unwrap() / 100.0;
        let optimistic = Measurements { sigma_length_m: 0.002, ..honest.clone() };
        let widened = calibrate(&optimistic, Method::Survey).unwrap();
        assert!((2.0..8.0).contains(&widened.widened_by), "{}", widened.widened_by);
        let mut spoilt = honest;
        spoilt.lengths_m[4][2] += 0.5;
        spoilt.loss = Loss::Cauchy;
        let found = calibrate(&spoilt, Method::Joint).unwrap();
        alarms_beside_an_outlier += i32::from(found.widened_by > 1.0);
        let worst = found.outliers.iter().max_by(|a, b| a.residual_m.abs().total_cmp(&b.residual_m.abs())).unwrap();
        assert_eq!((worst.cable, worst.point), (2, 4));
        assert!((worst.residual_m - 0.5).abs() < 0.06, "{}", worst.residual_m);
    }
    assert!((0.95..1.05).contains(&ratios), "{ratios}");
    // One in a hundred by design; a few more with a robust loss.
    assert!(alarms <= 4 && alarms_beside_an_outlier <= 8, "{alarms} {alarms_beside_an_outlier}");
}

#[test]
fn excluded_points_are_predicted_with_the_accuracy_of_the_lengths() {
    let anchors = four();
    let mut random = Random(21);
    let points: Vec<_> = (0..15).map(|_| random.point_within(&anchors)).collect();
    let measured = Noise::plain(0.01, 0.003).measure(&mut random, &anchors, &points);
    for method in [Method::Survey, Method::Joint] {
        let found = calibrate(&measured, method).unwrap();
        let out = hold_out(&measured, method).unwrap().unwrap();
        assert_eq!(out.folds, 15);
        assert!(out.rms_m > found.rms_residual_m(), "in-sample is always smaller");
        assert!((0.004..0.02).contains(&out.rms_m), "{}", out.rms_m);
        assert!((0.005..0.08).contains(&out.position_rms_m), "{}", out.position_rms_m);
    }
    // Neither residuals nor excluded points reveal a scale error; only the model can. With few points
    // there is no result.
    let few = Measurements { lengths_m: measured.lengths_m[..3].to_vec(), refuse_above_std_m: 100.0, ..measured };
    assert!(hold_out(&few, Method::Survey).unwrap().is_none());
}

#[test]
fn the_predicted_accuracy_agrees_with_the_calibration() {
    let anchors = three();
    let points = placement::corners(&flat(&anchors), 6, 0.9);
    let plan = Noise::plain(0.01, 0.003).measure(&mut Random(1), &anchors, &[]);
    let predicted = placement::predict(&anchors, &points, &plan, Method::Survey).unwrap().std_m();
    let measured = Noise::plain(0.01, 0.003).measure(&mut Random(2), &anchors, &points);
    let found = calibrate(&measured, Method::Survey).unwrap().covariance.std_m();
    for i in 0..3 {
        assert!((predicted[i][2] / found[i][2] - 1.0).abs() < 0.1, "{predicted:?} {found:?}");
    }
}
