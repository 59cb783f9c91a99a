//! Anchors of cables over pulleys of known radius, from lengths that include the wheels.

use cable_robot::{Anchors, CableVec, Vector3, kinematics};
use calibration::holdout::hold_out;
use calibration::{Measurements, Method, calibrate};

use super::stand_in::*;

const RADIUS_M: f64 = 0.04;

/// Replaces straight distances by lengths over pulleys, with the same noise.
fn over_pulleys(measured: &mut Measurements, anchors: &[[f64; 3]], points: &[[f64; 2]]) {
    let wheels = Anchors::new(anchors).unwrap().with_pulleys(&vec![RADIUS_M; anchors.len()]).unwrap();
    for (l, c) in measured.lengths_m.iter_mut().zip(points) {
        let with = kinematics::inverse_kinematics(&wheels, &Vector3::new(c[0], c[1], 0.0));
        let straight = lengths_to(anchors, *c);
        *l = CableVec::from_fn(anchors.len(), |i| l[i] + with[i] - straight[i]);
    }
    measured.gps_m = points.iter().map(|c| [c[0], c[1], 0.0]).collect();
    measured.pulley_radius_m = vec![RADIUS_M; anchors.len()];
}

fn worst(found: &[[f64; 3]], anchors: &[[f64; 3]]) -> f64 {
    found.iter().zip(anchors).map(|(a, b)| (Vector3::from(*a) - Vector3::from(*b)).norm()).fold(0.0, f64::max)
}

#[test]
fn exact_lengths_over_pulleys_give_the_exact_anchors() {
    for anchors in [three(), four()] {
        let mut random = Random(11);
        let points: Vec<_> = (0..12).map(|_| random.point_within(&anchors)).collect();
        let mut measured = Noise::plain(1e-9, 1e-9).measure(&mut random, &anchors, &points);
        over_pulleys(&mut measured, &anchors, &points);
        for method in [Method::Survey, Method::Joint] {
            let found = calibrate(&measured, method).unwrap();
            assert!(worst(&found.anchors_m, &anchors) < 1e-6, "{method:?}: {:?}", found.anchors_m);
            assert!(found.rms_residual_m() < 1e-7, "{}", found.rms_residual_m());
            let excluded = hold_out(&measured, method).unwrap().unwrap();
            assert!(excluded.rms_m < 1e-6 && excluded.position_rms_m < 1e-5, "{excluded:?}");
        }
        // Without the radius the heights are wrong by far more.
        measured.pulley_radius_m.clear();
        measured.sigma_length_m = 0.005;
        let found = calibrate(&measured, Method::Joint).unwrap();
        assert!(worst(&found.anchors_m, &anchors) > 0.02, "{:?}", found.anchors_m);
    }
}

#[test]
fn noisy_lengths_over_pulleys_give_anchors_within_the_noise() {
    let anchors = four();
    for method in [Method::Survey, Method::Joint] {
        let (mut with, mut eyes, mut normalized) = (0.0, 0.0, 0.0);
        for trial in 0..40 {
            let mut random = Random(0x5eed + trial);
            let points: Vec<_> = (0..20).map(|_| random.point_within(&anchors)).collect();
            let straight = Noise::plain(0.005, 0.002).measure(&mut random, &anchors, &points);
            let mut measured = straight.clone();
            over_pulleys(&mut measured, &anchors, &points);
            let found = calibrate(&measured, method).unwrap();
            with += worst(&found.anchors_m, &anchors);
            eyes += worst(&calibrate(&straight, method).unwrap().anchors_m, &anchors);
            normalized += (found.anchors_m[2][2] - anchors[2][2]).abs() / found.covariance.std_m()[2][2];
        }
        println!("{method:?}: pulleys {:.4} m, eyes {:.4} m", with / 40.0, eyes / 40.0);
        assert!(with < 1.1 * eyes, "{method:?}: {with} {eyes}");
        assert!(normalized / 40.0 < 1.3, "{method:?}: {normalized}");
    }
}

#[test]
fn a_wrong_number_or_size_of_radii_is_refused() {
    let anchors = three();
    let mut random = Random(3);
    let points: Vec<_> = (0..6).map(|_| random.point_within(&anchors)).collect();
    let mut measured = Noise::plain(0.005, 0.002).measure(&mut random, &anchors, &points);
    for radii in [vec![0.04; 2], vec![0.04, 0.04, 40.0], vec![f64::NAN, 0.04, 0.04]] {
        measured.pulley_radius_m = radii;
        expect_error(calibrate(&measured, Method::Joint), "invalid_argument");
    }
}
