//! Heights by (4)-(5) compared with an independent minimiser and the published figures.

use cable_robot::Vector3;
use calibration::heights::closed_form;
use calibration::{Method, calibrate, calibrate_heights, gps_anchor, placement, survey_network};

use super::stand_in::*;

/// Nelder-Mead simplex on (4) with the linear point estimate, written without the closed form.
mod simplex {
    use cable_robot::CableVec;

    /// (4), with the points by linear least squares on differences from the mean sphere.
    pub fn cost(xy: &[[f64; 2]], lengths: &[CableVec], z: &[f64]) -> f64 {
        let n = xy.len() as f64;
        let mean = [0, 1].map(|k| xy.iter().map(|a| a[k]).sum::<f64>() / n);
        let (mut sxx, mut sxy, mut syy) = (0.0, 0.0, 0.0);
        for a in xy {
            let (x, y) = (a[0] - mean[0], a[1] - mean[1]);
            (sxx, sxy, syy) = (sxx + x * x, sxy + x * y, syy + y * y);
        }
        let mut total = 0.0;
        for l in lengths {
            // 2 (a_i - mean).c = |a_i|² + z_i² - L_i² - their mean.
            let rhs: Vec<f64> =
                (0..xy.len()).map(|i| xy[i][0] * xy[i][0] + xy[i][1] * xy[i][1] + z[i] * z[i] - l[i] * l[i]).collect();
            let middle = rhs.iter().sum::<f64>() / n;
            let (mut bx, mut by) = (0.0, 0.0);
            for (a, r) in xy.iter().zip(&rhs) {
                bx += (a[0] - mean[0]) * (r - middle) / 2.0;
                by += (a[1] - mean[1]) * (r - middle) / 2.0;
            }
            let det = sxx * syy - sxy * sxy;
            let c = [(syy * bx - sxy * by) / det, (sxx * by - sxy * bx) / det];
            for i in 0..xy.len() {
                let d2 = (xy[i][0] - c[0]).powi(2) + (xy[i][1] - c[1]).powi(2) + z[i] * z[i];
                total += (l[i] * l[i] - d2).powi(2);
            }
        }
        total
    }

    pub fn minimise(f: impl Fn(&[f64]) -> f64, start: &[f64]) -> Vec<f64> {
        let n = start.len();
        let mut points: Vec<(Vec<f64>, f64)> = Vec::new();
        for k in 0..=n {
            let mut p = start.to_vec();
            if k > 0 {
                p[k - 1] += 0.3;
            }
            let value = f(&p);
            points.push((p, value));
        }
        for _ in 0..5000 {
            points.sort_by(|a, b| a.1.total_cmp(&b.1));
            let size = points.iter().map(|p| (p.0[0] - points[0].0[0]).abs()).fold(0.0, f64::max);
            if size < 1e-10 {
                break;
            }
            let centre: Vec<f64> = (0..n).map(|k| points[..n].iter().map(|p| p.0[k]).sum::<f64>() / n as f64).collect();
            let worst = points[n].clone();
            let along = |t: f64| -> (Vec<f64>, f64) {
                let p: Vec<f64> = (0..n).map(|k| centre[k] + t * (worst.0[k] - centre[k])).collect();
                let value = f(&p);
                (p, value)
            };
            let reflected = along(-1.0);
            points[n] = if reflected.1 < points[0].1 {
                let expanded = along(-2.0);
                if expanded.1 < reflected.1 { expanded } else { reflected }
            } else if reflected.1 < points[n - 1].1 {
                reflected
            } else {
                let contracted = along(if reflected.1 < worst.1 { -0.5 } else { 0.5 });
                if contracted.1 < worst.1 {
                    contracted
                } else {
                    let best = points[0].0.clone();
                    for p in &mut points[1..] {
                        p.0 = (0..n).map(|k| best[k] + 0.5 * (p.0[k] - best[k])).collect();
                        p.1 = f(&p.0);
                    }
                    continue;
                }
            };
        }
        points.sort_by(|a, b| a.1.total_cmp(&b.1));
        points[0].0.clone()
    }
}

#[test]
fn the_closed_form_is_the_minimum_that_a_simplex_search_finds() {
    for trial in 0..40 {
        let mut random = Random(trial);
        let anchors = if trial % 2 == 0 { three() } else { four() };
        let points: Vec<_> = (0..6 + trial as usize % 5).map(|_| random.point_within(&anchors)).collect();
        let measured = Noise::plain(0.02, 0.02).measure(&mut random, &anchors, &points);
        let xy = flat(&anchors);
        let Ok(found) = calibrate_heights(&xy, &measured.lengths_m) else { continue };
        let cost = |z: &[f64]| simplex::cost(&xy, &measured.lengths_m, z);
        assert!((cost(&found.heights_m) - found.cost_m4).abs() < 1e-9 * (1.0 + found.cost_m4), "{trial}");
        let start: Vec<_> = anchors.iter().map(|a| a[2]).collect();
        let searched = simplex::minimise(cost, &start);
        assert!(found.cost_m4 <= cost(&searched) * (1.0 + 1e-12));
        for (a, b) in found.heights_m.iter().zip(&searched) {
            assert!((a - b.abs()).abs() < 1e-6, "{trial}: {:?} {searched:?}", found.heights_m);
        }
    }
}

#[test]
fn the_closed_form_is_exact_for_any_number_of_cables_in_any_frame() {
    for n in 3..=8 {
        let mut random = Random(n as u64);
        let anchors: Vec<[f64; 3]> = (0..n)
            .map(|i| {
                let t = std::f64::consts::TAU * i as f64 / n as f64;
                [100.0 + 6.0 * t.cos() + random.uniform(), -50.0 + 6.0 * t.sin(), 2.5 + random.uniform()]
            })
            .collect();
        let points: Vec<_> = (0..5).map(|_| random.point_within(&anchors)).collect();
        let lengths: Vec<_> = points.iter().map(|c| lengths_to(&anchors, *c)).collect();
        let found = calibrate_heights(&flat(&anchors), &lengths).unwrap();
        for i in 0..n {
            assert!((found.heights_m[i] - anchors[i][2]).abs() < 1e-9);
        }
        for (f, t) in found.points_xy_m.iter().zip(&points) {
            assert!((f[0] - t[0]).hypot(f[1] - t[1]) < 1e-9);
        }
    }
}

/// Mean over trials of the mean height error, m, as in Fig. 3, and of the position error, as in Fig. 4; optima without
/// real heights are excluded.
fn published(m: usize, sigma_length_m: f64, trials: u64) -> (f64, f64) {
    let anchors = three();
    let (mut height, mut space, mut count) = (0.0, 0.0, 0.0);
    for trial in 0..trials {
        let mut random = Random((m as u64) << 32 | trial);
        let points: Vec<_> = (0..m).map(|_| random.point_within(&anchors)).collect();
        let measured = Noise::plain(sigma_length_m, 0.02).measure(&mut random, &anchors, &points);
        let xy = survey_network(3, &measured.ranges, &[]).unwrap().anchors_xy_m;
        let z = closed_form(&xy, &measured.lengths_m).unwrap().squared_heights_m2.map(|w| w.max(0.0).sqrt());
        for i in 0..3 {
            let error = Vector3::new(xy[i][0], xy[i][1], z[i]) - Vector3::from(anchors[i]);
            height += error.z.abs() / 3.0;
            space += error.norm() / 3.0;
        }
        count += 1.0;
    }
    (height / count, space / count)
}

#[test]
fn height_errors_agree_with_figure_3() {
    // (points, sigma of length, mean height error) of an independent implementation with the same configuration.
    for (m, sigma, expected) in [
        (6, 0.02, 0.038),
        (8, 0.05, 0.0668),
        (10, 0.02, 0.0247),
        (10, 0.10, 0.109),
        (20, 0.05, 0.0362),
        (20, 0.20, 0.138),
    ] {
        let (height, _) = published(m, sigma, 1500);
        println!("Fig. 3: {m} points, {sigma} m: {height:.4} m, expected {expected}");
        assert!((height / expected - 1.0).abs() < 0.07, "{m} {sigma}: {height}");
    }
}

#[test]
fn the_crossover_of_figure_4_lies_between_5_and_10_points() {
    let anchors = three();
    let mean = [0, 1].map(|k| anchors.iter().map(|a| a[k]).sum::<f64>() / 3.0);
    let triple = [0, 1, 2].map(|i| {
        let at = |k: usize| mean[k] + 0.8 * (anchors[i][k] - mean[k]);
        [at(0), at(1), 0.0]
    });
    for (sigma, expected) in [(0.02, 0.0435), (0.10, 0.218)] {
        let mut gps = 0.0;
        let trials = 4000;
        for trial in 0..trials {
            let mut random = Random(trial);
            for a in &anchors {
                let lengths = triple.map(|p| (Vector3::from(*a) - Vector3::from(p)).norm() + random.normal(sigma));
                let found = gps_anchor(&triple, &lengths).unwrap();
                gps += (Vector3::from(found) - Vector3::from(*a)).norm() / 3.0 / trials as f64;
            }
        }
        let (_, five) = published(5, sigma, 1500);
        let (_, ten) = published(10, sigma, 1500);
        println!("Fig. 4: {sigma} m: GPS {gps:.4}, 5 points {five:.4}, 10 points {ten:.4}");
        assert!((gps / expected - 1.0).abs() < 0.05, "{sigma}: {gps}");
        assert!(ten < gps && gps < five, "{sigma}: {ten} {gps} {five}");
    }
}

#[test]
fn three_points_at_the_corners_are_equivalent_to_twenty_at_random() {
    let anchors = three();
    let corners = placement::corners(&flat(&anchors), 3, 0.9);
    let (mut error, trials) = (0.0, 2000);
    for trial in 0..trials {
        let mut random = Random(trial);
        let measured = Noise::plain(0.02, 0.02).measure(&mut random, &anchors, &corners);
        let found = calibrate(&measured, Method::Survey).unwrap();
        error += (0..3).map(|i| (found.anchors_m[i][2] - anchors[i][2]).abs()).sum::<f64>() / 3.0 / trials as f64;
    }
    let (random, _) = published(20, 0.02, 1500);
    println!("3 corner points {error:.4} m, 20 random points {random:.4} m");
    assert!(error < 1.05 * random, "{error} {random}");
}
