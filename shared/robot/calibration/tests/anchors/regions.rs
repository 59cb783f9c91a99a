//! Confidence regions contain the truth as often as stated.

use cable_robot::Vector3;
use calibration::{Loss, Measurements, Method, calibrate};

use super::stand_in::*;

/// Share of 95 % regions that contain the truth: of single anchors, and of all anchors together.
fn coverage(anchors: &[[f64; 3]], noise: &Noise, method: Method, loss: Loss, trials: u64) -> (f64, f64) {
    let (mut inside, mut asked, mut together) = (0, 0, 0);
    for trial in 0..trials {
        let mut random = Random(0x5eed_0000 + trial);
        let points: Vec<_> = (0..12).map(|_| random.point_within(anchors)).collect();
        let measured = Measurements { loss, ..noise.measure(&mut random, anchors, &points) };
        let found = calibrate(&measured, method).unwrap();
        let errors: Vec<f64> =
            found.anchors_m.iter().zip(anchors).flat_map(|(f, t)| (0..3).map(move |k| f[k] - t[k])).collect();
        for i in 0..anchors.len() {
            inside +=
                u32::from(found.covariance.contains_95(i, &Vector3::from_column_slice(&errors[3 * i..3 * i + 3])));
            asked += 1;
        }
        let (distance, free) = found.covariance.distance_squared(&errors);
        assert_eq!(free, 3 * anchors.len() - 3);
        // 95 % quantiles of chi-squared with 6 and 9 degrees of freedom.
        together += u32::from(distance <= [12.5916, 16.9190][anchors.len() - 3]);
    }
    (f64::from(inside) / f64::from(asked), f64::from(together) / trials as f64)
}

#[test]
fn stated_95_percent_regions_hold_the_truth() {
    let plain = Noise::plain(0.005, 0.003);
    let rich = Noise { scale: Some(0.005), offset_m: Some(0.01), ..Noise::plain(0.005, 0.003) };
    for anchors in [three(), four()] {
        for (name, noise, method) in [
            ("survey", &plain, Method::Survey),
            ("joint", &plain, Method::Joint),
            ("joint with scale and zeros", &rich, Method::Joint),
        ] {
            let (each, all) = coverage(&anchors, noise, method, Loss::Squared, 1000);
            println!(
                "{} cables, {name}: each anchor {:.1} %, all together {:.1} %",
                anchors.len(),
                100.0 * each,
                100.0 * all
            );
            assert!((0.93..=0.97).contains(&each), "{name}: {each}");
            assert!((0.93..=0.97).contains(&all), "{name}: {all}");
        }
    }
}

#[test]
fn regions_with_a_robust_loss_are_not_too_small() {
    let (each, _) = coverage(&four(), &Noise::plain(0.005, 0.003), Method::Joint, Loss::Huber, 300);
    assert!((0.93..=0.99).contains(&each), "{each}");
}

#[test]
fn ignoring_existing_scale_and_zeros_gives_wrong_regions() {
    // The reason why the model contains them: without them the regions are wrong.
    let mut hit = 0;
    for trial in 0..100 {
        let mut random = Random(trial);
        let anchors = three();
        let points: Vec<_> = (0..12).map(|_| random.point_within(&anchors)).collect();
        let noise = Noise { scale: Some(0.005), offset_m: Some(0.01), ..Noise::plain(0.005, 0.003) };
        let measured = noise.measure(&mut random, &anchors, &points);
        let Ok(found) = calibrate(&measured, Method::Survey) else { continue };
        let error = Vector3::from(found.anchors_m[2]) - Vector3::from(anchors[2]);
        hit += u32::from(found.covariance.contains_95(2, &error));
    }
    assert!(hit < 60, "{hit}");
}
