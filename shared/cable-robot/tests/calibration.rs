//! Calibration against simulated truth, an independent minimiser, the published figures and data that determine nothing.

#![allow(clippy::unwrap_used, clippy::expect_used)]
#![allow(clippy::needless_range_loop, reason = "anchors are compared by index")]

use cable_robot::calibration::heights::closed_form;
use cable_robot::calibration::{
    CalibrationError, DirectHeight, JointInput, Loss, Measurements, Method, Range, Side, calibrate, calibrate_heights,
    calibrate_joint, fourth_anchor, gps_anchor, hold_out, placement, points_from_rows, survey_anchors, survey_network,
};
use cable_robot::{CableVec, Vector3};
use proptest::prelude::*;

/// SplitMix64 and Box-Muller: seeded, and nobody else's.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self, sigma: f64) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        sigma * radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// Anywhere in the polygon of the anchors, shrunk to 0.9 about their mean: a random triangle of a fan, then a point in it.
    fn point_within(&mut self, anchors: &[[f64; 3]]) -> [f64; 2] {
        let n = anchors.len();
        let mean = [0, 1].map(|k| anchors.iter().map(|a| a[k]).sum::<f64>() / n as f64);
        let pick = 1 + (self.uniform() * (n - 2) as f64) as usize;
        let corner = [anchors[0], anchors[pick], anchors[(pick + 1) % n]];
        let (mut u, mut v) = (self.uniform(), self.uniform());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        [0, 1].map(|k| {
            let p = corner[0][k] + u * (corner[1][k] - corner[0][k]) + v * (corner[2][k] - corner[0][k]);
            mean[k] + 0.9 * (p - mean[k])
        })
    }
}

/// Spans of about 10 m, heights of about 3 m; a stand-in for the paper's lost Table I.
fn three() -> Vec<[f64; 3]> {
    let xy = survey_anchors([9.1, 9.8, 9.4], Side::Left).unwrap();
    [3.20, 3.45, 3.05].iter().zip(xy).map(|(z, [x, y])| [x, y, *z]).collect()
}

fn four() -> Vec<[f64; 3]> {
    vec![[0.0, 0.0, 3.20], [9.8, 0.0, 3.45], [10.3, 8.7, 3.05], [-0.4, 9.1, 3.30]]
}

fn flat(anchors: &[[f64; 3]]) -> Vec<[f64; 2]> {
    anchors.iter().map(|a| [a[0], a[1]]).collect()
}

fn lengths_to(anchors: &[[f64; 3]], c: [f64; 2]) -> CableVec {
    CableVec::from_fn(anchors.len(), |i| {
        let a = anchors[i];
        (Vector3::from(a) - Vector3::new(c[0], c[1], 0.0)).norm()
    })
}

/// What the instruments would say.
struct Noise {
    length_m: f64,
    range_m: f64,
    scale: Option<f64>,
    offset_m: Option<f64>,
}

impl Noise {
    fn plain(length_m: f64, range_m: f64) -> Self {
        Self { length_m, range_m, scale: None, offset_m: None }
    }

    fn measure(&self, random: &mut Random, anchors: &[[f64; 3]], points: &[[f64; 2]]) -> Measurements {
        let n = anchors.len();
        let mut ranges = Vec::new();
        for from in 0..n {
            for to in from + 1..n {
                let d = (anchors[from][0] - anchors[to][0]).hypot(anchors[from][1] - anchors[to][1]);
                ranges.push(Range { from, to, m: d + random.normal(self.range_m), sigma_m: self.range_m });
            }
        }
        let scale = 1.0 + self.scale.map_or(0.0, |s| random.normal(s));
        let offsets: Vec<f64> = (0..n).map(|_| self.offset_m.map_or(0.0, |s| random.normal(s))).collect();
        let lengths_m = points
            .iter()
            .map(|c| {
                let exact = lengths_to(anchors, *c);
                CableVec::from_fn(n, |i| scale * exact[i] + offsets[i] + random.normal(self.length_m))
            })
            .collect();
        Measurements {
            ranges,
            lengths_m,
            sigma_length_m: self.length_m,
            sigma_scale: self.scale,
            sigma_offset_m: self.offset_m,
            ..Measurements::new(n)
        }
    }
}

/// Share of stated 95 % regions, over all anchors, that hold the truth; and of the region of all anchors together.
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
fn leaving_out_scale_and_zeros_that_are_there_is_noticed_or_at_least_overconfident() {
    // The reason why they are in the model: without them the regions are wrong.
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

/// Nelder and Mead's simplex on (4) with the linear point estimate, written without the closed form: heights in, cost out.
mod simplex {
    use cable_robot::CableVec;

    /// (4), the points by linear least squares on differences from the mean sphere.
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

/// Mean over trials of the mean error of height, m, as in Fig. 3, and in space, as in Fig. 4; optima without real heights
/// are left out.
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
fn height_errors_of_figure_3_come_out() {
    // (points, sigma of length, mean height error) of an independent implementation with the same stand-in.
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
fn three_points_at_the_corners_are_worth_twenty_at_random() {
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

/// Mean height error of the paper's method and of the joint estimator on the same data.
fn duel(spoil: impl Fn(&mut Random, &mut Measurements), m: usize, trials: u64) -> (f64, f64) {
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
    let (paper, joint) = duel(
        |_, measured| {
            measured.lengths_m.iter_mut().for_each(|l| *l = l.map(|v| 1.01 * v));
            measured.sigma_scale = Some(0.02);
        },
        20,
        200,
    );
    println!("1 % scale, 20 points: paper {paper:.4} m, joint {joint:.4} m");
    assert!(paper > 0.08 && paper > 6.0 * joint, "{paper} {joint}");

    let (paper, joint) = duel(
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
    let (paper, cauchy) = duel(
        |random, measured| {
            outliers(random, measured);
            measured.loss = Loss::Cauchy;
        },
        20,
        200,
    );
    let (_, huber) = duel(
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
    // Plumb lines good to 2 cm, lengths to 5 mm: lengths to many points know x and y better.
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
        // The cost written out once more, over one flat vector of unknowns.
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
            // Central difference over curvature: how far the minimum along this axis is.
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

fn refused(found: Result<impl std::fmt::Debug, CalibrationError>, kind: &str) -> String {
    let error = found.unwrap_err();
    assert_eq!(error.kind(), kind, "{error}");
    error.to_string()
}

#[test]
fn a_sideways_shift_of_points_on_a_line_changes_no_length() {
    // Why two points are not enough for four cables, and why a line never is.
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
fn points_that_determine_nothing_are_refused_for_every_number_of_cables() {
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
                let sentence = refused(calibrate_heights(&xy, lengths), "rank_deficient");
                assert!(sentence.contains(if m < 3 { "at least three" } else { "line" }), "{sentence}");
                refused(calibrate_joint(&JointInput::new(&xy, lengths, 0.005)), "rank_deficient");
                let scaled = JointInput { sigma_scale: Some(0.01), ..JointInput::new(&xy, lengths, 0.005) };
                refused(calibrate_joint(&scaled), "rank_deficient");
            }
        }
        // Two points anywhere.
        let two: Vec<_> = [[0.0, 1.0], [2.0, -1.0]].iter().map(|c| lengths_to(&anchors, *c)).collect();
        refused(calibrate_heights(&xy, &two), "rank_deficient");
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
        let sentence = refused(calibrate(&measure(0.02), method), "rank_deficient");
        assert!(sentence.contains("line"), "{sentence}");
        let found = calibrate(&measure(3.0), method).unwrap();
        assert!(found.covariance.worst().2 < 0.05);
        // How wide the strip has to be follows from the deviation, not from a fixed angle: better lengths need less.
        let mut better = measure(0.08);
        refused(calibrate(&Measurements { refuse_above_std_m: 0.2, ..better.clone() }, method), "rank_deficient");
        better = Noise::plain(0.0005, 0.0005).measure(&mut Random(3), &anchors, &strip(0.08));
        assert!(calibrate(&Measurements { refuse_above_std_m: 0.2, ..better }, method).is_ok());
    }
}

#[test]
fn negative_squared_heights_are_an_error_and_not_clipped() {
    let mut anchors = three();
    anchors[1][2] = 0.4;
    let points = placement::corners(&flat(&anchors), 6, 0.9);
    // Line 2 reads 30 cm short: its anchor would have to be at an imaginary height.
    let lengths: Vec<_> =
        points.iter().map(|c| lengths_to(&anchors, *c).zip_map(&[0.0, -0.3, 0.0], |l, o| l + o)).collect();
    let sentence = refused(calibrate_heights(&flat(&anchors), &lengths), "no_real_height");
    assert!(sentence.contains("anchor 2"), "{sentence}");
    let xy = flat(&anchors);
    refused(calibrate_joint(&JointInput::new(&xy, &lengths, 0.01)), "no_real_height");
    // The regression itself still says what it found.
    assert!(closed_form(&xy, &lengths).unwrap().squared_heights_m2[1] < 0.0);
}

#[test]
fn heights_measured_directly_count() {
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
    // Both ways weigh the same information.
    let (survey, joint) = (calibrate(&measured, Method::Survey).unwrap(), calibrate(&measured, Method::Joint).unwrap());
    for i in 0..3 {
        assert!((survey.covariance.std_m()[i][2] / joint.covariance.std_m()[i][2] - 1.0).abs() < 0.15);
    }
    // All heights measured: no point is needed.
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
    // Points on a line, and one height that settles the tilt: only the joint method can use it.
    let line: Vec<[f64; 2]> = (0..6).map(|j| [2.0 + j as f64, 3.0]).collect();
    measured.heights.truncate(1);
    measured.lengths_m = line.iter().map(|c| lengths_to(&anchors, *c)).collect();
    assert!(refused(calibrate(&measured, Method::Survey), "rank_deficient").contains("joint"));
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
    // One in a hundred by design; with the robust loss's own losses a few more.
    assert!(alarms <= 4 && alarms_beside_an_outlier <= 8, "{alarms} {alarms_beside_an_outlier}");
}

#[test]
fn held_out_points_are_predicted_as_well_as_the_lengths_allow() {
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
    // A scale error hides from the residuals but hold-out cannot see it either; only the model can. Few points: none left.
    let few = Measurements { lengths_m: measured.lengths_m[..3].to_vec(), refuse_above_std_m: 100.0, ..measured };
    assert!(hold_out(&few, Method::Survey).unwrap().is_none());
}

#[test]
fn the_prediction_before_measuring_is_what_comes_out_after() {
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

#[test]
fn gps_gives_the_upper_anchor_with_its_deviation() {
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
fn gps_refusals_have_their_kinds() {
    let p = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
    refused(gps_anchor(&p, &[1.0, 1.0, 1.0]), "unreachable");
    refused(gps_anchor(&p, &[1.0, f64::NAN, 1.0]), "invalid_argument");
    refused(gps_anchor(&p, &[1.0, -1.0, 1.0]), "invalid_argument");
    refused(gps_anchor(&[p[0], p[1], [8.0, 0.0, 0.0]], &[5.0, 5.0, 5.0]), "degenerate_geometry");
    refused(gps_anchor(&[p[0], p[1], [0.0, 0.0, 4.0]], &[5.0, 5.0, 5.0]), "ambiguous");
}

#[test]
fn surveys_refuse_what_is_no_triangle() {
    refused(survey_anchors([3.0, 9.0, 4.0], Side::Left), "degenerate_geometry");
    refused(survey_anchors([4.0, 10.0, 6.0], Side::Left), "degenerate_geometry");
    refused(survey_anchors([4.0, 0.0, 4.0], Side::Left), "degenerate_geometry");
    refused(survey_anchors([4.0, -5.0, 4.0], Side::Left), "invalid_argument");
    refused(survey_anchors([4.0, f64::NAN, 4.0], Side::Left), "invalid_argument");
    let xy = [[0.0, 0.0], [8.0, 0.0], [8.0, 6.0]];
    refused(fourth_anchor(&xy, &[6.0, 10.0], None), "ambiguous");
    refused(fourth_anchor(&xy, &[1.0, 2.0], Some(Side::Left)), "degenerate_geometry");
    refused(fourth_anchor(&xy, &[6.0], Some(Side::Left)), "invalid_argument");
    let line = [[0.0, 0.0], [4.0, 0.0], [8.0, 0.0]];
    refused(fourth_anchor(&line, &[5.0, 3.0, 5.0], None), "degenerate_geometry");
    let left = fourth_anchor(&xy, &[6.0, 10.0], Some(Side::Left)).unwrap();
    let right = fourth_anchor(&xy, &[6.0, 10.0], Some(Side::Right)).unwrap();
    assert!((left[1] - 6.0).abs() < 1e-12 && (right[1] + 6.0).abs() < 1e-12);
    assert!(Side::from_sign(0).is_err());
}

#[test]
fn a_network_names_the_range_that_is_missing() {
    let range = |from, to, m| Range { from, to, m, sigma_m: 0.003 };
    let triangle = [range(0, 1, 8.0), range(0, 2, 10.0), range(1, 2, 6.0)];
    let error = refused(survey_network(3, &triangle[1..], &[]), "rank_deficient");
    assert!(error.contains("anchors 1 and 2"), "{error}");
    let error = refused(survey_network(4, &triangle, &[]), "rank_deficient");
    assert!(error.contains("anchor 4"), "{error}");
    let mut two = triangle.to_vec();
    two.extend([range(0, 3, 6.0), range(3, 1, 10.0)]);
    let error = refused(survey_network(4, &two, &[]), "ambiguous");
    assert!(error.contains("side"), "{error}");
    let found = survey_network(4, &two, &[None, None, None, Some(Side::Right)]).unwrap();
    assert!((found.anchors_xy_m[3][1] + 6.0).abs() < 1e-9);
    let error = refused(survey_network(3, &[range(0, 1, 8.0), range(0, 0, 1.0)], &[]), "invalid_argument");
    assert!(error.contains("two different"), "{error}");
    refused(survey_network(3, &[range(0, 7, 8.0)], &[]), "invalid_argument");
}

#[test]
fn rows_by_cable_become_points() {
    let points = points_from_rows(&[vec![1.0, 2.0], vec![3.0, 4.0], vec![5.0, 6.0]]).unwrap();
    assert_eq!(points[1][..], [2.0, 4.0, 6.0]);
    refused(points_from_rows(&[vec![1.0, 2.0], vec![3.0]]), "invalid_argument");
    refused(points_from_rows(&vec![vec![1.0]; 9]), "invalid_argument");
    let nan = points_from_rows(&[[1.0, f64::NAN, 1.0], [1.0; 3], [1.0; 3]]).unwrap();
    refused(calibrate_heights(&flat(&three()), &nan), "invalid_argument");
    let line = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]];
    refused(calibrate_heights(&line, &points), "degenerate_geometry");
    refused(calibrate_heights(&flat(&three())[..2], &points), "invalid_argument");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_survey_puts_the_anchors_back(x2 in 1.0..30.0f64, x3 in -20.0..40.0f64, y3 in 0.1..30.0f64, x4 in -20.0..40.0f64, y4 in -30.0..30.0f64, left in any::<bool>()) {
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
    fn nothing_panics_and_no_answer_is_not_a_number(rows in proptest::collection::vec(proptest::collection::vec(prop_oneof![Just(0.0), Just(f64::NAN), Just(1e300), -1.0..20.0f64], 5), 3..5), x in -5.0..15.0f64, y in -5.0..15.0f64) {
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
