//! Properties of a track: the position at an instant, its uncertainty, and no position without estimates.

use proptest::prelude::*;
use survey::track::{Fix, Place, Track, TrackOptions, TrackPosition};

const MS: u64 = 1_000_000;

fn fix(stamp_ns: u64, position_m: [f64; 3], velocity_m_s: [f64; 3]) -> Fix {
    let mut covariance_m2 = [0.0; 9];
    (covariance_m2[0], covariance_m2[4], covariance_m2[8]) = (1e-6, 4e-6, 9e-6);
    Fix { stamp_ns, position_m, velocity_m_s, covariance_m2, residual_m: 0.0, epoch: 1 }
}

fn place(placing: TrackPosition) -> Place {
    match placing {
        TrackPosition::At(place) => place,
        other => panic!("{other:?}"),
    }
}

/// Motion on a circle of 1 m with 0.4 m/s, an estimate every 10 ms.
fn on_a_circle(time_s: f64) -> ([f64; 3], [f64; 3]) {
    let (sin, cos) = (0.4 * time_s).sin_cos();
    ([cos, sin, 0.5], [-0.4 * sin, 0.4 * cos, 0.0])
}

fn circle(seconds: u64) -> Track {
    let mut track = Track::new(TrackOptions::default()).unwrap();
    for i in 0..100 * seconds {
        let (position, velocity) = on_a_circle(i as f64 * 0.01);
        assert!(track.add(&fix(i * 10 * MS, position, velocity)));
    }
    track
}

proptest! {
    #[test]
    fn the_error_between_estimates_is_within_its_uncertainty(time_ns in 0..9_980_000_000_u64, lever in prop::array::uniform3(-1.0..1.0_f64)) {
        let place = place(circle(10).at(time_ns, 0.0, lever));
        let (truth, velocity) = on_a_circle(time_ns as f64 * 1e-9);
        for k in 0..3 {
            prop_assert!((place.position_m[k] - lever[k] - truth[k]).abs() < 3e-6);
            prop_assert!((place.velocity_m_s[k] - velocity[k]).abs() < 1e-5);
            prop_assert!((place.std_m()[k] / [1e-3, 2e-3, 3e-3][k] - 1.0).abs() < 0.01);
        }
    }

    #[test]
    fn an_uncertain_instant_spreads_along_the_motion(sigma_s in 0.0..0.1_f64) {
        let mut track = Track::new(TrackOptions::default()).unwrap();
        track.add(&fix(0, [0.0; 3], [0.4, 0.0, 0.0]));
        track.add(&fix(10 * MS, [0.004, 0.0, 0.0], [0.4, 0.0, 0.0]));
        let std_m = place(track.at(5 * MS, sigma_s, [0.0; 3])).std_m();
        prop_assert!((std_m[0] - (1e-6 + (0.4 * sigma_s).powi(2)).sqrt()).abs() < 1e-12);
        prop_assert!((std_m[1] - 2e-3).abs() < 1e-12);
    }
}

#[test]
fn instants_too_new_too_old_and_between() {
    let track = circle(20);
    let oldest_ns = (2000 - 1024) * 10 * MS;
    assert_eq!(track.at(19_990 * MS + 1, 0.0, [0.0; 3]), TrackPosition::Early);
    assert!(matches!(track.at(19_990 * MS, 0.0, [0.0; 3]), TrackPosition::At(_)));
    assert!(matches!(track.at(oldest_ns, 0.0, [0.0; 3]), TrackPosition::At(_)));
    assert_eq!(track.at(oldest_ns - 1, 0.0, [0.0; 3]), TrackPosition::Old);
    assert_eq!(Track::new(TrackOptions::default()).unwrap().at(5, 0.0, [0.0; 3]), TrackPosition::Early);
}

#[test]
fn gaps_and_epochs_are_not_interpolated() {
    let mut track = circle(1);
    let (position, velocity) = on_a_circle(2.0);
    track.add(&fix(2_000 * MS, position, velocity));
    track.add(&Fix { epoch: 2, ..fix(2_010 * MS, [9.0; 3], velocity) });
    assert_eq!(track.at(1_500 * MS, 0.0, [0.0; 3]), TrackPosition::Gap);
    assert_eq!(track.at(2_005 * MS, 0.0, [0.0; 3]), TrackPosition::Gap);
    assert!(matches!(track.at(2_010 * MS, 0.0, [0.0; 3]), TrackPosition::At(_)));
}

#[test]
fn invalid_estimates_are_ignored_and_the_same_instant_is_replaced() {
    let mut track = circle(1);
    let newest = *track.newest().unwrap();
    assert!(!track.add(&Fix { stamp_ns: newest.stamp_ns - 1, ..newest }));
    assert!(!track.add(&Fix { stamp_ns: newest.stamp_ns + 1, residual_m: f64::NAN, ..newest }));
    assert_eq!(track.newest(), Some(&newest));
    assert!(track.add(&Fix { position_m: [7.0; 3], ..newest }));
    assert_eq!(place(track.at(newest.stamp_ns, 0.0, [0.0; 3])).position_m, [7.0; 3]);
    assert!(Track::new(TrackOptions { kept: 1, gap_s: 1.0 }).is_err());
    assert!(Track::new(TrackOptions { kept: 9, gap_s: 0.0 }).is_err());
}
