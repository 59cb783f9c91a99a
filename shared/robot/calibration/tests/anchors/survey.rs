//! Anchors from ranges and from GPS, and properties that hold for any measurements.

use cable_robot::{CableVec, Vector3};
use calibration::{
    Ambiguity, CalibrationError, JointInput, Loss, Measurements, Method, Range, Side, Undetermined, calibrate,
    calibrate_heights, calibrate_joint, fourth_anchor, gps_anchor, hold_out, placement, points_from_rows,
    survey_anchors, survey_network,
};
use proptest::prelude::*;

use super::stand_in::*;

#[test]
fn gps_gives_the_upper_anchor_with_its_standard_deviation() {
    let anchors = three();
    let ground = [[1.0, 0.5, 0.1], [8.5, 0.7, -0.2], [4.5, 6.5, 0.3], [5.0, 2.0, 0.0], [3.0, 4.0, 0.1]];
    let (mut inside, trials) = (0, 400);
    for trial in 0..trials {
        let mut random = Random(trial);
        let lengths_m = ground
            .iter()
            .map(|p| {
                CableVec::from_fn(3, |i| (Vector3::from(anchors[i]) - Vector3::from(*p)).norm() + random.normal(0.01))
            })
            .collect();
        let gps_m = ground.iter().map(|p| p.map(|v| v + random.normal(0.01))).collect();
        let measured = Measurements { lengths_m, gps_m, sigma_gps_m: 0.01, ..Measurements::new(3) };
        let found = calibrate(&measured, Method::Gps).unwrap();
        for i in 0..3 {
            let error = Vector3::from(found.anchors_m[i]) - Vector3::from(anchors[i]);
            inside += u32::from(found.covariance.contains_95(i, &error));
        }
        if trial == 0 {
            assert!(hold_out(&measured, Method::Gps).unwrap().unwrap().position_rms_m < 0.3);
        }
    }
    let share = f64::from(inside) / (3 * trials) as f64;
    assert!((0.93..=0.975).contains(&share), "{share}");
}

#[test]
fn gps_errors_have_their_kinds() {
    let p = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
    expect_error(gps_anchor(&p, &[1.0, 1.0, 1.0]), "unreachable");
    expect_error(gps_anchor(&p, &[1.0, f64::NAN, 1.0]), "invalid_argument");
    expect_error(gps_anchor(&p, &[1.0, -1.0, 1.0]), "invalid_argument");
    expect_error(gps_anchor(&[p[0], p[1], [8.0, 0.0, 0.0]], &[5.0, 5.0, 5.0]), "degenerate_geometry");
    expect_error(gps_anchor(&[p[0], p[1], [0.0, 0.0, 4.0]], &[5.0, 5.0, 5.0]), "ambiguous");
}

#[test]
fn surveys_refuse_ranges_that_form_no_triangle() {
    expect_error(survey_anchors([3.0, 9.0, 4.0], Side::Left), "degenerate_geometry");
    expect_error(survey_anchors([4.0, 10.0, 6.0], Side::Left), "degenerate_geometry");
    expect_error(survey_anchors([4.0, 0.0, 4.0], Side::Left), "degenerate_geometry");
    expect_error(survey_anchors([4.0, -5.0, 4.0], Side::Left), "invalid_argument");
    expect_error(survey_anchors([4.0, f64::NAN, 4.0], Side::Left), "invalid_argument");
    let xy = [[0.0, 0.0], [8.0, 0.0], [8.0, 6.0]];
    expect_error(fourth_anchor(&xy, &[6.0, 10.0], None), "ambiguous");
    expect_error(fourth_anchor(&xy, &[1.0, 2.0], Some(Side::Left)), "degenerate_geometry");
    expect_error(fourth_anchor(&xy, &[6.0], Some(Side::Left)), "invalid_argument");
    let line = [[0.0, 0.0], [4.0, 0.0], [8.0, 0.0]];
    expect_error(fourth_anchor(&line, &[5.0, 3.0, 5.0], None), "degenerate_geometry");
    let left = fourth_anchor(&xy, &[6.0, 10.0], Some(Side::Left)).unwrap();
    let right = fourth_anchor(&xy, &[6.0, 10.0], Some(Side::Right)).unwrap();
    assert!((left[1] - 6.0).abs() < 1e-12 && (right[1] + 6.0).abs() < 1e-12);
    assert!(Side::from_sign(0).is_err());
}

#[test]
fn a_network_names_the_range_that_is_missing() {
    let range = |from, to, m| Range { from, to, m, sigma_m: 0.003 };
    let triangle = [range(0, 1, 8.0), range(0, 2, 10.0), range(1, 2, 6.0)];
    assert_eq!(expect_undetermined(survey_network(3, &triangle[1..], &[])), Undetermined::NoBaseline);
    assert_eq!(
        expect_undetermined(survey_network(4, &triangle, &[])),
        Undetermined::FewRanges { anchor: 4, ranges: 0 }
    );
    let mut two = triangle.to_vec();
    two.extend([range(0, 3, 6.0), range(3, 1, 10.0)]);
    let error = expect_error(survey_network(4, &two, &[]), "ambiguous");
    assert_eq!(error, CalibrationError::Ambiguous(Ambiguity::Anchor { anchor: 4, from: 1, to: 2 }));
    let found = survey_network(4, &two, &[None, None, None, Some(Side::Right)]).unwrap();
    assert!((found.anchors_xy_m[3][1] + 6.0).abs() < 1e-9);
    let error = expect_error(survey_network(3, &[range(0, 1, 8.0), range(1, 1, 1.0)], &[]), "invalid_argument");
    assert_eq!(error.to_string().matches('2').count(), 2, "it names the anchor twice: {error}");
    expect_error(survey_network(3, &[range(0, 7, 8.0)], &[]), "invalid_argument");
}

#[test]
fn rows_by_cable_become_points() {
    let points = points_from_rows(&[vec![1.0, 2.0], vec![3.0, 4.0], vec![5.0, 6.0]]).unwrap();
    assert_eq!(points[1][..], [2.0, 4.0, 6.0]);
    expect_error(points_from_rows(&[vec![1.0, 2.0], vec![3.0]]), "invalid_argument");
    expect_error(points_from_rows(&vec![vec![1.0]; 9]), "invalid_argument");
    let nan = points_from_rows(&[[1.0, f64::NAN, 1.0], [1.0; 3], [1.0; 3]]).unwrap();
    expect_error(calibrate_heights(&flat(&three()), &nan), "invalid_argument");
    let line = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]];
    expect_error(calibrate_heights(&line, &points), "degenerate_geometry");
    expect_error(calibrate_heights(&flat(&three())[..2], &points), "invalid_argument");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_survey_recovers_the_anchors(x2 in 1.0..30.0f64, x3 in -20.0..40.0f64, y3 in 0.1..30.0f64, x4 in -20.0..40.0f64, y4 in -30.0..30.0f64, left in any::<bool>()) {
        let side = if left { Side::Left } else { Side::Right };
        let y3 = if left { y3 } else { -y3 };
        let truth = [[0.0, 0.0], [x2, 0.0], [x3, y3]];
        let d = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let found = survey_anchors([d(truth[0], truth[2]), x2, d(truth[1], truth[2])], side).unwrap();
        prop_assert!(d(found[2], truth[2]) < 1e-9 * (1.0 + 900.0 / y3.abs()), "{found:?} {truth:?}");
        let fourth = [x4, y4];
        let ranges = [d(truth[0], fourth), d(truth[1], fourth), d(truth[2], fourth)];
        prop_assume!(ranges.iter().all(|r| *r > 0.1));
        let by_three = fourth_anchor(&truth, &ranges, None).unwrap();
        prop_assert!(d(by_three, fourth) < 1e-6, "{by_three:?} {fourth:?}");
        if y4.abs() > 0.1 {
            let side = if y4 > 0.0 { Side::Left } else { Side::Right };
            let by_two = fourth_anchor(&truth, &ranges[..2], Some(side)).unwrap();
            prop_assert!(d(by_two, fourth) < 1e-9 * (1.0 + 900.0 / y4.abs()), "{by_two:?} {fourth:?}");
        }
    }

    #[test]
    fn exact_measurements_give_exact_anchors(seed in any::<u64>(), n in 3usize..=6, m in 4usize..12) {
        let mut random = Random(seed);
        let anchors: Vec<[f64; 3]> = (0..n).map(|i| {
            let t = std::f64::consts::TAU * i as f64 / n as f64;
            [6.0 * t.cos() + random.uniform(), 6.0 * t.sin() + random.uniform(), 2.0 + 2.0 * random.uniform()]
        }).collect();
        let points: Vec<_> = placement::corners(&flat(&anchors), m.max(n), 0.9);
        let lengths: Vec<_> = points.iter().map(|c| lengths_to(&anchors, *c)).collect();
        let xy = flat(&anchors);
        let found = calibrate_heights(&xy, &lengths).unwrap();
        prop_assert!(found.cost_m4 < 1e-18);
        let ranges: Vec<_> = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).map(|(from, to)| {
            Range { from, to, m: (xy[from][0] - xy[to][0]).hypot(xy[from][1] - xy[to][1]), sigma_m: 0.01 }
        }).collect();
        let input = JointInput { ranges: &ranges, sigma_scale: Some(0.01), sigma_offset_m: Some(0.01), ..JointInput::new(&xy, &lengths, 0.005) };
        let joint = calibrate_joint(&input).unwrap();
        for i in 0..n {
            prop_assert!((found.heights_m[i] - anchors[i][2]).abs() < 1e-9);
            prop_assert!((joint.anchors_m[i][2] - anchors[i][2]).abs() < 1e-7);
        }
        prop_assert!((joint.scale - 1.0).abs() < 1e-9);
    }

    #[test]
    fn nothing_panics_and_results_are_finite(rows in proptest::collection::vec(proptest::collection::vec(prop_oneof![Just(0.0), Just(f64::NAN), Just(1e300), -1.0..20.0f64], 5), 3..5), x in -5.0..15.0f64, y in -5.0..15.0f64) {
        let xy = [[0.0, 0.0], [9.8, 0.0], [x, y], [1.0, 7.0]];
        let lengths = points_from_rows(&rows).unwrap();
        if let Ok(found) = calibrate_heights(&xy[..rows.len()], &lengths) {
            prop_assert!(found.heights_m.is_finite());
        }
        let input = JointInput { sigma_scale: Some(0.01), loss: Loss::Cauchy, ..JointInput::new(&xy[..rows.len()], &lengths, 0.01) };
        if let Ok(found) = calibrate_joint(&input) {
            prop_assert!(found.anchors_m.iter().flatten().all(|v| v.is_finite()));
        }
    }
}
