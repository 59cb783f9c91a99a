//! The joint estimator: scale, zeros and outliers, which the heights alone do not reveal, and its optimality.

use cable_robot::Vector3;
use calibration::{
    JointInput, Loss, Measurements, Method, Side, calibrate, calibrate_joint, placement, survey_network,
};

use super::stand_in::*;

/// Mean height error of the method of the paper and of the joint estimator on the same data.
fn compare_methods(spoil: impl Fn(&mut Random, &mut Measurements), m: usize, trials: u64) -> (f64, f64) {
    let anchors = three();
    let (mut paper, mut joint, mut count) = (0.0, 0.0, 0.0);
    for trial in 0..trials {
        let mut random = Random(0xd0e1 + trial);
        let points: Vec<_> = (0..m).map(|_| random.point_within(&anchors)).collect();
        let mut measured = Noise::plain(0.005, 0.002).measure(&mut random, &anchors, &points);
        measured.refuse_above_std_m = 100.0;
        spoil(&mut random, &mut measured);
        let (Ok(a), Ok(b)) = (calibrate(&measured, Method::Survey), calibrate(&measured, Method::Joint)) else {
            continue;
        };
        let error = |found: &[[f64; 3]]| (0..3).map(|i| (found[i][2] - anchors[i][2]).abs()).sum::<f64>() / 3.0;
        paper += error(&a.anchors_m);
        joint += error(&b.anchors_m);
        count += 1.0;
    }
    assert!(count > 0.9 * trials as f64, "{count}");
    (paper / count, joint / count)
}

#[test]
fn the_joint_estimator_finds_scale_zeros_and_outliers() {
    let (paper, joint) = compare_methods(
        |_, measured| {
            measured.lengths_m.iter_mut().for_each(|l| *l = l.map(|v| 1.01 * v));
            measured.sigma_scale = Some(0.02);
        },
        20,
        200,
    );
    println!("1 % scale, 20 points: paper {paper:.4} m, joint {joint:.4} m");
    assert!(paper > 0.08 && paper > 6.0 * joint, "{paper} {joint}");

    let (paper, joint) = compare_methods(
        |random, measured| {
            let zeros: Vec<f64> = (0..3).map(|_| random.normal(0.05)).collect();
            measured.lengths_m.iter_mut().for_each(|l| *l = l.zip_map(&zeros, |v, o| v + o));
            measured.sigma_offset_m = Some(0.05);
        },
        20,
        200,
    );
    println!("encoder zeros of 5 cm, 20 points: paper {paper:.4} m, joint {joint:.4} m");
    assert!(paper > 1.8 * joint, "{paper} {joint}");

    let outliers = |random: &mut Random, measured: &mut Measurements| {
        for l in measured.lengths_m.iter_mut().flat_map(|l| l.iter_mut()) {
            if random.uniform() < 0.05 {
                *l += 0.5 * (2.0 * random.uniform() - 1.0).signum();
            }
        }
    };
    let (paper, cauchy) = compare_methods(
        |random, measured| {
            outliers(random, measured);
            measured.loss = Loss::Cauchy;
        },
        20,
        200,
    );
    let (_, huber) = compare_methods(
        |random, measured| {
            outliers(random, measured);
            measured.loss = Loss::Huber;
        },
        20,
        200,
    );
    println!("5 % outliers of 0.5 m, 20 points: paper {paper:.4} m, Huber {huber:.4} m, Cauchy {cauchy:.4} m");
    assert!(paper > 2.7 * cauchy && cauchy < huber && huber < paper, "{paper} {huber} {cauchy}");
}

#[test]
fn exact_ranges_far_worse_than_lengths_are_refined_by_them() {
    // Plumb lines with an accuracy of 2 cm, lengths of 5 mm: lengths to many points determine x and y better.
    let anchors = three();
    let (mut before, mut after) = (0.0, 0.0);
    for trial in 0..100 {
        let mut random = Random(trial);
        let points: Vec<_> = (0..43).map(|_| random.point_within(&anchors)).collect();
        let measured = Noise::plain(0.005, 0.02).measure(&mut random, &anchors, &points);
        let error = |method| {
            let found = calibrate(&measured, method).unwrap();
            (0..3).map(|i| (Vector3::from(found.anchors_m[i]) - Vector3::from(anchors[i])).norm()).sum::<f64>() / 3.0
        };
        before += error(Method::Survey);
        after += error(Method::Joint);
    }
    println!("2 cm ranges, 5 mm lengths, 43 points: survey {:.4} m, joint {:.4} m", before / 100.0, after / 100.0);
    assert!(before > 1.8 * after, "{before} {after}");
}

#[test]
fn the_joint_optimum_is_stationary_and_lowest_among_neighbours() {
    for loss in [Loss::Squared, Loss::Huber, Loss::Cauchy] {
        let anchors = four();
        let mut random = Random(7);
        let points: Vec<_> = (0..9).map(|_| random.point_within(&anchors)).collect();
        let noise = Noise { scale: Some(0.01), offset_m: Some(0.02), ..Noise::plain(0.01, 0.01) };
        let measured = noise.measure(&mut random, &anchors, &points);
        let xy = survey_network(4, &measured.ranges, &[None, None, None, Some(Side::Left)]).unwrap().anchors_xy_m;
        let input = JointInput {
            ranges: &measured.ranges,
            sigma_scale: Some(0.01),
            sigma_offset_m: Some(0.02),
            loss,
            ..JointInput::new(&xy, &measured.lengths_m, 0.01)
        };
        let found = calibrate_joint(&input).unwrap();
        // An independent implementation of the cost, over one flat vector of unknowns.
        let cost = |v: &[f64]| {
            let anchor = |i: usize| [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
            let rho = |r: f64| match loss {
                Loss::Squared => r * r,
                Loss::Huber if r.abs() <= 1.345 => r * r,
                Loss::Huber => 2.0 * 1.345 * r.abs() - 1.345 * 1.345,
                Loss::Cauchy => 2.3849f64.powi(2) * (1.0 + (r / 2.3849).powi(2)).ln(),
            };
            let mut sum = ((v[12] - 1.0) / 0.01).powi(2);
            for i in 0..4 {
                sum += (v[13 + i] / 0.02).powi(2);
                for (j, l) in measured.lengths_m.iter().enumerate() {
                    let c = Vector3::new(v[17 + 2 * j], v[18 + 2 * j], 0.0);
                    sum += rho((v[12] * (Vector3::from(anchor(i)) - c).norm() + v[13 + i] - l[i]) / 0.01);
                }
            }
            for r in &measured.ranges {
                let (a, b) = (anchor(r.from), anchor(r.to));
                sum += (((a[0] - b[0]).hypot(a[1] - b[1]) - r.m) / r.sigma_m).powi(2);
            }
            sum
        };
        let mut at: Vec<f64> = found.anchors_m.iter().flatten().copied().collect();
        at.push(found.scale);
        at.extend(found.offsets_m.iter());
        at.extend(found.points_xy_m.iter().flatten());
        let best = cost(&at);
        for k in (0..at.len()).filter(|k| ![0, 1, 4].contains(k)) {
            let mut moved = |by: f64| {
                let keep = at[k];
                at[k] = keep + by;
                let c = cost(&at);
                at[k] = keep;
                c
            };
            let (up, down) = (moved(1e-5), moved(-1e-5));
            assert!(up > best && down > best, "{loss:?} unknown {k}");
            // Central difference over curvature: distance to the minimum along this axis.
            let off = 1e-5 * (down - up) / (2.0 * (up + down - 2.0 * best));
            assert!(off.abs() < 1e-7, "{loss:?} unknown {k}: {off}");
        }
        assert_eq!(found.anchors_m[0][..2], [0.0, 0.0]);
        assert_eq!(found.anchors_m[1][1], 0.0);
    }
}

#[test]
fn without_ranges_x_and_y_stay_where_they_are() {
    let anchors: Vec<[f64; 3]> = four().iter().map(|a| [a[0] + 3.0, a[1] - 2.0, a[2]]).collect();
    let points = placement::corners(&flat(&anchors), 8, 0.9);
    let lengths: Vec<_> = points.iter().map(|c| lengths_to(&anchors, *c)).collect();
    let xy = flat(&anchors);
    let found = calibrate_joint(&JointInput::new(&xy, &lengths, 0.01)).unwrap();
    for i in 0..4 {
        assert_eq!(found.anchors_m[i][..2], anchors[i][..2]);
        assert!((found.anchors_m[i][2] - anchors[i][2]).abs() < 1e-9);
        assert_eq!(found.covariance.std_m()[i][..2], [0.0, 0.0]);
    }
}
